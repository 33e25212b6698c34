"""What a diagnosis says of the lumen of a finished study: document and words."""

import dataclasses

import numpy as np

from calibration import lumen_law
from diagnosis.least_change import CORRELATION_LENGTH, half_axes
from diagnosis.reach import FARTHEST_PULL, RESISTANCE, Reach
from diagnosis.verdict import CLOSED_P
from lumped import ML_PER_MIN, MM
from study.report.documents.diagnose import DiagnoseDocument
from study.report.documents.least_change import (
    BoundaryReach,
    LeastLumenChange,
    LumenPart,
    WantedLoss,
)
from study.report.number_formats import significant
from study.run.diagnosis_lumen_parts import LumenReach, StudyLumen

CANNOT_EXCLUDE, FAR = 2.0, 3.0
"""Standard deviations of a scan up to which it leaves a change open, and from which it speaks
clearly against it."""

_SHOWN = 0.5  # of the largest change: where it is said to be
_SMALLEST_P = 1e-4


def with_lumen(document: DiagnoseDocument, found: LumenReach | str) -> DiagnoseDocument:
    """The document of a diagnosis with what it says of the lumen, or why it says nothing.

    Args:
        document: without it.
        found: what reaches the record, or why that is not known.
    """
    if isinstance(found, str):
        return dataclasses.replace(document, no_lumen=found)
    return dataclasses.replace(document, lumen=lumen_part(found))


def lumen_part(found: LumenReach) -> LumenPart:
    """What reaches a record, as its document holds it."""
    reach = found.reach
    change = None if found.change is None else _change(found)
    return LumenPart(
        study=found.known.study,
        sentence=" ".join(_sentences(found, change)),
        boundary=BoundaryReach(reach.boundary, reach.p_value, reach.pull),
        wanted=WantedLoss(
            factor=float(np.exp(reach.log_factor)),
            log_sd=reach.log_factor_sd,
            flow_ml_per_min=reach.flow / ML_PER_MIN,
            effects=[name for name in reach.hypothesis if name != RESISTANCE],
            explains=reach.free,
            p_value=reach.p_value_free,
        ),
        change=change,
    )


def _change(found: LumenReach) -> LeastLumenChange:
    known, least = found.known, found.change
    assert least is not None
    assert found.band is not None
    s, delta = np.asarray(known.lumen.s) / MM, np.asarray(least.delta_r) / MM
    every = np.concatenate([delta[None], np.asarray(found.band) / MM])
    before = lumen_law(known.lumen, mu=known.mu, rho=known.rho, area_upstream=known.area_upstream)
    at = int(np.argmax(np.abs(delta)))
    inside = delta * np.sign(delta[at]) >= _SHOWN * abs(delta[at])
    first, last = _run_about(inside, at)
    return LeastLumenChange(
        s_mm=_list(s),
        half_minor_mm=_list(half_axes(known.lumen)[:, 1] / MM),
        radius_mm=_list(np.sqrt(np.asarray(known.lumen.area) / np.pi) / MM),
        delta_r_mm=_list(delta),
        low_mm=_list(every.min(axis=0)),
        high_mm=_list(every.max(axis=0)),
        largest_mm=float(delta[at]),
        largest_s_mm=float(s[at]),
        from_mm=float(s[first]),
        to_mm=float(s[last]),
        course_mm=None if known.course is None else known.course / MM,
        course_mean_mm=_course_mean(known, delta),
        scan=known.scan,
        scan_sd_mm=known.sd / MM,
        correlation_mm=CORRELATION_LENGTH / MM,
        n_sd=float(least.n_sd),
        R0_factor=float(least.R0 / before.R0),
        K_factor=float(least.K / before.K),
    )


def _run_about(inside: np.ndarray, at: int) -> tuple[int, int]:
    """First and last place of the unbroken run about one of its places."""
    outside = np.flatnonzero(~inside)
    before, after = outside[outside < at], outside[outside > at]
    return (
        int(before[-1]) + 1 if before.size else 0,
        int(after[0]) - 1 if after.size else len(inside) - 1,
    )


def _course_mean(known: StudyLumen, delta: np.ndarray) -> float | None:
    """Mean change over the intramural course [mm]; None where nothing tells it."""
    s = np.asarray(known.lumen.s)
    if known.course is None or known.course <= s[0]:
        return None
    end = min(known.course, float(s[-1]))
    along = np.linspace(float(s[0]), end, 201)
    return float(np.interp(along, s, delta).mean())


def _sentences(found: LumenReach, change: LeastLumenChange | None) -> list[str]:
    reach = found.reach
    if reach.boundary:
        return [
            f"Boundary parameters alone fit the record ({_chance(reach.p_value)}, R0"
            f" {abs(reach.pull):.1f} sd from that of the study): no other lumen is needed."
        ]
    told = [f"Boundary parameters alone do not fit the record: {_why(reach)}."]
    if change is None:
        told.append(
            "Nor does another lumen: with R0 free the misfit is still more than noise"
            f" ({_chance(reach.p_value_free)}). Look for another cause."
        )
        return told
    told.append(_explaining(change))
    name, p = found.other
    if name:
        words = name.replace("_", " ").replace("+", " with ")
        told.append(
            f"The diagnosis finds another cause more probable: {words}, probability {p:.2f}."
        )
    return told


def _why(reach: Reach) -> str:
    reasons = []
    if reach.p_value <= CLOSED_P:
        reasons.append(
            f"the misfit of the base model is more than noise ({_chance(reach.p_value)})"
        )
    if abs(reach.pull) > FARTHEST_PULL:
        reasons.append(
            f"R0 would lie {abs(reach.pull):.1f} of its standard deviations from that of the study"
        )
    return ", and ".join(reasons)


def _explaining(change: LeastLumenChange) -> str:
    """What the change is, and what the scan says of it."""
    kind = "narrowing" if change.largest_mm < 0.0 else "widening"
    scan = {"the case": "as given in the case"}.get(change.scan, f"by {change.scan}")
    size = (
        f"A {kind} of the half-axes by up to {abs(change.largest_mm):.2f} mm, most of it"
        f" {change.from_mm:.1f} to {change.to_mm:.1f} mm from the ostium, would explain it. The"
        f" half-axes are known to {change.scan_sd_mm:.2g} mm (sd, {scan}); the change as a whole is"
        f" {change.n_sd:.1f} standard deviations from the scan: "
    )
    if change.n_sd <= CANNOT_EXCLUDE:
        return f"{size}the image cannot exclude it."
    if change.n_sd <= FAR:
        return f"{size}the image speaks against it, but not clearly."
    return f"{size}the image excludes it, so look for another cause."


def _chance(p: float) -> str:
    return f"p < {_SMALLEST_P:g}" if p < _SMALLEST_P else f"p = {significant(p, 2)}"


def _list(values: object) -> list[float]:
    return [float(f"{value:.5g}") for value in np.asarray(values).tolist()]
