"""The document of the command `cohort`: predicted and measured ratios, patient by patient.

| boundary | meaning |
|---|---|
| fixed | nominal outlet, α = 1 for everybody |
| calibrated | α tuned to the measured resting ratio; in mode `3d` with the 3D model in the loop |
| fixed, 0D | in mode `3d`: nominal outlet behind the curve of the ramp in 0D |
| linear, curve | at rest in mode `3d`: the ratio in 3D with the α of either surrogate alone |

What calibration changes is told of the patients that have both boundaries: from `fixed` in 3D where
such runs were made (`--nominal`), and from `fixed, 0D`.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from study.case.anatomy import SyntheticAnatomy
from study.case.faults import CaseError
from study.case.laws import QUADRATIC
from study.case.model import Case
from study.case.read import read_case
from study.report.agreement import Agreement, agreement
from study.run.cohort import Fate
from study.run.results import CURVE, PAPER
from study.store.document_rows import CALIBRATED, FIXED, ratio_name
from study.store.json_form import as_json
from study.store.layouts import FORMAT
from study.store.options import Mode
from study.store.provenance import Provenance
from study.store.stored_document import readable

Document = dict[str, Any]

FIXED_0D = "fixed, 0D"

_LABELS = {PAPER: "linear", CURVE: "curve"}
BOUNDARIES = (FIXED, FIXED_0D, *_LABELS.values(), CALIBRATED)
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
        boundary: see above.
        predicted: ratio [-].
        measured: ratio [-].
    """

    patient: str
    side: str | None
    condition: str
    rule: str | None
    boundary: str
    predicted: float
    measured: float


def cohort_document(fates: Sequence[Fate], mode: Mode, provenance: Provenance) -> Document:
    """The document of a cohort.

    Args:
        fates: what became of each case.
        mode: how they were run.
        provenance: command, versions, date.

    Raises:
        CaseError: a part of the document of a case is missing or damaged.
    """
    pairs: list[Pair] = []
    patients: list[Document] = []
    for fate in fates:
        found, patient = readable(
            fate.member.folder,
            fate.document or {},
            lambda fate=fate: (
                list(_pairs(fate, mode)) if fate.document else [],
                _patient(fate, mode),
            ),
        )
        pairs += found
        patients.append(patient)
    groups = list(_groups(pairs))
    return {
        "format": FORMAT,
        "kind": "cohort",
        "mode": mode,
        "patients": patients,
        "pairs": [pair._asdict() for pair in pairs],
        "groups": groups,
        "changes": list(_changes(pairs)),
        "provenance": as_json(provenance),
    }


def side_of(case: Case) -> str | None:
    """Which artery is anomalous, where the case says so."""
    return case.anatomy.side if isinstance(case.anatomy, SyntheticAnatomy) else None


def _patient(fate: Fate, mode: Mode) -> Document:
    document = fate.document
    side = None
    try:
        side = side_of(read_case(fate.member.path))
    except CaseError:
        pass
    alpha, extra = None, None
    if document is not None:
        alpha = document["loop"]["alpha"] if mode == "3d" else _own_alpha(document)
        extra = document["loop"]["extra_runs"] if mode == "3d" else None
    return {
        "name": fate.member.name,
        "side": side,
        "status": fate.status,
        "reason": fate.reason,
        "seconds": fate.seconds,
        "alpha": alpha,
        "extra_runs": extra,
        "kept": fate.kept,
        **{name: (document or {}).get("provenance", {}).get(name) for name in ("date", "commit")},
    }


def _own_alpha(document: Document) -> float | None:
    fit = document["calibrations"].get(QUADRATIC) or {}
    return fit.get("alpha")


def _pairs(fate: Fate, mode: Mode) -> Iterator[Pair]:
    case = read_case(fate.member.path)
    side, document = side_of(case), fate.document
    assert document is not None
    values = _of_study(document) if mode == "3d" else _of_run(document)
    for condition, rule, boundary, predicted in values:
        entry = case.conditions.get(condition)
        if entry is not None and entry.ffr is not None and predicted is not None:
            yield Pair(
                fate.member.name, side, condition, rule, boundary, float(predicted), entry.ffr
            )


