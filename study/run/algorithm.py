"""Algorithm 1 in 3D: ramp, surrogates, α with the 3D model in the loop, rest and stress.

1. Ramp of the pressure drop in 3D; R0 = its slope at 40 mmHg (the paper), and its whole curve.
2. α of the linear and of the quadratic surrogate at the measured resting ratio.
3. 3D at rest with each, then with α corrected until the ratio in 3D is the measured one.
4. 3D under every stress condition and rule; with the nominal outlet too, where asked for.
5. Where asked for, what moves the ratios of the calibrated runs (`study.run.sensitivity`).

Every step is a stage that is kept (`study.store.stages`): the same call goes on where it was ended.

Source: Puelz et al. 2024, algorithm 1; step 3 is ours.
"""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from calibration import (
    MOST_EXTRA_RUNS,
    RATIO_TOLERANCE,
    LoopFit,
    RampFit,
    RampRecord,
    calibrate_in_loop,
)
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import read_series
from study.case.anatomy import MeshAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case, SurrogateParameters, require
from study.run.anatomy_source import case_anatomy, case_mesh, states_of
from study.run.aortic_site import aortic_site
from study.run.lumen_motion import lumen_motion
from study.run.mesh import mesh_state, planned_steps
from study.run.opening_checks import check_names, check_openings
from study.run.patient import LINEAR, QUADRATIC, stress_rules
from study.run.pipeline import CaseResult, run_case
from study.run.progress import Progress
from study.run.ramp import RAMP, RampChoice, fitted, ramp_record
from study.run.run_3d import Bench, RunChoice, RunName, fsi_run, run_key
from study.run.sensitivity import Sensitivity, run_sensitivity
from study.run.setup import STEP, check_simulation
from study.store.meshes import mesh_key
from study.store.result_files import FIELD_FOLDER
from study.store.stages import Stages, stage_key

PAPER, CURVE, LOOP, NOMINAL = "paper", "curve", "loop", "nominal"
"""What the α of a run comes from: the linear surrogate, the quadratic one, the correction in 3D, or
nothing (α = 1, the paper's fixed boundary condition)."""

_SECONDS_A_STEP = 0.16
_COMPILE = 40.0


@dataclasses.dataclass(frozen=True)
class StudyChoice:
    """How a study is made.

    Attributes:
        run: how its 3D runs are made.
        ramp: how the ramp is made.
        rules: stress rules to run; None: that of the case.
        nominal: also run every condition with α = 1.
        paper: also run rest with the α of the linear surrogate.
        sensitivities: conditions whose calibrated run is differentiated.
    """

    run: RunChoice = dataclasses.field(default_factory=RunChoice)
    ramp: RampChoice = dataclasses.field(default_factory=RampChoice)
    rules: tuple[str, ...] | None = None
    nominal: bool = False
    paper: bool = True
    sensitivities: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """All that a study found.

    Attributes:
        bench: case (its surrogate is the ramp's curve), mesh and folder.
        anatomy: the anatomy; None where the case names a finished mesh.
        choice: how it was made.
        record: the ramp.
        fit: its curve.
        reduced: everything in 0D with that curve.
        loop: the calibration in 3D.
        runs: the 3D runs, as documents hold them: those at rest first, in order.
        motion: lumen and wall over a cycle, by name of the run.
        sensitivities: what moves the ratio of a run, by name of the run.
        failures: why a run has none, by the same.
    """

    bench: Bench
    anatomy: Anatomy | None
    choice: StudyChoice
    record: RampRecord
    fit: RampFit
    reduced: CaseResult
    loop: LoopFit
    runs: list[dict[str, Any]]
    motion: dict[str, dict[str, Any]]
    sensitivities: dict[str, Sensitivity] = dataclasses.field(default_factory=dict)
    failures: dict[str, str] = dataclasses.field(default_factory=dict)


