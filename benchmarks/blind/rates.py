"""Records of a clock that knows nothing of the heart: false alarms, and causes named, by sampling.

Cases are drawn and marched once. Nulls are recorded `DRAWS` times, each time with another rate,
jitter, number of beats, stretch, start, breathing and noise, so that every rate meets every jitter
and number of beats. Records with one effect are recorded twice with the same random numbers: by a
clock whose rate divides no beat, and with samples that divide equal beats.
"""

import collections
import itertools
import pathlib
from collections.abc import Sequence

import numpy as np

from benchmarks.blind.cases import Cases
from benchmarks.blind.clocked import Clock
from benchmarks.blind.diagnoses import records_in
from benchmarks.blind.score import wilson
from diagnosis import Diagnosis, Record, diagnose, measured, stacked
from study.store.cache_folder import use_cache

RATES = (60.0, 100.0, 128.0, 250.0)
JITTERS = (0.0, 0.01, 0.02, 0.04)
BEATS = (3, 5, 8, 20, 60)
DRAWS = 3

SAMPLE_SD_MMHG = 1.0
"""Noise of a single sample."""


def draw_clocks(rng: np.random.Generator, count: int) -> list[Clock]:
    """Ways to record: every pair of rate and jitter in turn, the rest by chance."""
    pairs = list(itertools.product(RATES, JITTERS))
    order = [pairs[k] for k in rng.permutation(len(pairs))]
    return [
        Clock(
            rate=order[k % len(order)][0],
            beats=BEATS[int(rng.integers(len(BEATS)))],
            jitter=order[k % len(order)][1],
            stretch=("diastole", "stretched")[int(rng.integers(2))],
            anywhere=bool(rng.random() < 0.5),
            breath=float(rng.choice([0.0, 0.0, 1.5])),
            memory=None if rng.random() < 0.7 else 0.03,
            uneven=float(rng.choice([0.0, 0.1])),
        )
        for k in range(count)
    ]


def dividing(clock: Clock) -> Clock:
    """Equal beats from the start of ejection on, with samples that divide them."""
    return clock._replace(rate=None, jitter=0.0, anywhere=False, uneven=0.0)


def diagnosed(
    folder: pathlib.Path, cases: Cases, clocks: Sequence[Clock], seed: int
) -> list[Diagnosis | None]:
    """Diagnoses of cases recorded by clocks; None where a record is refused."""
    use_cache()
    cases.rng = np.random.default_rng(seed)
    cases.write(folder, SAMPLE_SD_MMHG, state=False, clocks=clocks)
    places = [folder / f"case-{k:04d}" for k in range(len(cases.labels))]
    records = {k: measured(r) for k, r in _by_position(places).items()}
    found: list[Diagnosis | None] = [None] * len(places)
    if records:
        batch = diagnose(stacked(list(records.values())))
        for k, diagnosis in zip(records, batch, strict=True):
            found[k] = diagnosis
    return found


def _by_position(places: Sequence[pathlib.Path]) -> dict[int, Record]:
    """Records by the position of their folder; those refused are left out."""
    found = records_in(places)
    return {k: found[place] for k, place in enumerate(places) if place in found}


def rates_table(folder: pathlib.Path, seed: int, count: int) -> str:
    """False alarms by rate, jitter and beats, and causes named, as Markdown.

    Args:
        folder: where the records are written.
        seed: of everything.
        count: patients without an effect, and patients with one.
    """
    rng = np.random.default_rng(seed)
    nulls = Cases(seed, count, "none")
    alarms: dict[tuple[str, str], list[bool]] = collections.defaultdict(list)
    for draw in range(DRAWS):
        clocks = draw_clocks(rng, count)
        found = diagnosed(folder / f"nulls-{draw}", nulls, clocks, seed + 100 + draw)
        for clock, diagnosis in zip(clocks, found, strict=True):
            alarm = diagnosis is not None and diagnosis.judgement.verdict != "no_gap"
            firm = diagnosis is not None and diagnosis.judgement.verdict in ("named", "unknown")
            for key in ("all", f"{clock.rate:g} Hz", f"jitter {clock.jitter:.0%}",
                        f"{clock.beats} beats"):  # fmt: skip
                alarms["no verdict but no gap", key].append(alarm)
                alarms["named or unknown", key].append(firm)
                alarms["refused", key].append(diagnosis is None)
    lines = ["| nulls | " + " | ".join(("named or unknown", "or ambiguous", "refused")) + " |",
             "|---|---|---|---|"]  # fmt: skip
    for key in dict.fromkeys(key for _, key in alarms):
        cells = [
            wilson(sum(alarms[what, key]), len(alarms[what, key]))
            for what in ("named or unknown", "no verdict but no gap", "refused")
        ]
        lines.append(f"| {key} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", *_named(folder, rng, seed, count)])


def _named(folder: pathlib.Path, rng: np.random.Generator, seed: int, count: int) -> list[str]:
    """How often one effect is named by either sampling."""
    cases = Cases(seed + 1, count, "single")
    clocks = draw_clocks(rng, count)
    lines = ["| one effect | ranked first | named | wrongly named |", "|---|---|---|---|"]
    for label, chosen in (("a clock's", clocks), ("dividing", [dividing(c) for c in clocks])):
        found = diagnosed(folder / f"singles-{label.split()[0]}", cases, chosen, seed + 200)
        first = named = wrong = 0
        for diagnosis, entry in zip(found, cases.labels, strict=True):
            if diagnosis is None:
                continue
            (cause,) = entry["sizes"]
            judgement = diagnosis.judgement
            first += max(judgement.inclusion, key=lambda n: judgement.inclusion[n]) == cause
            named += judgement.verdict == "named" and judgement.named == (cause,)
            wrong += judgement.verdict == "named" and cause not in judgement.named
        cells = [wilson(value, count) for value in (first, named, wrong)]
        lines.append(f"| {label} sampling | " + " | ".join(cells) + " |")
    return lines
