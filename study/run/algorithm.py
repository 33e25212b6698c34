"""Algorithm 1 in 3D: ramp, surrogates, α with the 3D model in the loop, rest and stress.

1. Ramp of the pressure drop in 3D; R0 = its slope at 40 mmHg (the paper), and its whole curve.
2. α of the linear and of the quadratic surrogate at the measured resting ratio.
3. 3D at rest with each, then with α corrected until the ratio in 3D is the measured one.
4. 3D under every stress condition and rule; with the nominal outlet too, where asked for.
5. Where asked for, what moves the ratios of the calibrated runs (`study.run.sensitivity`), and the
   ramp on a second mesh (`study.run.mesh_error`).

Every step is a stage that is kept (`study.store.stages`): the same call goes on where it was ended.

Source: Puelz et al. 2024, algorithm 1; step 3 is ours.
"""

import contextlib
import math
import pathlib
from collections.abc import Sequence
from typing import Any

from calibration import (
    MOST_EXTRA_RUNS,
    RATIO_TOLERANCE,
    LoopFit,
    calibrate_in_loop,
)
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import read_series
from jaxfsi.fields.lumen_sections import lumen_motion
from study.case.laws import LINEAR, QUADRATIC
from study.case.model import Case
from study.run.anatomy_source import states_of
from study.run.computed_parts import computed_parts
from study.run.drawn_runs import drawn_step, runs_beside_0d
from study.run.expected_times import (
    COMPILE_SECONDS,
    PREPARE_SECONDS,
    STEP_SECONDS,
    march_seconds,
)
from study.run.fitted_ramp import FittedRamp, fitted
from study.run.lumen_parts import motion_part
from study.run.mesh import planned_steps
from study.run.mesh_error import compared, fineness
from study.run.pipeline import run_case
from study.run.prepare_ahead import prepared_ahead
from study.run.progress import Progress
from study.run.ramp import ramp_key, ramp_plan, ramp_record
from study.run.ramp_losses import ramp_losses
from study.run.ratio_uncertainty import uncertain_ratios
from study.run.reduced_results import CaseResult, Intervals
from study.run.results import PlannedRun, Run3D, RunId, calibrated_runs
from study.run.run_3d import LumenCollapsed, fsi_run, run_key
from study.run.run_context import RunContext
from study.run.second_mesh import SECOND, SECOND_RAMP, second
from study.run.sensitivity import run_sensitivity
from study.run.setup import STEP
from study.run.study_choice import RampChoice, StudyChoice
from study.run.study_context import check_study, open_context, with_curve
from study.run.study_parts import MeshErrorPart, MotionPart, Sensitivity
from study.run.study_result import StudyResult
from study.store.json_form import as_json, from_json
from study.store.result_files import FIELD_FOLDER, STAGE_FOLDER
from study.store.result_names import CURVE, LOOP, NOMINAL, PAPER, RAMP
from study.store.stages import stage_key


def run_study(
    case: Case, folder: pathlib.Path, choice: StudyChoice, *, progress: Progress | None = None
) -> StudyResult:
    """Run the algorithm, or what is left of it.

    Args:
        case: the case.
        folder: where stages and runs are kept.
        choice: how it is made.
        progress: told of each step.

    Raises:
        CaseError: the case lacks something, or cannot be calibrated.
        RuntimeError: a computation failed; cause and cure.
        KeyboardInterrupt: the user interrupted a run; everything before is kept.
    """
    check_study(case, choice)
    progress = progress or Progress()
    progress.plan(study_steps(case, choice))
    # where a ramp was kept, the calibration follows at once: nothing is left to be beside
    begun = any((folder / STAGE_FOLDER).glob(f"{RAMP}.*"))
    with contextlib.nullcontext() if begun else prepared_ahead(case) as rest:
        context, anatomy = open_context(case, folder, choice.run, progress)
        progress.step(RAMP)
        record = ramp_record(context, choice.ramp, rest)
    dt = ramp_plan(context, choice.ramp).dt
    losses = ramp_losses(context, ramp_key(context, choice.ramp), dt)
    ramp = fitted(record, choice.ramp, losses)
    context = with_curve(context, float(ramp.fit.law.R0), float(ramp.fit.law.K))
    progress.step("calibrating in 0D")
    reduced = run_case(context.case)
    coarse = None
    if choice.mesh_error and anatomy is not None:
        coarse = _mesh_error(context, anatomy, choice.ramp, ramp)
    loop, runs = _calibrated(context, choice, reduced)
    best = runs[loop.best]
    stressed, collapsed = _stressed(context, choice, best)
    runs += stressed
    uncertain = _uncertain(context, choice, reduced, best, stressed)
    shown = calibrated_runs(runs, best.id)
    progress.step("measuring the lumen")
    motion = {} if anatomy is None else _motion(context, anatomy, shown)
    found, failures = _sensitivities(context, choice, shown)
    return StudyResult(
        case=context.case,
        mesh=context.mesh,
        anatomy=anatomy,
        folder=folder,
        choice=choice,
        ramp=ramp,
        reduced=reduced,
        loop=loop,
        rest=best.id,
        runs=runs,
        motion=motion,
        sensitivities=found,
        failures=failures,
        collapsed=collapsed,
        computed=computed_parts(context, [run.id for run in runs], list(found)),
        mesh_error=coarse,
        uncertainty=uncertain,
    )