def check_study(case: Case, choice: StudyChoice) -> None:
    """Refuse a case that a study cannot use; all faults are listed.

    Raises:
        CaseError: what is missing or out of range, or the fault of a finished mesh.
    """
    require(case, "study")
    check_names(case, segment=False)
    faults: list[Fault] = []
    for name in case.conditions:
        try:
            check_simulation(case, name, rigid=False, dt=choice.run.dt)
        except CaseError as error:
            faults += [fault for fault in error.faults if fault not in faults]
    known = stress_rules(case)
    for rule in choice.rules or ():
        if rule not in known:
            problem = f"there is no stress rule {rule!r}"
            cure = "add the factors below [stress]" if rule == "factors" else "choose a known one"
            faults.append(Fault(case.path, "stress.rule", None, problem, ", ".join(known), cure))
    for name in choice.sensitivities:
        if name not in case.conditions:
            problem = f"there is no condition {name!r} to differentiate"
            allowed = ", ".join(case.conditions)
            faults.append(
                Fault(case.path, "condition", None, problem, allowed, "choose from those run")
            )
    if choice.sensitivities and choice.run.continued:
        problem = "a run that goes on from rest cannot be differentiated alone"
        faults.append(Fault(case.path, "", None, problem, "", "leave --continued out"))
    if faults:
        raise CaseError(faults)
    if isinstance(case.anatomy, MeshAnatomy):
        case_mesh(case)  # a damaged mesh is refused before a folder is made


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
    progress.plan(_plan(case, choice))
    bench, anatomy = open_bench(case, folder, choice.run, progress)
    progress.step(RAMP)
    record = ramp_record(bench, choice.ramp)
    fit = fitted(record, choice.ramp)
    bench = with_curve(bench, float(fit.law.a), float(fit.law.b))
    progress.step("calibrating in 0D")
    reduced = run_case(bench.case)
    loop, runs = _calibrated(bench, choice, reduced)
    runs += _stressed(bench, choice, loop, runs)
    progress.step("measuring the lumen")
    motion = {} if anatomy is None else _motion(bench, anatomy, _shown(runs, loop))
    found, failures = _sensitivities(bench, choice, runs, loop)
    return StudyResult(
        bench, anatomy, choice, record, fit, reduced, loop, runs, motion, found, failures
    )


def open_bench(
    case: Case, folder: pathlib.Path, choice: RunChoice, progress: Progress
) -> tuple[Bench, Anatomy | None]:
    """What all runs of a case share, its mesh made or taken from the cache, and its anatomy.

    Args:
        case: the case.
        folder: where stages and runs are kept.
        choice: how runs are made.
        progress: told of the meshing.

    Raises:
        CaseError: no mesh can be made, or it lacks an opening.
    """
    state = states_of(case)[0]
    found = mesh_state(case, state, progress)
    mesh = found.mesh
    check_openings(case, mesh, rigid=False)
    anatomy = None if isinstance(case.anatomy, MeshAnatomy) else case_anatomy(case, state)
    site = aortic_site(mesh, anatomy)
    key = mesh_key(case, state)
    return Bench(case, mesh, key, folder, choice, progress, site, found.made), anatomy


def with_curve(bench: Bench, a: float, b: float) -> Bench:
    """The bench whose case has a ramp's curve for surrogate, a [dyn·s/cm⁵], b [dyn·s²/cm⁸]."""
    case = bench.case
    curve = SurrogateParameters(R0=a, K=b, C0=case.surrogate.C0, law=QUADRATIC)
    return dataclasses.replace(bench, case=dataclasses.replace(case, surrogate=curve))


def _plan(case: Case, choice: StudyChoice) -> dict[str, float]:
    """Steps with the seconds that each usually takes."""
    dt = choice.run.dt or case.solver.dt or STEP

    def seconds(condition: str) -> float:
        steps = case.conditions[condition].period / dt * choice.run.cycles
        return 5.0 + steps * _SECONDS_A_STEP

    ramp = choice.ramp.drop / choice.ramp.rate / dt * 1.5 * _SECONDS_A_STEP
    plan = {**planned_steps(case, states_of(case)[:1]), RAMP: 2.0 * _COMPILE + ramp}
    plan["calibrating in 0D"] = 30.0
    if choice.paper:
        plan[_step(PAPER, "rest", None)] = seconds("rest")
    plan[_step(CURVE, "rest", None)] = seconds("rest") + _COMPILE
    plan[_step(f"{LOOP}1", "rest", None)] = seconds("rest")
    if choice.nominal:
        plan[_step(NOMINAL, "rest", None)] = seconds("rest")
    for label, condition, rule in _stress_names(case, choice):
        plan[_step(label, condition, rule)] = seconds(condition)
    for condition in choice.sensitivities:
        plan[f"derivatives: {condition}"] = 2.0 * _COMPILE + 8.0 * seconds(condition)
    return {**plan, "measuring the lumen": 10.0, "drawing": 40.0, "writing the report": 3.0}


def _step(label: str, condition: str, rule: str | None) -> str:
    words = {PAPER: "linear surrogate", CURVE: "curve", NOMINAL: "alpha = 1", LOOP: "calibrated"}
    origin = words.get(label, "corrected")
    return f"3D: {condition}, {origin}" + (f", rule {rule}" if rule else "")


def _stress_names(case: Case, choice: StudyChoice) -> list[tuple[str, str, str]]:
    """Label, condition and rule of each run under stress."""
    rules = choice.rules or (case.stress.rule,)
    labels = (LOOP, NOMINAL) if choice.nominal else (LOOP,)
    stresses = [name for name in case.conditions if name != "rest"]
    return [(label, name, rule) for name in stresses for rule in rules for label in labels]


