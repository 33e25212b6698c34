"""The advised next measurement, made by the generator, and what it brings.

1. The records are diagnosed, and again with each flow added (`advice`); no label is opened.
2. The labels are opened. The generator draws the readings of every sensor of every case, the
   probabilities follow (`readings`) and go to the diagnosis's own rules for a verdict. A flow is
   followed by the second diagnosis.

Promised is KL(i ‖ j), the expected ln B of an effect i over a rival j if i acts. Realised is the
change of ln p(i)/p(j), cut at ±`MOST` as promises are. If j acts, ln p(j)/p(i) is expected to grow
by KL(j ‖ i), which a size that is hardly known makes much smaller:

    KL(j ‖ i) = ½ ln(1 + s²/σ²) + ½ (σ² + m²)/(s² + σ²) − ½.

The control is the mean over all other sensors of `READINGS`. "Most information" follows the reading
of most `readings.expected_information`.
"""

import pathlib
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.advice import LEVELS, Row, advised_rows
from benchmarks.blind.cases import unseal
from benchmarks.blind.readings import (
    Possible,
    errors_of,
    expected_information,
    parts_of,
    true_reading,
    updated,
)
from diagnosis import CATALOGUE
from diagnosis.next_measurement import READINGS
from diagnosis.verdict import judge, key_of, unconfirmed

MOST = 99.0
"""Bound of promises, and of what is compared with them."""

LEAST = 1e-9
"""Probability to which the true hypothesis is raised before its logarithm is taken."""


class Followed(NamedTuple):
    """What one measurement brought to one case.

    Attributes:
        log_B: change of ln p(i)/p(j), i and j being what the advice separates; None if not advised.
        information: change of ln p of the truth.
        standing: of the verdict, see `standing`.
    """

    log_B: float | None
    information: float
    standing: str


def standing(verdict: str, named: list[str], label: dict[str, Any]) -> str:
    """How a verdict stands to the truth.

    "right", "in part" (some of those that act, and no other) or "wrong" where effects are named,
    else the verdict.
    """
    if verdict != "named":
        return verdict
    acting = set(label["sizes"]) if label["kind"] in ("single", "pair") else set()
    if set(named) == acting:
        return "right"
    return "in part" if set(named) < acting else "wrong"


def truth_of(label: dict[str, Any]) -> frozenset[str]:
    """The true hypothesis as a set of names."""
    if label["kind"] in ("none", "outside"):
        return frozenset({"none" if label["kind"] == "none" else "unknown"})
    return frozenset(label["sizes"])


def _probability(probabilities: dict[str, float], wanted: frozenset[str]) -> float:
    return max(sum(p for k, p in probabilities.items() if frozenset(k.split("+")) == wanted), LEAST)


def _log_odds(probabilities: dict[str, float], pair: list[str]) -> float:
    first, second = (max(probabilities.get(name, 0.0), 1e-300) for name in pair)
    return float(np.log(first / second))


def judged(row: Row, parts: list[Possible], p: np.ndarray) -> Row:
    """The row with other probabilities, and the verdict on them.

    Whether a best hypothesis that was not the best before predicts held-out conditions no worse
    is judged by its own error there, without the predictive density.
    """
    probabilities = dict.fromkeys(row["probabilities"], 0.0)
    beside = {}
    for part, share in zip(parts, p, strict=True):
        probabilities[part.key] = probabilities.get(part.key, 0.0) + float(share)
        if part.beside is not None:
            beside[part.beside] = float(share)

    def effects(key: str) -> tuple[str, ...]:
        return () if key == "none" else tuple(key.split("+"))

    found = judge(
        probabilities,
        tuple(effect.id for effect in CATALOGUE),
        {effects(key): misfit for key, misfit in row["misfit"].items()},
        row["n_data"],
        row["n_unknowns"],
        {effects(key): share for key, share in beside.items()},
    )
    best = key_of(found.best)
    confirmed = row["confirmed"] if best == row["best"] else best not in row["worse"]
    if not confirmed:
        found = unconfirmed(found)
    return {
        **row,
        "probabilities": probabilities,
        "verdict": found.verdict,
        "named": list(found.named),
    }


