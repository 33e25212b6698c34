"""The document of the command `study`: all numbers of Algorithm 1 in 3D for one patient."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from jaxfsi.opening import OUTLET
from lumped.metrics import sampled_ifr
from study.case.condition import Condition
from study.case.laws import LINEAR, QUADRATIC
from study.case.parameters import WindkesselParameters
from study.report.body_words import body_notes, body_part, normal_bed_notes
from study.report.chosen_laws import chosen_laws, wall_without_columns
from study.report.documents.parts import AlphaCurve, notes
from study.report.documents.study import (
    AlphaEntry,
    Loop,
    LoopTrial,
    RatioRow,
    ReducedSensitivity,
    StudyDocument,
    StudyMesh,
    StudyWall,
)
from study.report.headline import Reading, headline, headline_numbers
from study.report.older_parts import older_parts
from study.report.pictures import Drawn
from study.report.remarks import interval_notes
from study.report.sensitivity_part import sensitivity_parts
from study.report.uncertainty_part import uncertainty_parts
from study.run.lumen_parts import measured_states
from study.run.patient import ratio_error
from study.run.results import Run3D
from study.run.study_parts import MeshErrorPart, Sensitivity
from study.run.study_result import StudyResult
from study.store.json_form import ABSENT
from study.store.layouts import FORMAT
from study.store.numerics import decided_by
from study.store.provenance import Provenance
from study.store.result_names import CALIBRATED, CURVE, FIXED, NOMINAL, PAPER

ORIGINS = {
    PAPER: "linear surrogate (the paper)",
    CURVE: "curve surrogate",
    NOMINAL: "nominal outlet (alpha = 1)",
}
"""Where the scale factor of a run comes from, in words."""

_LARGE_OFFSET_MMHG, _LARGE_FLOW_L_PER_MIN = 4.0, 60.0

MESH_BOUND = 0.1
"""Mesh error of R0 that deserves a warning."""

PERIODIC_MMHG = 1.0
"""Drift of the coronary bed in a run that counts as periodic."""


def study_document(
    result: StudyResult, drawn: Mapping[str, Drawn], films: list[str], provenance: Provenance
) -> StudyDocument:
    """The document of a study.

    Args:
        result: what it found.
        drawn: pictures by id of the run.
        films: ids of runs with an animation.
        provenance: see `study.store.provenance`.
    """
    case, mesh = result.case, result.mesh
    found = result.mesh_error
    older = [("info", text) for text in older_parts(result.computed)]
    return StudyDocument(
        format=FORMAT,
        kind="study",
        patient=case.id,
        rule=case.stress.rule,
        verdict=study_verdict(result),
        headline=headline_numbers(study_readings(result)),
        notes=notes([*_notes(result), *older]),
        rest_ratio_measured=case.conditions["rest"].ffr,
        ramp=result.ramp.part,
        calibrations=list(_calibrations(result)),
        loop=_loop(result),
        curves={
            law: AlphaCurve(curve.alpha.tolist(), curve.ratio.tolist())
            for law, curve in result.reduced.curves.items()
        },
        rows=list(_rows(result)),
        runs=result.runs,
        shown=[run.id for run in result.calibrated],
        motion=result.motion,
        measured_states=measured_states(case),
        sensitivities=list(_sensitivities(result)),
        fsi_sensitivities=list(sensitivity_parts(_differentiated(result), mesh, result.anatomy)),
        mesh=StudyMesh(len(mesh.points), len(mesh.tets), case.mesh.preset),
        wall=StudyWall(case.wall.E, case.wall.nu, case.wall.material),
        pictures={name: list(part.pictures) for name, part in drawn.items()},
        picture_times_s={name: part.times for name, part in drawn.items()},
        picture_notes=sorted({part.note for part in drawn.values() if part.note}),
        films=films,
        computed=result.computed,
        numerics=decided_by("study"),
        provenance=provenance,
        mesh_error=found if isinstance(found, MeshErrorPart) else ABSENT,
        uncertainty=(
            ABSENT
            if result.uncertainty is None
            else uncertainty_parts(result.uncertainty.found, QUADRATIC)
        ),
        body=body_part(case),
    )


def _loop(result: StudyResult) -> Loop:
    loop = result.loop
    return Loop(
        run=result.rest,
        alpha=loop.alpha,
        rest_ratio=loop.ratio,
        reached=loop.reached,
        extra_runs=loop.extra_runs,
        trials=[LoopTrial(*trial) for trial in loop.trials],
    )


def _differentiated(result: StudyResult) -> list[tuple[Run3D, Sensitivity]]:
    """Runs with their derivatives, where they were asked for."""
    found = result.sensitivities
    return [(run, found[run.id]) for run in result.runs if run.id in found]


def study_verdict(result: StudyResult) -> str:
    """The result in a few sentences."""
    loop, target = result.loop, result.case.conditions["rest"].ffr
    word = "meets" if loop.reached else "misses"
    rest = (
        f"At rest the 3D model has Pd/Pa {loop.ratio:.4f} and {word} the measured {target:.3f}"
        f" with alpha = {loop.alpha:.4g}."
    )
    readings = study_readings(result)
    first = (
        [headline(readings, what="FFR in 3D", concluded=result.uncertainty is None)]
        if readings
        else []
    )
    closed = [f"{name}: {text}" for name, text in result.collapsed.items()]
    return " ".join([*first, *closed, rest])


def study_readings(result: StudyResult) -> list[Reading]:
    """FFR in 3D of every condition under stress by every rule that was run, the own rule first."""
    own = _own_rule(result)
    runs = [run for run in result.calibrated if not run.is_rest]
    conditions = list(dict.fromkeys(run.condition for run in runs))
    found = []
    for run in sorted(runs, key=lambda r: (conditions.index(r.condition), r.rule != own)):
        entry, ratio = result.case.conditions[run.condition], _ratio(run)
        words, sd = f"rule {run.rule}", _ratio_sd(result, run, ratio)
        found.append(Reading(run.condition, words, ratio, sd, entry.ffr, ratio_error(entry)))
    return found


def _ratio(run: Run3D) -> float:
    assert run.ratio is not None, "a run of a study has whole cycles"
    return run.ratio


def _ratio_sd(result: StudyResult, run: Run3D, ratio: float) -> float:
    """Standard deviation of a ratio in 3D from the error of the resting ratio and what is missed.

    ∂ log FFR/∂ log Pd/Pa with α tuned again is that of the surrogate, the curve's where there is
    one: in 3D it would take runs with several α under stress.
    """
    rest = result.case.conditions["rest"]
    assert rest.ffr is not None
    laws = (QUADRATIC, LINEAR)
    mine = {
        r.law: r
        for r in result.reduced.runs
        if (r.condition, r.rule, r.boundary) == (run.condition, run.rule, CALIBRATED)
    }
    slope = next(abs(mine[law].recalibrated["rest_ratio"]) for law in laws if law in mine)
    return slope * math.hypot(ratio_error(rest), _miss(result)) / rest.ffr * ratio


def _own_rule(result: StudyResult) -> str:
    rules = result.choice.rules or (result.case.stress.rule,)
    own = result.case.stress.rule
    return own if own in rules else rules[0]


def _calibrations(result: StudyResult) -> Iterator[AlphaEntry]:
    """Fixed, linear surrogate, curve surrogate and 3D in the loop side by side."""
    target = result.case.conditions["rest"].ffr
    assert target is not None
    rest = [run for run in result.runs if run.is_rest]
    names = {NOMINAL: 0, PAPER: 1, CURVE: 2}
    for run in sorted(rest, key=lambda r: names.get(r.label, 3)):
        yield AlphaEntry(
            run=run.id,
            label=run.label,
            origin=ORIGINS.get(run.label, "corrected in 3D"),
            alpha=run.alpha,
            rest_ratio=run.ratio,
            error=None if run.ratio is None else run.ratio - target,
            best=run.id == result.rest,
            drift_mmHg=run.drift_mmHg,
        )


def _rows(result: StudyResult) -> Iterator[RatioRow]:
    """One row a condition and rule: measured, 0D and 3D, nominal and calibrated."""
    case, calibrated = result.case, {run.id for run in result.calibrated}
    sds = {(r.condition, r.words.removeprefix("rule ")): r.sd for r in study_readings(result)}
    settings = dict.fromkeys(
        (run.condition, run.rule) for run in sorted(result.runs, key=lambda r: not r.is_rest)
    )
    for condition, rule in settings:
        mine = [r for r in result.runs if (r.condition, r.rule) == (condition, rule)]
        best = next((run for run in mine if run.id in calibrated), None)
        nominal = next((run for run in mine if run.label == NOMINAL), None)
        reduced = {
            (law, boundary): _reduced(result, condition, rule, law, boundary)
            for law in result.reduced.calibrations
            for boundary in (CALIBRATED, FIXED)
        }
        yield RatioRow(
            condition=condition,
            rule=rule,
            measured=case.conditions[condition].ffr,
            linear_0d=reduced.get((LINEAR, CALIBRATED)),
            curve_0d=reduced.get((QUADRATIC, CALIBRATED)),
            curve_0d_nominal=reduced.get((QUADRATIC, FIXED)),
            fsi=None if best is None else best.ratio,
            fsi_sd=None if rule is None else sds.get((condition, rule)),
            fsi_nominal=None if nominal is None else nominal.ratio,
            flow_ml_per_min=None if best is None else best.distal.mean_Q_ml_per_min,
            **_wave_free(case.conditions[condition], best),
        )


def wave_free_ratio(run: Run3D) -> float | None:
    """Wave-free ratio (iFR) of the last whole cycle of a run in 3D [-]; None where it has none.

    Where the aortic pressure at the ostium was read, its mean offset to that at the inlet is added
    to the whole wave.
    """
    whole = [cycle for cycle in run.cycles if cycle.complete]
    if not whole:
        return None
    history = run.history
    waves = (history.t_s, history.P_aorta_mmHg, history.P_distal_mmHg)
    t, aorta, distal = (np.asarray(values) for values in waves)
    return sampled_ifr(t, aorta + whole[-1].site_offset, distal, run.period_s)


def _wave_free(entry: Condition, run: Run3D | None) -> dict[str, Any]:
    """Wave-free ratio at rest, as computed in 3D and as measured."""
    if entry.kind != "rest" or run is None:
        return {}
    measured = {} if entry.ifr is None else {"measured_ifr": entry.ifr}
    return {"ifr": wave_free_ratio(run), **measured}


def _reduced(
    result: StudyResult, condition: str, rule: str | None, law: str, boundary: str
) -> float | None:
    wanted = (condition, law, rule, boundary)
    for run in result.reduced.runs:
        if (run.condition, run.law, run.rule, run.boundary) == wanted:
            return run.ratio
    return None


def _sensitivities(result: StudyResult) -> Iterator[ReducedSensitivity]:
    """Of stress FFR, by the curve surrogate with α tuned at rest."""
    for run in result.reduced.runs:
        own = (run.law, run.rule, run.boundary) == (QUADRATIC, _own_rule(result), CALIBRATED)
        if own and run.condition != "rest":
            yield ReducedSensitivity(
                run.condition, run.rule, run.ratio, run.at_fixed_alpha, run.recalibrated
            )


def _notes(result: StudyResult) -> Iterator[tuple[str, str]]:
    ramp = result.ramp.part
    ratio = ramp.tangent_40_mmHg / ramp.secants_by_drop_mmHg["8"].secant
    yield (
        "info",
        f"the slope of the ramp at 40 mmHg is {ratio:.1f} times the resistance at a drop of 8 mmHg;"
        " the paper's linear surrogate uses that slope as the resistance at every drop",
    )
    laws = (*chosen_laws(result.case), *wall_without_columns(result.case, result.mesh))
    yield from (("info", text) for text in laws)
    yield from body_notes(result.case)
    yield from normal_bed_notes(result.case, result.mesh.openings, result.loop.alpha)
    if ramp.largest_drop_mmHg < 40.0:
        text = f"the ramp ends at {ramp.largest_drop_mmHg:.0f} mmHg: R0 at 40 is extrapolated"
        yield "warning", text
    yield _mesh_note(result)
    if not result.loop.reached:
        yield (
            "warning",
            f"the resting ratio in 3D misses the measured one by"
            f" {_miss(result):.4f} after"
            f" {result.loop.extra_runs} extra runs",
        )
    for run in result.runs:
        change = run.ratio_change
        if change is not None and change > 0.002:
            text = f"{run.folder}: the ratio still changes by {change:.4f} from cycle to cycle"
            yield "warning", f"{text}; take more cycles"
        elif change is None and (run.drift_mmHg or 0.0) > PERIODIC_MMHG:
            yield (
                "warning",
                f"{run.folder}: the pressures of the coronary bed drifted by up to"
                f" {run.drift_mmHg:.1f} mmHg over the single cycle; run two (--cycles 2) to see the"
                " effect on the ratio",
            )
        if run.repeated:
            yield (
                "info",
                f"{run.folder}: steps repeated with smaller ones after a failure: {run.repeated}",
            )
        yield from _aortic_flow(run, result.case.windkessel)
    for name, text in result.collapsed.items():
        yield "warning", f"{name} has no ratio: {text}"
    for name, reason in result.failures.items():
        yield "warning", f"{name} could not be differentiated: {reason}"
    yield from interval_notes(result.uncertainty)
    for law, reason in result.reduced.failures.items():
        yield "warning", f"the {law} surrogate could not be calibrated: {reason}"


def _mesh_note(result: StudyResult) -> tuple[str, str]:
    """How far the mesh moves the resistance, and with it the flow."""
    found = result.mesh_error
    if found is None:
        return (
            "info",
            "the mesh error of R0 and flow was not estimated; --mesh-error estimates it with a ramp"
            " on a second mesh",
        )
    if isinstance(found, str):
        return "warning", f"the mesh error could not be estimated: {found}"
    R0, flow = found.tangent_40_mmHg, found.rest_flow_ml_per_min
    text = (
        f"corrected for mesh error, R0 at 40 mmHg is {R0.expected:.0f} [{R0.low:.0f},"
        f" {R0.high:.0f}] dyn·s/cm⁵ instead of {R0.value:.0f}, and the flow at rest is"
        f" {flow.expected:.0f} [{flow.low:.0f}, {flow.high:.0f}] mL/min instead of"
        f" {flow.value:.0f}"
    )
    large = abs(R0.expected / R0.value - 1.0) > MESH_BOUND
    return ("warning", f"{text}: use a finer mesh for both") if large else ("info", text)


def _aortic_flow(run: Run3D, windkessel: WindkesselParameters) -> Iterator[tuple[str, str]]:
    """Flow in the aorta that no heart makes."""
    cycle = run.cycles[-1]
    offset, flow = cycle.site_offset, cycle.ports.get(OUTLET)
    if flow is None:
        return
    low, high = flow.least_Q_ml_per_min / 1000.0, flow.largest_Q_ml_per_min / 1000.0
    if abs(offset) < _LARGE_OFFSET_MMHG and max(-low, high) < _LARGE_FLOW_L_PER_MIN:
        return
    paper = windkessel.characteristic == "paper"
    cure = '; try characteristic = "impedance" below [windkessel]' if paper else ""
    yield (
        "warning",
        f"{run.folder}: ignore the flow in the aorta, {low:.0f} to {high:.0f} L/min: it is what the"
        " Windkessel draws under the prescribed pressure, not what a heart ejects. Its velocity"
        f" head makes the mean pressure at the ostium differ by {offset:.1f} mmHg from that at the"
        f" inlet{cure}",
    )


def _miss(result: StudyResult) -> float:
    target = result.case.conditions["rest"].ffr
    assert target is not None
    return abs(result.loop.ratio - target)