def _told_run(bench: Bench, name: RunName, before: RunName | None = None) -> dict[str, Any]:
    bench.progress.step(_step(name.label, name.condition, name.rule))
    return fsi_run(bench, name, before=before)


def _calibrated(
    bench: Bench, choice: StudyChoice, reduced: CaseResult
) -> tuple[LoopFit, list[dict[str, Any]]]:
    """α in 3D: the surrogates' values first, then corrections."""
    case, patient = bench.case, reduced.patient
    target = case.conditions["rest"].ffr
    assert target is not None, "checked by check_study"
    labels = {
        label: reduced.calibrations[law].alpha
        for label, law in ((PAPER, LINEAR), (CURVE, QUADRATIC))
        if law in reduced.calibrations and (label == CURVE or choice.paper)
    }
    runs: list[dict[str, Any]] = []

    def run(alpha: float) -> float:
        known = [label for label, value in labels.items() if value == alpha]
        corrections = sum(part["label"].startswith(LOOP) for part in runs)
        label = known[0] if known else f"{LOOP}{corrections + 1}"
        part = _told_run(bench, RunName(label, "rest", None, alpha))
        runs.append(part)
        return _ratio(part)

    loop = calibrate_in_loop(
        run,
        list(labels.values()),
        target,
        patient.models[QUADRATIC].surrogate,
        patient.conditions["rest"],
        tolerance=RATIO_TOLERANCE,
        max_extra=MOST_EXTRA_RUNS,
    )
    return loop, runs


def _ratio(part: Mapping[str, Any]) -> float:
    """The ratio of a run.

    Raises:
        RuntimeError: the run has no whole cycle.
    """
    if part["ratio"] is None:
        raise RuntimeError(
            f"The run {part['label']} at {part['condition']} has no whole cycle, so no ratio. Take"
            " at least one cycle."
        )
    return part["ratio"]


def _stressed(
    bench: Bench, choice: StudyChoice, loop: LoopFit, rest: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Runs under stress, and those with the nominal outlet."""
    best = next(part for part in rest if part["alpha"] == loop.alpha)
    starts = {LOOP: RunName(best["label"], "rest", None, loop.alpha)}
    alphas = {LOOP: loop.alpha, NOMINAL: 1.0}
    runs = []
    if choice.nominal:
        starts[NOMINAL] = RunName(NOMINAL, "rest", None, 1.0)
        runs.append(_told_run(bench, starts[NOMINAL]))
    for label, condition, rule in _stress_names(bench.case, choice):
        before = starts[label] if choice.run.continued else None
        runs.append(_told_run(bench, RunName(label, condition, rule, alphas[label]), before))
    return runs


def _shown(runs: Sequence[dict[str, Any]], loop: LoopFit) -> list[dict[str, Any]]:
    """Runs whose fields are looked at: the calibrated ones."""
    rest = [r for r in runs if r["condition"] == "rest" and r["alpha"] == loop.alpha][:1]
    return rest + [r for r in runs if r["condition"] != "rest" and r["label"] == LOOP]


def _sensitivities(
    bench: Bench, choice: StudyChoice, runs: Sequence[dict[str, Any]], loop: LoopFit
) -> tuple[dict[str, Sensitivity], dict[str, str]]:
    """Derivatives of the calibrated runs that were asked for; why a run has none."""
    found, failures = {}, {}
    for part in _shown(runs, loop):
        if part["condition"] not in choice.sensitivities:
            continue
        bench.progress.step(f"derivatives: {part['condition']}")
        name = name_of(part)
        try:
            found[name.folder] = run_sensitivity(bench, name)
        except RuntimeError as error:
            failures[name.folder] = str(error)
    return found, failures


def name_of(part: Mapping[str, Any]) -> RunName:
    """The name of a run as the document holds it."""
    return RunName(part["label"], part["condition"], part["rule"], part["alpha"])


def shown_runs(result: StudyResult) -> list[dict[str, Any]]:
    """Runs whose fields are looked at: the calibrated ones, rest first."""
    return _shown(result.runs, result.loop)


def _motion(
    bench: Bench, anatomy: Anatomy, runs: Sequence[Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Lumen and wall over a cycle of each run."""
    stages, found = Stages(bench.folder / "stages"), {}
    for part in runs:
        folder = bench.folder / part["folder"] / FIELD_FOLDER
        name = name_of(part)
        frames = len(read_series(folder / "fields.pvd"))
        key = stage_key("reading", "motion", run_key(bench, name), frames)

        def compute(folder=folder, period=part["period_s"]) -> Any:
            entries = read_series(folder / "fields.pvd")
            return lumen_motion(folder, entries, bench.mesh, anatomy, period) or {}

        motion = stages.value(f"motion-{name.folder}", key, compute)
        if motion:
            found[name.folder] = motion
    return found