def outcomes(
    row: Row,
    more: dict[str, Row],
    label: dict[str, Any],
    rng: np.random.Generator,
    moment: bool = False,
) -> dict[str, Followed]:
    """What every sensor brings to a case.

    Args:
        row: of `advice`.
        more: rows of the same record with a flow added, by sensor.
        label: what acts.
        rng: gives the errors of the readings.
        moment: whether the update heeds that the prior of a size vanishes at zero.
    """
    parts = parts_of(row)
    after = {}
    for sensor in READINGS:
        errors = errors_of(sensor)
        seen = {
            name: (true_reading(name, label["sizes"][name], row) if name in label["sizes"] else 0.0)
            + error * float(rng.standard_normal())
            for name, error in errors.items()
        }
        after[sensor] = judged(row, parts, updated(parts, seen, errors, moment))
    after |= more
    pairs = {sensor: pair for sensor, pair, _ in row["advice"]}
    truth = truth_of(label)
    before = row["probabilities"]

    def log_B(sensor: str, now: dict[str, float]) -> float | None:
        if sensor not in pairs:
            return None
        change = _log_odds(now, pairs[sensor]) - _log_odds(before, pairs[sensor])
        return float(np.clip(change, -MOST, MOST))

    return {
        sensor: Followed(
            log_B(sensor, new["probabilities"]),
            float(np.log(_probability(new["probabilities"], truth) / _probability(before, truth))),
            standing(new["verdict"], new["named"], label),
        )
        for sensor, new in after.items()
    }


def case_of(row: Row, more: dict[str, Row], label: dict[str, Any], seed: int) -> dict[str, Any]:
    """Everything that is kept of a case: promises, expectations and outcomes.

    Arguments are those of `outcomes`, and the seed of the readings' errors.
    """
    parts = parts_of(row)
    found = {
        kind: outcomes(row, more, label, np.random.default_rng([seed, row["case"]]), moment)
        for kind, moment in (("gaussian", False), ("moment", True))
    }
    return {
        "case": row["case"],
        "label": label,
        "before": standing(row["verdict"], row["named"], label),
        "advice": [_promise(row, option, truth_of(label)) for option in row["advice"]],
        "information": {
            sensor: expected_information(
                parts, sensor, np.random.default_rng([seed, row["case"], 1])
            )
            for sensor in READINGS
        },
        "outcomes": {
            kind: {sensor: one._asdict() for sensor, one in by.items()}
            for kind, by in found.items()
        },
    }


def _promise(row: Row, option: list[Any], truth: frozenset[str]) -> dict[str, Any]:
    """An advised measurement: what it promises, and which of its two hypotheses is true."""
    sensor, pair, promised = option
    first, second = (frozenset(name.split("+")) for name in pair)
    converse = None
    if sensor in READINGS:
        mean, sd, _ = row["sizes"][pair[0]][pair[0]]
        converse = converse_of(mean, sd, errors_of(sensor)[pair[0]])
    return {
        "sensor": sensor,
        "separates": pair,
        "promised": promised,
        "converse": converse,
        "acts": {first: "first", second: "second"}.get(truth, "neither"),
    }


def converse_of(mean: float, sd: float, error: float) -> float:
    """KL(j ‖ i) of a reading, see above, at most `MOST`."""
    wide = sd**2 + error**2
    found = 0.5 * np.log(wide / error**2) + 0.5 * (error**2 + mean**2) / wide - 0.5
    return float(min(found, MOST))


def followed(
    folder: pathlib.Path, levels: list[str], noise: float, first: int | None, seed: int
) -> dict[str, list[dict[str, Any]]]:
    """Cases of every level; diagnoses that are stored in the folder are not made again.

    Args:
        folder: of the benchmark.
        levels: richness of the records, of `advice.LEVELS`.
        noise: of the mean beat [mmHg].
        first: only so many cases.
        seed: of the readings' errors.
    """
    unknown = sorted(set(levels) - set(LEVELS))
    if unknown:
        raise SystemExit(f"No flow is added to {', '.join(unknown)}. Use {', '.join(LEVELS)}.")
    rows = {level: advised_rows(folder, noise, level, first) for level in levels}
    more = {
        level: {
            sensor: {
                row["case"]: row
                for row in advised_rows(folder, noise, kind, first, _wanting(rows[level], sensor))
            }
            for sensor, kind in LEVELS[level].items()
        }
        for level in levels
    }
    labels = unseal(folder)
    return {
        level: [
            case_of(
                row,
                {s: by[row["case"]] for s, by in more[level].items() if row["case"] in by},
                labels[row["case"]],
                seed,
            )
            for row in rows[level]
        ]
        for level in levels
    }


def _wanting(rows: list[Row], sensor: str) -> set[int]:
    """Cases that are advised a sensor in the first place."""
    return {row["case"] for row in rows if row["advice"] and row["advice"][0][0] == sensor}
