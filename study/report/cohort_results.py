"""The document of the command `cohort`: predicted and measured ratios, patient by patient.

| boundary | meaning |
|---|---|
| fixed | nominal outlet, α = 1 for everybody |
| calibrated | α tuned to the measured resting ratio; in mode `3d` with the 3D model in the loop |
| fixed, 0D | in mode `3d`: nominal outlet behind the curve of the ramp in 0D |
| linear, curve | at rest in mode `3d`: the ratio in 3D with the α of either surrogate alone |

A ratio that was not measured is predicted all the same; it has no part in the agreement.

What calibration changes is told of the patients that have both boundaries: from `fixed` in 3D where
such runs were made (`--nominal`), and from `fixed, 0D`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from study.case.anatomy import SyntheticAnatomy
from study.case.model import Case
from study.report.agreement import Agreement, agreement
from study.report.cohort_rows import BOUNDARIES, LABELS, Pair, place_of
from study.report.documents.cohort import (
    CohortChange,
    CohortDocument,
    CohortGroup,
    CohortInterval,
    CohortPatient,
)
from study.run.members import MemberResult
from study.store.document_rows import ratio_name
from study.store.json_form import ABSENT
from study.store.layouts import FORMAT
from study.store.options import Mode
from study.store.provenance import Provenance
from study.store.result_names import CALIBRATED, FIXED, FIXED_0D
from study.store.stored_document import readable

Document = dict[str, Any]


def cohort_document(
    results: Sequence[MemberResult],
    cases: Mapping[str, Case],
    mode: Mode,
    provenance: Provenance,
) -> CohortDocument:
    """The document of a cohort.

    Args:
        results: what became of each case.
        cases: the case of each member by its name.
        mode: how they were run.
        provenance: command, versions, date.

    Raises:
        CaseError: a part of the document of a case is missing or damaged.
    """
    pairs: list[Pair] = []
    patients: list[CohortPatient] = []
    intervals: list[CohortInterval] = []
    for result in results:
        case = cases[result.member.name]
        found, patient, own = readable(
            result.member.folder,
            result.document or {},
            lambda result=result, case=case: (
                list(_pairs(result, case, mode)) if result.document else [],
                _patient(result, case, mode),
                list(_intervals(result, case)),
            ),
        )
        pairs += found
        patients.append(patient)
        intervals += own
    compared = [pair for pair in pairs if pair.measured is not None]
    return CohortDocument(
        format=FORMAT,
        kind="cohort",
        mode=mode,
        patients=patients,
        pairs=pairs,
        groups=list(_groups(compared)),
        changes=list(_changes(compared)),
        provenance=provenance,
        intervals=intervals or ABSENT,
    )


def side_of(case: Case) -> str | None:
    """Which artery is anomalous, where the case says so."""
    return case.anatomy.side if isinstance(case.anatomy, SyntheticAnatomy) else None


def _patient(result: MemberResult, case: Case, mode: Mode) -> CohortPatient:
    document = result.document
    alpha, extra = None, None
    if document is not None:
        alpha = document["loop"]["alpha"] if mode == "3d" else _own_alpha(document)
        extra = document["loop"]["extra_runs"] if mode == "3d" else None
    origin = (document or {}).get("provenance", {})
    return CohortPatient(
        name=result.member.name,
        side=side_of(case),
        status=result.status,
        reason=result.reason,
        seconds=result.seconds,
        alpha=alpha,
        extra_runs=extra,
        kept=result.kept,
        date=origin.get("date"),
        commit=origin.get("commit"),
    )


def _intervals(result: MemberResult, case: Case) -> Iterator[CohortInterval]:
    """Intervals of a patient's FFR, where they were asked for."""
    for entry in (result.document or {}).get("uncertainty", []):
        low, high = entry["interval_90"]
        yield CohortInterval(
            patient=result.member.name,
            side=side_of(case),
            condition=entry["condition"],
            measured=case.conditions[entry["condition"]].ffr,
            median=entry["median"],
            low=low,
            high=high,
            chance_at_or_below_threshold=entry["chance_at_or_below_threshold"],
        )


def _own_alpha(document: Document) -> float | None:
    fit = document["calibrations"].get(document["law"]) or {}
    return fit.get("alpha")


