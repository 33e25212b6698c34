"""A 3D run of a case: from its mesh to files, going on from where it was ended.

The folder holds ``fields/`` (frames many times a cycle), ``history.csv``, ``checkpoint.npz`` and,
at the end, ``shear.vtu`` and the files of `study.run.artery_files`. The same command in the same
folder goes on from the checkpoint; another input refuses it, and so does a run that is shorter than
what is there.
"""

import dataclasses
import math
import pathlib
import time

from jaxfsi import OUTER_WALL
from jaxfsi.simulation import (
    CheckpointError,
    FieldSeries,
    ProgressRecord,
    ShearCycle,
    SimulationError,
    SimulationInterrupted,
    SolverChoice,
    StepControl,
    StepHistory,
    simulate,
    write_csv,
)
from lumped import ML_PER_MIN, MMHG
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.parameters import SolverOptions
from study.run.artery_files import write_artery_files
from study.run.lumen_collapse import anatomy_of, located
from study.run.progress import Progress
from study.run.simulation_data import Outcome, Schedule, Setup
from study.store.result_files import CHECKPOINT_FILE, FIELD_FOLDER, HISTORY_FILE, SHEAR_FILE
from study.store.stages import stage_key

CHUNK = 10
"""Whole steps in one compiled call."""

STEP_NAME = "running"
_HISTORY_SECONDS = 10.0


def solver_choice(options: SolverOptions) -> SolverChoice:
    """How each step of a case is solved."""
    choice = SolverChoice(
        rho_infinity=options.rho_infinity,
        max_iterations=options.max_iterations,
        max_systems=options.max_systems,
    )
    if options.tolerance is None:
        return choice
    return dataclasses.replace(choice, tolerance=options.tolerance)


def run_simulation(
    case: Case, setup: Setup, folder: pathlib.Path, progress: Progress, *, state: str | None = None
) -> Outcome:
    """Run a model to its end, to the step that fails, to a collapse, or until it is interrupted.

    Args:
        case: the case.
        setup: see `prepare_simulation`.
        folder: where files go; made if needed.
        progress: told of each chunk.
        state: of the anatomy that was meshed; None: the first.

    Raises:
        CaseError: the folder holds a run of another input, a longer one, or a damaged checkpoint;
            nothing was written.
        KeyboardInterrupt: the user interrupted it before a step was done.
    """
    folder.mkdir(parents=True, exist_ok=True)
    options, plan = case.solver, setup.schedule
    shear = ShearCycle(setup.mesh, every=plan.per_frame, period=plan.period)
    series = FieldSeries(folder / FIELD_FOLDER, setup.mesh, every=plan.per_frame)
    watch = _Watch(setup, folder, progress)
    checkpoint = folder / CHECKPOINT_FILE
    control = StepControl(max_halvings=options.max_halvings, change_limit=options.change_limit)
    start = time.monotonic()
    progress.tell("compiling the step")
    try:
        end = simulate(
            setup.model,
            setup.state,
            dt=plan.dt,
            n_steps=plan.n_steps,
            chunk=CHUNK,
            control=control,
            solver=solver_choice(options),
            observers=[series, shear],
            checkpoint=checkpoint,
            checkpoint_every=options.checkpoint_every,
            progress=watch.look,
            numerics=stage_key("checkpoint"),
        )
        found = Outcome(
            end.record, end.events, end.resumed_from, shear.means(), 0.0, state=end.state
        )
    except SimulationError as error:
        kept = error.simulation
        found = Outcome(kept.record, kept.events, kept.resumed_from, shear.means(), 0.0)
        if error.collapse is None:
            found = found._replace(failure=str(error))
        else:
            shape = anatomy_of(case, state)
            found = found._replace(collapse=located(error.collapse, setup.mesh, shape))
    except SimulationInterrupted as stop:
        kept = stop.simulation
        if not kept.record.n_steps:
            raise KeyboardInterrupt("interrupted before the first steps were done") from None
        found = Outcome(
            *(kept.record, kept.events, kept.resumed_from, shear.means(), 0.0), interrupted=True
        )
    except CheckpointError as error:
        raise CaseError([_refusal(checkpoint, error, plan)]) from error
    if found.record.n_steps:
        write_history(folder, found.record, setup.model.names)
    shear.write(folder / SHEAR_FILE)
    if found.state is not None:
        shape = anatomy_of(case, state)
        names = setup.model.names
        write_artery_files(folder, setup.mesh, shape, found.record, names, plan.period)
    return found._replace(seconds=time.monotonic() - start, pace=watch.pace)


def write_history(folder: pathlib.Path, record: StepHistory, names: tuple[str, ...]) -> None:
    """Write the history of the openings; the outside of the wall is a port of the model alone."""
    chosen = [i for i, name in enumerate(names) if name != OUTER_WALL]
    shown = record._replace(P_port=record.P_port[:, chosen], Q_port=record.Q_port[:, chosen])
    write_csv(folder / HISTORY_FILE, shown, tuple(names[i] for i in chosen))


def _refusal(path: pathlib.Path, error: CheckpointError, plan: Schedule) -> Fault:
    """Why the checkpoint of a folder cannot be used, in the words of the command line."""
    cure = "name another folder with --out, or remove this file to start anew (simulate: --restart)"
    if error.n_steps is not None:
        # rounded up, so that the number asks for all the steps
        cycles = math.ceil(round(error.n_steps / plan.per_cycle * 1e4, 6)) / 1e4
        cure = f"ask for at least as much (--cycles {cycles:g}), {cure}"
    return Fault(path, "", None, error.problem, "", cure)


class _Watch:
    """Tells the progress of a run and keeps its history on disk."""

    def __init__(self, setup: Setup, folder: pathlib.Path, progress: Progress):
        self._setup, self._folder, self._progress = setup, folder, progress
        self._begun: tuple[float, float] | None = None
        self.pace: float | None = None
        self._written = time.monotonic()

    def look(self, progress: ProgressRecord) -> None:
        """Take notice of a chunk."""
        now = time.monotonic()
        if self._begun is None:  # the first chunk compiles
            self._begun = (now, progress.step)
        begun, step = self._begun
        if progress.step > step:
            self.pace = (now - begun) / (progress.step - step)
        left = None if self.pace is None else self.pace * (progress.n_steps - progress.step)
        self._progress.tell(progress_text(progress, self._setup.schedule, self.pace or 0.0), left)
        if now - self._written > _HISTORY_SECONDS:
            write_history(self._folder, progress.record, progress.names)
            self._written = now


def progress_text(progress: ProgressRecord, schedule: Schedule, pace: float) -> str:
    """Step, time, cycle, and pressure and flow of each opening."""
    cycle = int(progress.t / schedule.period + 1e-9) + 1
    parts = [
        f"step {progress.step:g} of {progress.n_steps}",
        f"t = {progress.t:.4f} s, cycle {cycle}",
        f"{progress.n_gmres} iterations",
    ]
    if pace > 0.0:
        parts.append(f"{pace:.2g} s a step")
    for name, P, Q in zip(progress.names, progress.P_port, progress.Q_port, strict=True):
        if name.endswith(("inlet", "outlet")):
            parts.append(f"{name} {P / MMHG:.1f} mmHg {Q / ML_PER_MIN:.0f} mL/min")
    return ", ".join(parts)