_Value = tuple[str, str | None, str, float | None]


def _of_study(document: Document) -> Iterator[_Value]:
    for row in document["rows"]:
        yield row["condition"], row["rule"], CALIBRATED, row["fsi"]
        yield row["condition"], row["rule"], FIXED, row["fsi_nominal"]
        yield row["condition"], row["rule"], FIXED_0D, row["curve_0d_nominal"]
    for entry in document["calibrations"]:
        if entry["label"] in _LABELS:
            yield "rest", None, _LABELS[entry["label"]], entry["rest_ratio"]


def _of_run(document: Document) -> Iterator[_Value]:
    for run in document["runs"]:
        if run["law"] == document["law"]:
            ratio = run[ratio_name(run["condition"])]
            yield run["condition"], run["rule"], run["boundary"], ratio


def pair_rows(document: Document) -> list[Document]:
    """The pairs of a cohort's document, all predictions of a patient and condition in one row."""
    found: dict[tuple[Any, ...], Document] = {}
    for pair in document["pairs"]:
        p = Pair(**pair)
        row = {"patient": p.patient, "condition": p.condition, "rule": p.rule}
        row |= {"measured": p.measured, "predicted": {}}
        key = (*_place((p.condition, p.rule)), p.patient)
        found.setdefault(key, row)["predicted"][p.boundary] = p.predicted
    return [found[key] for key in sorted(found)]


def _groups(pairs: Sequence[Pair]) -> Iterator[Document]:
    """Agreement of each condition, rule and boundary."""
    settings = dict.fromkeys((p.condition, p.rule, p.boundary) for p in pairs)

    def place(setting: tuple[str, str | None, str]) -> tuple[Any, ...]:
        condition, rule, boundary = setting
        return *_place((condition, rule)), BOUNDARIES.index(boundary)

    for condition, rule, boundary in sorted(settings, key=place):
        mine = [
            p for p in pairs if (p.condition, p.rule, p.boundary) == (condition, rule, boundary)
        ]
        found = agreement([p.predicted for p in mine], [p.measured for p in mine])
        yield {
            "condition": condition,
            "rule": rule,
            "boundary": boundary,
            **_numbers(found),
            "largest_error": max(abs(p.predicted - p.measured) for p in mine),
        }


def _numbers(found: Agreement) -> Document:
    """Its numbers; None where there is none, as JSON has no nan."""
    return {
        name: value if math.isfinite(value) else None for name, value in found._asdict().items()
    }


def _changes(pairs: Sequence[Pair]) -> Iterator[Document]:
    """RMSE, bias and spread from a fixed to the calibrated boundary, over patients with both."""
    by: dict[tuple[str, str | None, str], dict[str, Pair]] = {}
    for p in pairs:
        by.setdefault((p.condition, p.rule, p.boundary), {})[p.patient] = p
    for condition, rule in sorted({(p.condition, p.rule) for p in pairs}, key=_place):
        tuned = by.get((condition, rule, CALIBRATED), {})
        for boundary in (FIXED, FIXED_0D):
            fixed = by.get((condition, rule, boundary), {})
            both = [name for name in fixed if name in tuned]
            if not both:
                continue
            before, after = (
                agreement([part[n].predicted for n in both], [part[n].measured for n in both])
                for part in (fixed, tuned)
            )
            yield {
                "condition": condition,
                "rule": rule,
                "boundary": boundary,
                "n": len(both),
                "rmse_fixed": before.rmse,
                "rmse_calibrated": after.rmse,
                "rmse_change": after.rmse / before.rmse - 1.0 if before.rmse > 0.0 else None,
                "bias_fixed": before.bias,
                "bias_calibrated": after.bias,
                "sd_fixed": _numbers(before)["sd"],
                "sd_calibrated": _numbers(after)["sd"],
            }


def _place(setting: tuple[str, str | None]) -> tuple[Any, ...]:
    """Conditions in the paper's order, others by name."""
    condition, rule = setting
    at = ORDER.index(condition) if condition in ORDER else len(ORDER)
    return at, condition, rule or ""
