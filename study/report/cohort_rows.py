"""Predicted ratios of a cohort beside the measured ones, and the order of their rows."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from study.run.limits import FFR_THRESHOLD
from study.store.result_names import CALIBRATED, CURVE, FIXED, FIXED_0D, PAPER

LABELS = {PAPER: "linear", CURVE: "curve"}
"""Boundaries of runs at rest, by what their α comes from."""

BOUNDARIES = (FIXED, FIXED_0D, *LABELS.values(), CALIBRATED)
"""In the order of tables."""

ORDER = ("rest", "adenosine", "dobutamine")
"""Conditions in the order of the paper's figures; others follow."""


class Pair(NamedTuple):
    """A predicted ratio beside the measured one.

    Attributes:
        patient: name of the case.
        side: `left` or `right`; None where the case does not say.
        condition: name of the condition.
        rule: stress rule; None at rest.
        boundary: one of `BOUNDARIES`, see `study.report.cohort_results`.
        predicted: ratio [-].
        measured: ratio [-]; None where none was measured.
    """

    patient: str
    side: str | None
    condition: str
    rule: str | None
    boundary: str
    predicted: float
    measured: float | None


def pair_rows(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The pairs of a cohort's document, all predictions of a patient and condition in one row."""
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for pair in document["pairs"]:
        p = Pair(**pair)
        row = {"patient": p.patient, "condition": p.condition, "rule": p.rule}
        row |= {"measured": p.measured, "predicted": {}}
        key = (*place_of((p.condition, p.rule)), p.patient)
        found.setdefault(key, row)["predicted"][p.boundary] = p.predicted
    return [found[key] for key in sorted(found)]


def limit_counts(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Of each stress condition and rule the patients with a calibrated FFR at or below 0.80."""
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in pair_rows(document):
        if row["rule"] is not None and CALIBRATED in row["predicted"]:
            found.setdefault((row["condition"], row["rule"]), []).append(row)
    return [
        {
            "condition": condition,
            "rule": rule,
            "n": len(rows),
            "patients": [
                row["patient"] for row in rows if row["predicted"][CALIBRATED] <= FFR_THRESHOLD
            ],
        }
        for (condition, rule), rows in found.items()
    ]


def place_of(setting: tuple[str, str | None]) -> tuple[Any, ...]:
    """Conditions in the paper's order, others by name."""
    condition, rule = setting
    at = ORDER.index(condition) if condition in ORDER else len(ORDER)
    return at, condition, rule or ""
