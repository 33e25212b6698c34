"""3D runs of one patient, each kept by the hash of what it follows from.

A run is a condition with a scale factor α and a stress rule. Its folder holds fields, history and
checkpoint as those of the command `simulate` do, and in ``inputs.txt`` the key of what they follow
from and by which code they were begun; what the study needs of it is kept as a stage.
"""

import dataclasses
from typing import Any

import numpy as np

from jaxfsi.core.step.state import State
from jaxfsi.fields import read_series
from jaxfsi.fields.aortic_site import cycle_offsets, site_pressures
from jaxfsi.opening import INLET, distal_name, is_anomalous
from jaxfsi.simulation import StepHistory
from jaxfsi.simulation.cycles import cycle_means, inlet_of, waveforms
from lumped import MMHG
from study.run.results import PlannedRun, Run3D, RunCycle, RunHistory, stored_run
from study.run.run_context import RunContext
from study.run.setup import plan_steps, prepare_simulation
from study.run.shared_step import with_ramp_off
from study.run.simulation import run_simulation
from study.run.simulation_data import Outcome, Setup
from study.store.json_form import as_json
from study.store.result_files import FIELD_FOLDER, RUN_FOLDER
from study.store.stages import stage_key

_MOST_SAMPLES = 400


class LumenCollapsed(RuntimeError):
    """The lumen collapsed, which ended a run; says when and where."""


def run_key(context: RunContext, run: PlannedRun, before: PlannedRun | None = None) -> str:
    """Hash of all that a run follows from.

    Args:
        context: see `RunContext`.
        run: which run.
        before: the run that it goes on from, if any.
    """
    case = context.case
    rest = case.conditions.get("rest")
    entry = case.conditions[run.id.condition]
    solver = dataclasses.replace(case.solver, n_steps=None)
    blocks = (case.blood, case.wall, *case.beds, case.surrogate, case.windkessel, solver)
    factors = case.stress.factors if run.id.rule == "factors" else None
    conditions = tuple(None if c is None else c.without_outcome() for c in (rest, entry))
    condition, rule = run.id.condition, run.id.rule
    own = (context.mesh_key, blocks, conditions, condition, rule, factors, run.alpha)
    earlier = None if before is None else run_key(context, before)
    choice = dataclasses.replace(context.choice, continued=False)
    return stage_key("run", own, choice, earlier)


def fsi_run(context: RunContext, run: PlannedRun, *, before: PlannedRun | None = None) -> Run3D:
    """A run in 3D, or what was kept of it.

    Args:
        context: see `RunContext`.
        run: which run.
        before: a run at rest whose end it starts from; None: its own periodic state in 0D.

    Raises:
        LumenCollapsed: the lumen collapsed before the run was over.
        RuntimeError: a step failed; cause and cure.
        KeyboardInterrupt: the user interrupted it; the checkpoint is kept.
    """
    key, name = run_key(context, run, before), run.id.name

    def compute() -> dict[str, Any]:
        setup = setup_of(context, run)
        if before is not None:
            setup = dataclasses.replace(setup, state=_continued(context, before, setup))
        outcome = finished_run(context, name, key, with_ramp_off(setup))
        return as_json(run_result(context, setup, outcome, run))

    stage = stage_key("reading", key, context.site)
    return context.stages.value(f"run-{name}", stage, compute, lambda kept: stored_run(kept, run))


def setup_of(context: RunContext, run: PlannedRun) -> Setup:
    """Model and start of a run."""
    case = context.case
    condition, rule = run.id.condition, run.id.rule
    if rule is not None:
        case = dataclasses.replace(case, stress=dataclasses.replace(case.stress, rule=rule))
    plan = plan_steps(case, condition, dt=context.choice.dt, cycles=float(context.choice.cycles))
    return prepare_simulation(
        case, context.mesh, condition, plan, alpha=run.alpha, keep=context.keep
    )


