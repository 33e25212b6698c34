"""The advised next measurement, made by the generator, and what it brings.

1. The records are diagnosed, and again with each flow added (`advice`); no label is opened.
2. The labels are opened. The generator draws the readings of every sensor of every case, the
   probabilities follow (`readings`) and go to the diagnosis's own rules for a verdict. A flow is
   followed by the second diagnosis.

Promised is KL(i ‖ j), the expected ln B of an effect i over a rival j if i acts. Realised is the
change of ln p(i)/p(j), cut at ±`MOST` as promises are. If j acts, ln p(j)/p(i) is expected to grow
by KL(j ‖ i), which a size that is hardly known makes much smaller:

    KL(j ‖ i) = ½ ln(1 + s²/σ²) + ½ (σ² + m²)/(s² + σ²) − ½.

The control is the mean over all other sensors of the list. "Most information" follows the reading
of `readings.expected_information`.
"""

import pathlib
from typing import Any, NamedTuple

import numpy as np

from benchmarks.blind.advice import LEVELS, Row, advised_rows
from benchmarks.blind.cases import unseal
from benchmarks.blind.readings import (
    Part,
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


class Outcome(NamedTuple):
    """What one measurement brought to one case.

    Attributes:
        log_B: change of ln p(i)/p(j), i and j being what the first advice separates.
        information: change of ln p of the truth.
        standing: of the verdict, see `standing`.
    """

    log_B: float
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


def judged(row: Row, parts: list[Part], p: np.ndarray) -> Row:
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
) -> dict[str, Outcome]:
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
    pair = row["advice"][0][1] if row["advice"] else ["none", "none"]
    truth = truth_of(label)
    p = np.log(_probability(row["probabilities"], truth))
    return {
        sensor: Outcome(
            float(np.clip(_log_odds(new["probabilities"], pair)
                          - _log_odds(row["probabilities"], pair), -MOST, MOST)),
            float(np.log(_probability(new["probabilities"], truth)) - p),
            standing(new["verdict"], new["named"], label),
        )
        for sensor, new in after.items()
    }  # fmt: skip


def case_of(row: Row, more: dict[str, Row], label: dict[str, Any], seed: int) -> dict[str, Any]:
    """Everything that is kept of a case: promises, expectations and outcomes.

    Arguments are those of `outcomes`, and the seed of the readings' errors.
    """
    parts = parts_of(row)
    promised = row["advice"]
    row = {**row, "advice": [one for one in promised if one[0] in READINGS or one[0] in more]}
    information = {
        sensor: expected_information(parts, sensor, np.random.default_rng([seed, row["case"], 1]))
        for sensor in READINGS
    }
    found = {
        kind: outcomes(
            row, more, label, np.random.default_rng([seed, row["case"]]), kind == "moment"
        )
        for kind in ("gaussian", "moment")
    }
    acts = truth_of(label)
    which = "nothing"
    if row["advice"]:
        first, second = (frozenset(name.split("+")) for name in row["advice"][0][1])
        which = {first: "first", second: "second"}.get(acts, "neither")
    return {
        "case": row["case"],
        "label": label,
        "before": standing(row["verdict"], row["named"], label),
        "advice": row["advice"],
        "left_out": len(promised) - len(row["advice"]),
        "acts": which,
        "converse": _converse(row),
        "information": information,
        "outcomes": {
            kind: {sensor: one._asdict() for sensor, one in by.items()}
            for kind, by in found.items()
        },
    }


def _converse(row: Row) -> float | None:
    """KL(j ‖ i) of the first advice, see above; None for a flow."""
    if not row["advice"] or row["advice"][0][0] not in READINGS:
        return None
    sensor, (effect, _), _ = row["advice"][0]
    mean, sd, _ = row["sizes"][effect][effect]
    sigma = errors_of(sensor)[effect]
    wide = sd**2 + sigma**2
    kl = 0.5 * np.log(wide / sigma**2) + 0.5 * (sigma**2 + mean**2) / wide - 0.5
    return float(min(kl, MOST))


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
    kinds = dict.fromkeys([*levels, *(kind for level in levels for kind in LEVELS[level].values())])
    rows = {kind: advised_rows(folder, noise, kind, first) for kind in kinds}
    labels = unseal(folder)
    found = {}
    for level in levels:
        more = {
            sensor: {row["case"]: row for row in rows[kind]}
            for sensor, kind in LEVELS[level].items()
        }
        found[level] = [
            case_of(row, {s: by[k] for s, by in more.items() if k in by}, labels[k], seed)
            for row in rows[level]
            for k in (row["case"],)
        ]
    return found
