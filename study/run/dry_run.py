"""What a command would compute, and what it would find finished; nothing is written.

Meshes, the ramp and cases of a cohort are looked up under the keys of what they follow from. A run
of a study follows from numbers that the ramp and the runs before it give: one that was finished is
taken again where these come out the same, as they do where nothing was changed.
"""

import dataclasses
import importlib
import io
import pathlib
from typing import Any

from study.case.model import Case, require
from study.run.expected_times import march_seconds
from study.run.members import Member
from study.store.earlier_run import can_go_on
from study.store.options import (
    CohortOptions,
    DiagnoseOptions,
    RunOptions,
    SimulateOptions,
    StudyOptions,
)
from study.store.result_files import CHECKPOINT_FILE, IN_3D_FOLDER, STAGE_FOLDER

KEPT, BEGUN, ANEW = "kept", "goes on", "to compute"
"""States of a part."""

_STUDY_PARTS = ("3D:", "deriv", "ramp", "uncertainty")
"""How names of the parts of a study begin that are runs in 3D, or that follow from them."""


@dataclasses.dataclass(frozen=True)
class DryPart:
    """A part of what a command would do.

    Attributes:
        name: in words.
        state: one of `KEPT`, `BEGUN` and `ANEW`.
        seconds: that it usually takes where it is computed; None: not known.
    """

    name: str
    state: str
    seconds: float | None = None


def dry_run_of_case(options: RunOptions, case: Case) -> list[DryPart]:
    """Parts of `run`."""
    require(case, "run")
    parts = [DryPart(f"calibration at rest, {case.surrogate.law} law", ANEW)]
    parts += [DryPart(f"0D: {name}", ANEW) for name in case.conditions if name != "rest"]
    if options.uncertainty:
        parts.append(DryPart("intervals of FFR", ANEW))
    if options.demo if options.mesh is None else options.mesh:
        parts.append(_mesh(importlib.import_module("study.run.mesh").coarse(case)))
    return parts


def dry_run_of_simulation(
    options: SimulateOptions, case: Case, folder: pathlib.Path
) -> list[DryPart]:
    """Parts of `simulate`.

    Raises:
        CaseError: it would be refused.
    """
    checks = importlib.import_module("study.run.opening_checks")
    setup = importlib.import_module("study.run.setup")
    meshes = importlib.import_module("study.run.mesh")
    checks.check_names(case, segment=True)
    setup.check_simulation(case, options.condition, rigid=options.rigid, dt=options.dt)
    plan = setup.plan_steps(case, options.condition, dt=options.dt, cycles=options.cycles)
    preset = options.preset or case.mesh.preset
    case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=preset))
    begun = can_go_on(folder) and not options.restart
    name = f"run at {options.condition}, {plan.n_steps} steps of {1e3 * plan.dt:.3g} ms"
    seconds = march_seconds(preset, plan.n_steps)
    state = meshes.chosen_state(case, options.state)
    return [_mesh(case, state), DryPart(name, BEGUN if begun else ANEW, seconds)]


def dry_run_of_study(options: StudyOptions, case: Case, folder: pathlib.Path) -> list[DryPart]:
    """Parts of `study`.

    Raises:
        CaseError: it would be refused.
    """
    algorithm = importlib.import_module("study.run.algorithm")
    choices = importlib.import_module("study.run.study_options")
    case = choices.study_case(case, options)
    choice = choices.study_choice(case, options)
    algorithm.check_study(case, choice)
    steps, mesh = algorithm.study_steps(case, choice), _mesh(case)
    ramp = _ramp(case, choice, folder)
    parts = [mesh, dataclasses.replace(ramp, seconds=steps[ramp.name])]
    for run in algorithm.planned_runs(case, choice):
        state = _run_state(folder, run.name, after=ramp.state)
        parts.append(DryPart(algorithm.run_step(run), state, steps[algorithm.run_step(run)]))
    known = {part.name for part in parts}
    others = [name for name in steps if name not in known and name.startswith(_STUDY_PARTS)]
    return [*parts, *(DryPart(name, ANEW, steps[name]) for name in others)]


def _ramp(case: Case, choice: Any, folder: pathlib.Path) -> DryPart:
    ramps = importlib.import_module("study.run.ramp")
    contexts = importlib.import_module("study.run.run_context")
    progress = importlib.import_module("study.run.progress")
    stages = importlib.import_module("study.store.stages")
    meshes = importlib.import_module("study.store.meshes")
    state = importlib.import_module("study.run.anatomy_source").states_of(case)[0]
    key = meshes.mesh_key(case, state)
    told = progress.Progress(stream=io.StringIO())
    context = contexts.RunContext(case, None, key, folder, choice.run, told)
    own = ramps.ramp_key(context, choice.ramp)
    name = ramps.RAMP
    if context.stages.known_arrays(name, stages.stage_key("reading", own)) is not None:
        return DryPart(name, KEPT)
    return DryPart(name, BEGUN if context.is_of(own, name) else ANEW)


def _run_state(folder: pathlib.Path, name: str, *, after: str) -> str:
    """State of a run of a study by its files, where the ramp is the same."""
    if after != KEPT:
        return ANEW
    if (folder / STAGE_FOLDER / f"run-{name}.json").is_file():
        return KEPT
    return BEGUN if (folder / "runs" / name / CHECKPOINT_FILE).is_file() else ANEW


def _mesh(case: Case, state: str | None = None) -> DryPart:
    meshes = importlib.import_module("study.store.meshes")
    states = importlib.import_module("study.run.anatomy_source").states_of(case)
    chosen = state or next(iter(states), None)
    if chosen is None:
        return DryPart("mesh: the case has no anatomy", ANEW)
    steps = importlib.import_module("study.run.mesh").planned_steps(case, [chosen])
    known = meshes.has_mesh(meshes.entry_key(case, chosen))
    name = f"mesh of {chosen}, {case.mesh.preset}"
    return DryPart(name, KEPT if known else ANEW, sum(steps.values()))


def dry_run_of_cohort(
    options: CohortOptions, members: list[Member], seconds: float
) -> list[DryPart]:
    """Parts of `cohort`.

    Args:
        options: of the command.
        members: its cases.
        seconds: that a case usually takes.
    """
    cohort = importlib.import_module("study.run.cohort")
    extra = options.options or ()
    return [
        DryPart(
            f"case {member.name}",
            ANEW if cohort.finished_member(member, options.mode, extra) is None else KEPT,
            seconds,
        )
        for member in members
    ]


def dry_run_of_diagnosis(
    options: DiagnoseOptions, record: Any, folder: pathlib.Path
) -> list[DryPart]:
    """Parts of `diagnose`.

    Raises:
        CaseError: --in-3d or --case would be refused.
    """
    in_3d = importlib.import_module("study.run.diagnosis_in_3d")
    in_0d = importlib.import_module("study.run.diagnosis")
    if options.case is not None:
        in_0d.with_case(record, options.case)
    names = [c.name for c in record.conditions]
    usual = sum(in_0d.usual_seconds().values())
    parts = [DryPart(f"diagnosis of {len(names)} conditions", ANEW, usual)]
    if options.in_3d is None:
        return parts
    in_3d.check_in_3d(options, record)
    for name in names:
        if not options.in_3d or name in options.in_3d:
            kept = [
                (folder / IN_3D_FOLDER / STAGE_FOLDER / f"beat-{name}-{label}.json").is_file()
                for label in (in_3d.BEFORE, in_3d.AFTER)
            ]
            state = KEPT if all(kept) else BEGUN if any(kept) else ANEW
            parts.append(DryPart(f"3D: {name}, before and after the named effect", state, 240.0))
    return parts