def _pairs(result: MemberResult, case: Case, mode: Mode) -> Iterator[Pair]:
    side, document = side_of(case), result.document
    assert document is not None
    values = _of_study(document) if mode == "3d" else _of_run(document)
    for condition, rule, boundary, predicted in values:
        entry = case.conditions.get(condition)
        if entry is not None and predicted is not None:
            yield Pair(
                result.member.name, side, condition, rule, boundary, float(predicted), entry.ffr
            )


_Value = tuple[str, str | None, str, float | None]


def _of_study(document: Document) -> Iterator[_Value]:
    for row in document["rows"]:
        yield row["condition"], row["rule"], CALIBRATED, row["fsi"]
        yield row["condition"], row["rule"], FIXED, row["fsi_nominal"]
        yield row["condition"], row["rule"], FIXED_0D, row["curve_0d_nominal"]
    for entry in document["calibrations"]:
        if entry["label"] in LABELS:
            yield "rest", None, LABELS[entry["label"]], entry["rest_ratio"]


def _of_run(document: Document) -> Iterator[_Value]:
    for run in document["runs"]:
        if run["law"] == document["law"]:
            ratio = run[ratio_name(run["condition"])]
            yield run["condition"], run["rule"], run["boundary"], ratio


def _groups(pairs: Sequence[Pair]) -> Iterator[CohortGroup]:
    """Agreement of each condition, rule and boundary."""
    settings = dict.fromkeys((p.condition, p.rule, p.boundary) for p in pairs)

    def place(setting: tuple[str, str | None, str]) -> tuple[Any, ...]:
        condition, rule, boundary = setting
        return *place_of((condition, rule)), BOUNDARIES.index(boundary)

    for condition, rule, boundary in sorted(settings, key=place):
        mine = [
            p for p in pairs if (p.condition, p.rule, p.boundary) == (condition, rule, boundary)
        ]
        found = _agreement(mine)
        yield CohortGroup(
            condition=condition,
            rule=rule,
            boundary=boundary,
            n=found.n,
            bias=found.bias,
            sd=_finite(found.sd),
            low=_finite(found.low),
            high=_finite(found.high),
            rmse=found.rmse,
            r=_finite(found.r),
            bias_95=_finite(found.bias_95),
            limit_95=_finite(found.limit_95),
            largest_error=max(abs(e) for e in _errors(mine)),
        )


def _agreement(pairs: Sequence[Pair]) -> Agreement:
    """Agreement of pairs that were all measured."""
    measured = [p.measured for p in pairs if p.measured is not None]
    return agreement([p.predicted for p in pairs], measured)


def _errors(pairs: Sequence[Pair]) -> list[float]:
    return [p.predicted - p.measured for p in pairs if p.measured is not None]


def _finite(value: float) -> float | None:
    """A number; None where there is none, as JSON has no nan."""
    return value if math.isfinite(value) else None


def _changes(pairs: Sequence[Pair]) -> Iterator[CohortChange]:
    """RMSE, bias and spread from a fixed to the calibrated boundary, over patients with both."""
    by: dict[tuple[str, str | None, str], dict[str, Pair]] = {}
    for p in pairs:
        by.setdefault((p.condition, p.rule, p.boundary), {})[p.patient] = p
    for condition, rule in sorted({(p.condition, p.rule) for p in pairs}, key=place_of):
        tuned = by.get((condition, rule, CALIBRATED), {})
        for boundary in (FIXED, FIXED_0D):
            fixed = by.get((condition, rule, boundary), {})
            both = [name for name in fixed if name in tuned]
            if not both:
                continue
            before, after = (_agreement([part[n] for n in both]) for part in (fixed, tuned))
            yield CohortChange(
                condition=condition,
                rule=rule,
                boundary=boundary,
                n=len(both),
                rmse_fixed=before.rmse,
                rmse_calibrated=after.rmse,
                rmse_change=after.rmse / before.rmse - 1.0 if before.rmse > 0.0 else None,
                bias_fixed=before.bias,
                bias_calibrated=after.bias,
                sd_fixed=_finite(before.sd),
                sd_calibrated=_finite(after.sd),
            )