def study_steps(case: Case, choice: StudyChoice) -> dict[str, float]:
    """Steps of a study with the seconds that each usually takes."""
    dt, preset = choice.run.dt or case.solver.dt or STEP, case.mesh.preset

    def seconds(condition: str) -> float:
        steps = case.conditions[condition].period / dt * choice.run.cycles
        return 5.0 + steps * STEP_SECONDS[preset]

    ramp = march_seconds(preset, math.ceil(choice.ramp.drop / choice.ramp.rate / dt))
    plan = {**planned_steps(case, states_of(case)[:1]), RAMP: PREPARE_SECONDS[preset] + ramp}
    plan["calibrating in 0D"] = 10.0
    if choice.mesh_error:
        plan[SECOND_RAMP] = plan[RAMP]
    for run in planned_runs(case, choice):
        plan[run_step(run)] = seconds(run.condition)
    for condition in {} if choice.drawn is None else case.conditions:
        if condition != "rest":
            for k in range(choice.drawn or 0):
                plan[drawn_step(condition, k + 1)] = seconds(condition)
            plan[f"uncertainty, {condition}"] = 20.0
    for condition in choice.sensitivities:
        plan[f"derivatives: {condition}"] = 2.0 * COMPILE_SECONDS[preset] + 8.0 * seconds(condition)
    return {**plan, "measuring the lumen": 3.0, "drawing": 10.0, "writing the report": 3.0}


def _mesh_error(
    context: RunContext, anatomy: Anatomy, choice: RampChoice, ramp: FittedRamp
) -> MeshErrorPart | str:
    """What the ramp on a second mesh says; or why there is none, for which no study ends."""
    try:
        case, folder = second(context.case), context.folder / SECOND
        there, _ = open_context(case, folder, context.choice, context.progress)
        context.progress.step(SECOND_RAMP)
        other = fitted(ramp_record(there, choice), choice).fit
        across = fineness(context.mesh, anatomy), fineness(there.mesh, anatomy)
        return compared(context.case, (ramp.fit, other), across, len(there.mesh.tets))
    except (ValueError, RuntimeError) as error:
        return " ".join(str(error).split())


def planned_runs(case: Case, choice: StudyChoice) -> list[RunId]:
    """The runs of a study but for corrections of α beyond the first, in their order."""
    rest = [*([PAPER] if choice.paper else []), CURVE, f"{LOOP}1"]
    rest += [NOMINAL] if choice.nominal else []
    stressed = [RunId(*names) for names in _stress_names(case, choice)]
    return [*(RunId(label, "rest") for label in rest), *stressed]


def run_step(run: RunId) -> str:
    """The step of a run, in words."""
    words = {PAPER: "linear surrogate", CURVE: "curve", NOMINAL: "alpha = 1", LOOP: "calibrated"}
    origin = words.get(run.label, "corrected")
    return f"3D: {run.condition}, {origin}" + (f", rule {run.rule}" if run.rule else "")


def _stress_names(case: Case, choice: StudyChoice) -> list[tuple[str, str, str]]:
    """Label, condition and rule of each run under stress."""
    rules = choice.rules or (case.stress.rule,)
    labels = (LOOP, NOMINAL) if choice.nominal else (LOOP,)
    stresses = [name for name in case.conditions if name != "rest"]
    return [(label, name, rule) for name in stresses for rule in rules for label in labels]


def _told_run(context: RunContext, run: PlannedRun, before: PlannedRun | None = None) -> Run3D:
    context.progress.step(run_step(run.id))
    return fsi_run(context, run, before=before)


