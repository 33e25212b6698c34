"""What is said of a predicted FFR: its uncertainty, the chance of 0.80 or below, contradictions.

For each reading of the model FFR is taken as normal about its value with its standard deviation:

    P(FFR ≤ 0.80) = ½ erfc((value − 0.80)/(sd √2)),

and a measured FFR contradicts a reading where z = (value − measured)/√(sd² + sd_measured²) lies
beyond ±2.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from study.report.documents.parts import Headline, HeadlineReading
from study.report.number_formats import signed, with_sd
from study.run.limits import FFR_THRESHOLD

CONTRADICTED = 2.0
"""Standard deviations between model and measurement from which they contradict each other."""

SURE = 0.025
"""Chance on the other side of the threshold up to which a side is stated."""

NOT_INCLUDED = (
    "± is one standard deviation, from the error of the measured resting ratio alone; the chance "
    "assumes a normal distribution. Errors of the model and of the stress rule are not included."
)


class Reading(NamedTuple):
    """FFR of one condition under one reading of the model.

    Attributes:
        condition: its name.
        words: what tells the reading from the others: law, stress rule.
        value: predicted FFR [-].
        sd: its standard deviation [-].
        measured: measured FFR [-]; None where there is none.
        measured_sd: its standard deviation [-].
    """

    condition: str
    words: str
    value: float
    sd: float
    measured: float | None = None
    measured_sd: float = 0.0

    @property
    def chance(self) -> float:
        """Chance of 0.80 or below [-]."""
        return chance_at_or_below(self.value, self.sd)

    @property
    def z(self) -> float | None:
        """Model less measurement, in standard deviations of both [-]."""
        if self.measured is None:
            return None
        sd = math.hypot(self.sd, self.measured_sd)
        return (self.value - self.measured) / sd if sd > 0.0 else None

    @property
    def contradicted(self) -> bool:
        """Whether the measurement contradicts it."""
        return self.z is not None and abs(self.z) > CONTRADICTED


def chance_at_or_below(value: float, sd: float, threshold: float = FFR_THRESHOLD) -> float:
    """Chance of a ratio at or below a threshold, for a normal ratio with its sd [-]."""
    if not sd > 0.0:
        return float(value <= threshold)
    return 0.5 * math.erfc((value - threshold) / (sd * math.sqrt(2.0)))


def percent(chance: float) -> str:
    """A chance in per cent, no more exact than it is."""
    if chance < 0.001:
        return "below 0.1 %"
    if chance > 0.999:
        return "above 99.9 %"
    return f"{100.0 * chance:.{1 if chance < 0.0095 or chance > 0.9905 else 0}f} %"


def headline(readings: Sequence[Reading], *, what: str, concluded: bool = True) -> str:
    """Contradictions first, then each predicted FFR with its ± and chance, then what follows.

    Args:
        readings: of every condition, the case's own reading of a condition before its others.
        what: how the prediction is called, "Predicted FFR".
        concluded: whether it is said on which side of the threshold FFR lies; not where an interval
            with all that is uncertain says so.
    """
    groups: dict[str, list[Reading]] = {}
    for reading in readings:
        groups.setdefault(reading.condition, []).append(reading)
    against = [_contradiction(group) for group in groups.values() if group[0].contradicted]
    predicted = f"{what}: {'; '.join(_predicted(group) for group in groups.values())}."
    concluding = [_threshold(readings)] if concluded and not against else []
    return " ".join([*against, predicted, *concluding])


def _contradiction(group: Sequence[Reading]) -> str:
    own = group[0]
    assert own.measured is not None
    assert own.z is not None
    count = sum(reading.contradicted for reading in group)
    all_ = f"; {count} of {len(group)} readings are contradicted" if len(group) > 1 else ""
    return (
        f"The model is contradicted: measured {_pair(own.measured, own.measured_sd)} under "
        f"{own.condition}, model {_pair(own.value, own.sd)} ({signed(own.z, 1)} sd{all_})."
    )


def _predicted(group: Sequence[Reading]) -> str:
    own, others = group[0], group[1:]
    known = ""
    if own.measured is not None and not own.contradicted:
        known = f"; measured {_pair(own.measured, own.measured_sd)}"
    text = (
        f"{_pair(own.value, own.sd)} under {own.condition} (chance of {FFR_THRESHOLD:.2f} or "
        f"below: {percent(own.chance)}{known})"
    )
    if not others:
        return text
    listed = ", ".join(
        f"{_pair(reading.value, reading.sd)} ({percent(reading.chance)}) with {reading.words}"
        for reading in others
    )
    return f"{text}, {listed}"


def _threshold(readings: Sequence[Reading]) -> str:
    chances = [reading.chance for reading in readings]
    every = "By every reading of the model FFR" if len(readings) > 1 else "FFR"
    if max(chances) <= SURE:
        return f"{every} lies above {FFR_THRESHOLD:.2f}."
    if min(chances) >= 1.0 - SURE:
        return f"{every} lies at or below {FFR_THRESHOLD:.2f}."
    least, largest = percent(min(chances)), percent(max(chances))
    spread = largest if least == largest else f"{least} to {largest}, depending on the reading"
    return (
        f"Whether FFR lies above {FFR_THRESHOLD:.2f} is open: the chance of {FFR_THRESHOLD:.2f} or"
        f" below is {spread}."
    )


def headline_numbers(readings: Sequence[Reading]) -> Headline:
    """The numbers behind a headline, for a document."""
    entries = [
        HeadlineReading(
            condition=reading.condition,
            reading=reading.words,
            ffr=reading.value,
            ffr_sd=reading.sd,
            chance_at_or_below_threshold=reading.chance,
            measured=reading.measured,
            measured_sd=None if reading.measured is None else reading.measured_sd,
            z=reading.z,
            contradicted=reading.contradicted,
        )
        for reading in readings
    ]
    return Headline(FFR_THRESHOLD, NOT_INCLUDED, entries)


def _pair(value: float, sd: float) -> str:
    return with_sd(value, sd) if sd > 0.0 else f"{value:.3f}"