def finished_run(context: RunContext, folder: str, key: str, setup: Setup) -> Outcome:
    """A run that went to its end.

    Raises:
        LumenCollapsed: the lumen collapsed.
        RuntimeError: a step failed.
        KeyboardInterrupt: the user interrupted it.
    """
    place = context.prepared(key, folder)
    outcome = run_simulation(context.case, setup, place, context.progress)
    if outcome.interrupted:
        raise KeyboardInterrupt(
            f"interrupted in the run {folder}; what was computed is in {context.folder}. "
            "Run the same command again to resume."
        )
    if outcome.collapse is not None:
        raise LumenCollapsed(f"{outcome.collapse.sentence} What was computed before is in {place}.")
    if outcome.failure:
        raise RuntimeError(
            f"The run {folder} ended early. {outcome.failure} What was computed before is in "
            f"{place}; a smaller step (--dt) may help."
        )
    return outcome


def _continued(context: RunContext, before: PlannedRun, setup: Setup) -> State:
    """The end of a run at rest as the start of one under stress: pressures are continuous.

    The state of an intramyocardial node counts from the ventricular pressure, which may differ
    between the two at the start of a cycle.
    """
    rest = setup_of(context, before)
    key = run_key(context, before)
    end = finished_run(context, before.id.name, key, with_ramp_off(rest)).state
    assert end is not None
    start = setup.state
    blocks = []
    for old, new, x in zip(rest.model.ports, setup.model.ports, end.blocks, strict=True):
        was, becomes = old.reference_pressure(0.0), new.reference_pressure(0.0)
        blocks.append(x + was - becomes if x.shape == was.shape == becomes.shape else x)
    return end._replace(t=start.t, blocks=tuple(blocks))


def run_result(context: RunContext, setup: Setup, outcome: Outcome, run: PlannedRun) -> Run3D:
    """What a run found; ratios are to the aortic pressure at the ostium where that is read."""
    record, names, plan = outcome.record, setup.model.names, setup.schedule
    cycles, site = _at_site(context, run, record, names, plan.period)
    ratios = [cycle.ratio for cycle in cycles if cycle.complete]
    change = None
    if len(ratios) > 1 and ratios[-1] is not None and ratios[-2] is not None:
        change = abs(ratios[-1] - ratios[-2])
    distal = distal_name(names)
    assert distal is not None, "checked by check_study and check_openings"
    waves = waveforms(record, names, distal, _MOST_SAMPLES)
    columns = {name: _rounded(values) for name, values in vars(waves).items()}
    return Run3D(
        id=run.id.name,
        label=run.id.label,
        condition=run.id.condition,
        rule=run.id.rule,
        alpha=run.alpha,
        ratio=ratios[-1] if ratios else None,
        ratios=ratios,
        ratio_change=change,
        drift_mmHg=block_drift(setup, outcome.state),
        cycles=cycles,
        period_s=plan.period,
        dt_s=plan.dt,
        steps=record.n_steps,
        repeated=len(outcome.events),
        mean_iterations=float(record.n_gmres.mean()),
        least_volume=float(record.min_volume_ratio.min()),
        folder=f"{RUN_FOLDER}/{run.id.name}",
        history=RunHistory(**columns, **site),
    )


def _at_site(
    context: RunContext, run: PlannedRun, record: StepHistory, names: tuple[str, ...], period: float
) -> tuple[list[RunCycle], dict[str, list[float]]]:
    """Cycles, and the aortic pressure at the ostium where that is read."""
    cycles = [RunCycle(**vars(cycle)) for cycle in cycle_means(record, names, period)]
    folder = context.run_folder(run.id.name) / FIELD_FOLDER
    entries = [e for e in read_series(folder / "fields.pvd") if e.t > 0.0]
    if context.site is None or not entries:
        return cycles, {}
    t = np.array([e.t for e in entries])
    P = site_pressures(folder, entries, context.site)
    offsets = cycle_offsets(t, P - np.interp(t, *inlet_of(record, names)), period, len(cycles))
    cycles = [c.at_site(offset, INLET) for c, offset in zip(cycles, offsets, strict=True)]
    return cycles, {"t_site_s": [float(v) for v in t], "P_site_mmHg": _rounded(P)}


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{v:.7g}") for v in values]


def block_drift(setup: Setup, end: State | None) -> float | None:
    """Largest change of a state of the anomalous bed from start to end of a run [mmHg]."""
    if end is None:
        return None
    changes = [
        float(np.max(np.abs(np.asarray(after) - np.asarray(before))))
        for name, before, after in zip(
            setup.model.names, setup.state.blocks, end.blocks, strict=True
        )
        if is_anomalous(name) and np.size(after)
    ]
    return max(changes, default=0.0) / MMHG