def _calibrated(
    context: RunContext, choice: StudyChoice, reduced: CaseResult
) -> tuple[LoopFit, list[Run3D]]:
    """α in 3D: the surrogates' values first, then corrections."""
    case, patient = context.case, reduced.patient
    target = case.conditions["rest"].ffr
    assert target is not None, "checked by check_study"
    starts = {
        label: reduced.calibrations[law].alpha
        for label, law in ((PAPER, LINEAR), (CURVE, QUADRATIC))
        if law in reduced.calibrations and (label == CURVE or choice.paper)
    }
    labels = list(starts)
    runs: list[Run3D] = []

    def run(alpha: float) -> float:
        k = len(runs)  # the starts come first, in their order
        label = labels[k] if k < len(labels) else f"{LOOP}{k - len(labels) + 1}"
        runs.append(_told_run(context, PlannedRun(RunId(label, "rest"), alpha)))
        return _ratio(runs[-1])

    loop = calibrate_in_loop(
        patient.models[QUADRATIC].surrogate,
        patient.conditions["rest"],
        target,
        run,
        list(starts.values()),
        tolerance=RATIO_TOLERANCE,
        max_extra=MOST_EXTRA_RUNS,
    )
    return loop, runs


def _ratio(run: Run3D) -> float:
    """The ratio of a run.

    Raises:
        RuntimeError: the run has no whole cycle.
    """
    if run.ratio is None:
        raise RuntimeError(
            f"The run {run.label} at {run.condition} has no whole cycle, so no ratio. Take at least"
            " one cycle."
        )
    return run.ratio


def _stressed(
    context: RunContext, choice: StudyChoice, best: Run3D
) -> tuple[list[Run3D], dict[str, str]]:
    """Runs under stress, and those with the nominal outlet; by id those that ended in a collapse.

    Args:
        context: see `RunContext`.
        choice: how the study is made.
        best: the run at rest whose α is the calibrated one.
    """
    nominal = PlannedRun(RunId(NOMINAL, "rest"), 1.0)
    starts = {LOOP: best.planned, NOMINAL: nominal}
    runs = [_told_run(context, nominal)] if choice.nominal else []
    collapsed: dict[str, str] = {}
    for label, condition, rule in _stress_names(context.case, choice):
        before = starts[label] if choice.run.continued else None
        planned = PlannedRun(RunId(label, condition, rule), starts[label].alpha)
        try:
            runs.append(_told_run(context, planned, before))
        except LumenCollapsed as end:
            collapsed[planned.id.name] = str(end)
    return runs, collapsed


def _uncertain(
    context: RunContext,
    choice: StudyChoice,
    reduced: CaseResult,
    rest: Run3D,
    stressed: Sequence[Run3D],
) -> Intervals | None:
    """FFR in 3D with its interval, where it was asked for."""
    if choice.drawn is None:
        return None
    calibrated = [run for run in stressed if run.label == LOOP]
    runs = runs_beside_0d(context, reduced.patient, rest, calibrated, choice.drawn)
    return uncertain_ratios(reduced.patient, context.progress, runs_in_3d=runs)


def _sensitivities(
    context: RunContext, choice: StudyChoice, runs: Sequence[Run3D]
) -> tuple[dict[str, Sensitivity], dict[str, str]]:
    """Derivatives of the calibrated runs that were asked for; why a run has none."""
    found, failures = {}, {}
    for run in runs:
        if run.condition not in choice.sensitivities:
            continue
        context.progress.step(f"derivatives: {run.condition}")
        try:
            found[run.id] = run_sensitivity(context, run.planned)
        except RuntimeError as error:
            failures[run.id] = str(error)
    return found, failures


def _motion(context: RunContext, anatomy: Anatomy, runs: Sequence[Run3D]) -> dict[str, MotionPart]:
    """Lumen and wall over a cycle of each run."""
    found = {}
    for run in runs:
        folder = context.folder / run.folder / FIELD_FOLDER
        frames = len(read_series(folder / "fields.pvd"))
        key = stage_key("reading", "motion", run_key(context, run.planned), frames)

        def compute(folder=folder, period=run.period_s) -> Any:
            entries = read_series(folder / "fields.pvd")
            motion = lumen_motion(folder, entries, context.mesh, anatomy, period)
            return {} if motion is None else as_json(motion_part(motion))

        def read(kept: Any) -> MotionPart | None:
            return from_json(MotionPart, kept) if kept else None

        motion = context.stages.value(f"motion-{run.id}", key, compute, read)
        if motion is not None:
            found[run.id] = motion
    return found
