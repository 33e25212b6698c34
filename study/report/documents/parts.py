"""Parts that documents of several kinds hold."""

import dataclasses
from collections.abc import Iterable


@dataclasses.dataclass(frozen=True)
class Note:
    """A remark on a result.

    Attributes:
        level: `warning` where a number should not be taken at its face, else `info`.
        text: the remark.
    """

    level: str
    text: str


def notes(found: Iterable[tuple[str, str]]) -> list[Note]:
    """Remarks from their levels and texts."""
    return [Note(level, text) for level, text in found]


@dataclasses.dataclass(frozen=True)
class HeadlineReading:
    """FFR of one condition under one reading of the model.

    Attributes:
        condition: its name.
        reading: what tells the reading from the others: law, stress rule.
        ffr: predicted FFR [-].
        ffr_sd: its standard deviation [-].
        chance_at_or_below_threshold: chance of the threshold or below [-].
        measured: measured FFR [-].
        measured_sd: its standard deviation [-].
        z: model less measurement, in standard deviations of both [-].
        contradicted: whether the measurement contradicts the model.
    """

    condition: str
    reading: str
    ffr: float
    ffr_sd: float
    chance_at_or_below_threshold: float
    measured: float | None
    measured_sd: float | None
    z: float | None
    contradicted: bool


@dataclasses.dataclass(frozen=True)
class Headline:
    """The numbers behind the verdict.

    Attributes:
        threshold: FFR at or below which an obstruction is held to matter [-].
        not_included: what the uncertainty leaves out, in words.
        readings: of every condition and reading of the model.
    """

    threshold: float
    not_included: str
    readings: list[HeadlineReading]


@dataclasses.dataclass(frozen=True)
class NextMeasurement:
    """A recommended measurement.

    Attributes:
        sensor: what to measure.
        separates: the two hypotheses that it tells apart best.
        expected_log_bayes_factor: ln of the evidence expected for the likelier over the other [-].
    """

    sensor: str
    separates: list[str]
    expected_log_bayes_factor: float


@dataclasses.dataclass(frozen=True)
class AlphaCurve:
    """Resting ratio over α.

    Attributes:
        alpha: scale factors [-].
        rest_ratio: resting ratios [-].
    """

    alpha: list[float]
    rest_ratio: list[float]


@dataclasses.dataclass(frozen=True)
class AssumedNumber:
    """A number that the case does not give and the body of the patient tells.

    Attributes:
        text: what it is.
        value: the number, in its unit.
        low: 5 of 100 patients with this body lie below.
        high: 5 of 100 lie above.
        unit: in which the three are.
        source: where they come from.
    """

    text: str
    value: float
    low: float
    high: float
    unit: str
    source: str


@dataclasses.dataclass(frozen=True)
class BodyNumbers:
    """The body of the patient, and what was assumed from it.

    Attributes:
        weight_kg: weight.
        height_cm: standing height.
        age_years: age.
        sex: `female` or `male`.
        surface_area_m2: body surface area (Haycock et al. 1978).
        dominance: artery that feeds the lower wall of the left ventricle.
        assumed: numbers that the case does not give, by its table and key.
    """

    weight_kg: float | None
    height_cm: float | None
    age_years: float | None
    sex: str | None
    surface_area_m2: float | None
    dominance: str
    assumed: dict[str, AssumedNumber]
