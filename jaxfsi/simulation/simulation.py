"""A run of many steps: chunks of compiled steps, repeats, observers, checkpoints.

Chunks end at whole steps whose numbers do not depend on where the run began: a run that was ended
at any moment and goes on from its checkpoint takes the same chunks, and reaches the same bits.
"""

import dataclasses
import pathlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import Start, State
from jaxfsi.core.step.step import RESULTS
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.nominal import CHECKPOINT_EVERY, MAX_ITERATIONS, MAX_SYSTEMS
from jaxfsi.simulation.checkpoint import (
    Checkpoint,
    CheckpointError,
    fingerprint,
    load_checkpoint,
    save_checkpoint,
)
from jaxfsi.simulation.chunk import Chunk, advance_chunk
from jaxfsi.simulation.collapse import Collapse, collapse, snapping
from jaxfsi.simulation.observer import AbstractObserver
from jaxfsi.simulation.record import StepHistory, empty_record, joined
from jaxfsi.simulation.step_control import (
    Position,
    StepControl,
    after_steps,
    steps_to,
    stride,
    whole_steps,
)


@dataclasses.dataclass(frozen=True)
class SolverChoice:
    """How each step is solved; see `prepare`.

    Attributes:
        rho_infinity: damping of the highest frequency.
        tolerance: by how much the residual of the extrapolated state is reduced.
        max_iterations: iterations of GMRES at most.
        max_systems: linear systems a step at most.
    """

    rho_infinity: float = 0.5
    tolerance: float = 1e-3
    max_iterations: int = MAX_ITERATIONS
    max_systems: int = MAX_SYSTEMS


class ProgressRecord(NamedTuple):
    """What is known of a run while it goes on.

    Attributes:
        step: whole steps done.
        n_steps: whole steps in all.
        t: time [s].
        dt: length of the next step [s].
        names: of the ports.
        P_port: mean pressure of each port [dyn/cm²].
        Q_port: flow out of each port [cm³/s].
        n_gmres: iterations of the last step.
        record: of all steps so far.
    """

    step: float
    n_steps: int
    t: float
    dt: float
    names: tuple[str, ...]
    P_port: np.ndarray
    Q_port: np.ndarray
    n_gmres: int
    record: StepHistory


class Simulation(NamedTuple):
    """Result of a run.

    Attributes:
        state: at its end.
        record: of all its steps.
        events: what went wrong and was mended: whole steps done before it, t, dt, cause.
        resumed_from: whole step of the checkpoint that it went on from; None for a fresh run.
    """

    state: State
    record: StepHistory
    events: list[dict[str, Any]]
    resumed_from: int | None


class SimulationError(RuntimeError):
    """A step failed at the smallest length.

    Attributes:
        simulation: what was computed before.
        collapse: where and when the lumen collapsed, if that is why.
    """

    def __init__(self, message: str, simulation: Simulation, collapse: Collapse | None = None):
        RuntimeError.__init__(self, message)
        self.simulation = simulation
        self.collapse = collapse


class SimulationInterrupted(KeyboardInterrupt):
    """The user ended a run.

    Attributes:
        simulation: what its checkpoint holds, where it has one: all whole chunks.
    """

    def __init__(self, simulation: Simulation):
        KeyboardInterrupt.__init__(self)
        self.simulation = simulation


def simulate(
    model: Model,
    state: State,
    *,
    dt: float,
    n_steps: int,
    chunk: int = 20,
    control: StepControl | None = None,
    solver: SolverChoice | None = None,
    observers: Sequence[AbstractObserver] = (),
    checkpoint: pathlib.Path | None = None,
    checkpoint_every: int = CHECKPOINT_EVERY,
    progress: Callable[[ProgressRecord], None] | None = None,
    numerics: str = "",
) -> Simulation:
    """Run a model for a number of steps.

    Args:
        model: the model; its numbers must be concrete.
        state: state at the start.
        dt: length of a whole step, the longest one [s].
        n_steps: whole steps to take.
        chunk: whole steps in one compiled call: progress and interrupts come that often.
        control: how the length of steps is chosen; by default equal steps, halved up to four times
            where one fails.
        solver: how each step is solved.
        observers: look at the state; each at multiples of its own number of steps.
        checkpoint: file to keep the run in; where it exists, the run goes on from it.
        checkpoint_every: whole steps between two checkpoints.
        progress: called after each chunk with its progress record.
        numerics: name for the code that computes; a checkpoint of another name is refused.

    Returns:
        The state at the end and what happened.

    Raises:
        ValueError: a number is out of range.
        CheckpointError: the checkpoint belongs to another run, is damaged, or holds more steps;
            nothing was written.
        SimulationError: a step failed at the smallest length, or the lumen collapsed; what was
            computed is inside, and in the checkpoint up to the last whole chunk.
        SimulationInterrupted: the run was interrupted; the steps up to its last whole chunk are
            inside and in the checkpoint, and the observers are back there.
    """
    _check(n_steps, chunk, checkpoint_every, observers)
    control, solver = control or StepControl(), solver or SolverChoice()
    choices = (dt, dataclasses.asdict(control), dataclasses.asdict(solver), chunk)
    observed = [(observer.name, observer.every) for observer in observers]
    run_hash = fingerprint(model, state, *choices, checkpoint_every, observed)
    resumed = None
    run = Checkpoint(state, Position(), empty_record(len(model.ports)), [], {})
    run = _with_observer_states(run, observers)
    if checkpoint is not None and checkpoint.exists():
        run = load_checkpoint(checkpoint, run, run_hash, numerics)
        resumed = run.position.tick // stride(0, control)
        if resumed > n_steps:
            raise _too_long(checkpoint, resumed, n_steps, dt)
        _restore(observers, resumed, run)
    else:
        run = _observed(0, model, run, observers)
    periods = [chunk, checkpoint_every, *(observer.every for observer in observers)]
    steppers: dict[int, Stepper] = {}
    reached = run
    whole = stride(0, control)
    try:
        while (done := run.position.tick // whole) < n_steps:
            stop = min(n_steps, *((done // every + 1) * every for every in periods))
            reached = run
            while reached.position.tick < stop * whole:
                stepper = _stepper(reached.position.level, steppers, dt, model, solver)
                reached = _advanced(stop, model, reached, stepper, control, chunk)
                if progress is not None:
                    progress(_progress_record(n_steps, model, reached, control, dt))
            run = _observed(stop, model, reached, observers)
            if checkpoint is not None and (stop % checkpoint_every == 0 or stop == n_steps):
                save_checkpoint(checkpoint, run, run_hash, numerics)
    except (KeyboardInterrupt, StepFailure) as stop_of_run:
        if checkpoint is not None:
            save_checkpoint(checkpoint, run, run_hash, numerics)
        if isinstance(stop_of_run, StepFailure):
            kept = Simulation(reached.state, reached.record, reached.events, resumed)
            raise SimulationError(str(stop_of_run), kept, stop_of_run.collapse) from None
        _restore(observers, run.position.tick // whole, run)
        kept = Simulation(run.state, run.record, run.events, resumed)
        raise SimulationInterrupted(kept) from None
    return Simulation(run.state, run.record, run.events, resumed)


class StepFailure(RuntimeError):
    """A step failed at the smallest length.

    Attributes:
        collapse: see `SimulationError`.
    """

    def __init__(self, message: str, collapse: Collapse | None):
        RuntimeError.__init__(self, message)
        self.collapse = collapse


def _check(
    n_steps: int, chunk: int, checkpoint_every: int, observers: Sequence[AbstractObserver]
) -> None:
    numbers = {"n_steps": n_steps, "chunk": chunk, "checkpoint_every": checkpoint_every}
    numbers |= {f"every of {observer.name}": observer.every for observer in observers}
    bad = [f"{name} = {value}" for name, value in numbers.items() if value < 1]
    if bad:
        raise ValueError(f"{', '.join(bad)}: not above zero. Give whole numbers of steps.")
    names = [observer.name for observer in observers]
    if len(set(names)) != len(names):
        raise ValueError(f"two observers have one name: {', '.join(names)}. Name them apart.")


def _too_long(path: pathlib.Path, held: int, n_steps: int, dt: float) -> CheckpointError:
    """The refusal of a checkpoint with more steps than are wanted."""
    return CheckpointError(
        path,
        f"holds a longer run: {held} steps, {held * dt:.6g} s, where {n_steps} steps,"
        f" {n_steps * dt:.6g} s, were asked for",
        "Ask for at least as many, or start again in another folder.",
        held,
    )


def _restore(observers: Sequence[AbstractObserver], step: int, run: Checkpoint) -> None:
    """Take the observers to where they were at a checkpoint after a whole step."""
    for observer in observers:
        observer.restore(step, run.observer_states[observer.name])


def _observed(
    step: int, model: Model, run: Checkpoint, observers: Sequence[AbstractObserver]
) -> Checkpoint:
    """Show a state to the observers whose turn it is; the run with what they know then."""
    for observer in observers:
        if step % observer.every == 0:
            observer.observe(step, model, run.state)
    return _with_observer_states(run, observers)


def _with_observer_states(run: Checkpoint, observers: Sequence[AbstractObserver]) -> Checkpoint:
    """The run with what the observers know now."""
    return run._replace(
        observer_states={observer.name: observer.saved_state() for observer in observers}
    )


def _stepper(
    level: int, steppers: dict[int, Stepper], dt: float, model: Model, solver: SolverChoice
) -> Stepper:
    """The stepper of a level; that of whole steps and the last other one are kept."""
    if level not in steppers:
        for other in [k for k in steppers if k != 0]:
            del steppers[other]
        steppers[level] = prepare(dt / 2**level, model, **dataclasses.asdict(solver))
    return steppers[level]


def _advanced(
    stop: int, model: Model, run: Checkpoint, stepper: Stepper, control: StepControl, chunk: int
) -> Checkpoint:
    """The run after a chunk that ends at a whole step at the latest.

    Raises:
        StepFailure: a step failed at the deepest level.
    """
    before = run.position
    limit = np.inf if control.change_limit is None else control.change_limit
    if before.level == control.max_halvings:
        limit = np.inf
    n_steps = min(chunk, steps_to(stop, before, control))
    end = advance_chunk(
        model, run.state, stepper, jnp.asarray(n_steps), jnp.asarray(limit, float), chunk
    )
    n_good = int(end.n_steps)
    failed = not bool(end.result == RESULTS.successful)
    record = _joined_rows(run, end, n_good, stepper, control)
    events = run.events
    if failed:
        event = _event(end, n_good, before, stepper, control)
        if before.level == control.max_halvings:
            raise _failure(event, model, end)
        events = [*events, event]
    largest = float(np.max(record.change[len(record.change) - n_good :], initial=0.0))
    after = after_steps(n_good, failed or bool(end.coarse), largest, before, control)
    state = _rescaled(end.state, 2.0 ** (before.level - after.level))
    return Checkpoint(state, after, record, events, run.observer_states)


def _rescaled(state: State, ratio: float) -> State:
    """The state for steps of another length: extrapolation over a step keeps its slope in time.

    Args:
        state: the state.
        ratio: new length of a step over the old one.
    """
    if ratio == 1.0:
        return state
    return state._replace(
        u_before=state.u - ratio * (state.u - state.u_before),
        p_before=state.p - ratio * (state.p - state.p_before),
        d_before=state.d - ratio * (state.d - state.d_before),
        start=Start(ratio**2 * state.start.u, ratio**2 * state.start.p, state.start.remainder),
    )


def _joined_rows(
    run: Checkpoint, end: Chunk, n_good: int, stepper: Stepper, control: StepControl
) -> StepHistory:
    history, report = end.history, end.history.report
    ticks = run.position.tick + stride(run.position.level, control) * np.arange(1, n_good + 1)
    rows = StepHistory(
        ticks / stride(0, control),
        np.asarray(history.t)[:n_good],
        np.full(n_good, float(stepper.dt)),
        np.asarray(history.P_port)[:n_good],
        np.asarray(history.Q_port)[:n_good],
        np.asarray(report.n_gmres)[:n_good],
        np.asarray(report.n_newton)[:n_good],
        np.asarray(report.residual)[:n_good],
        np.asarray(report.min_volume_ratio)[:n_good],
        np.asarray(end.change)[:n_good],
    )
    return joined([run.record, rows])


def _event(
    end: Chunk, n_good: int, before: Position, stepper: Stepper, control: StepControl
) -> dict[str, Any]:
    """A failed step in words."""
    at = before.tick + n_good * stride(before.level, control)
    return {
        "step": at / stride(0, control),
        "t_s": float(end.state.t),
        "dt_s": float(stepper.dt),
        "cause": RESULTS[end.result],
    }


def _failure(event: dict[str, Any], model: Model, end: Chunk) -> StepFailure:
    """The failure of a step at the deepest level."""
    inverted = bool(end.result == RESULTS.inverted)
    found = collapse(model, end.state) if inverted else None
    if found is not None:
        return StepFailure(found.sentence, found)
    return StepFailure(
        f"Step {int(event['step']) + 1} failed at t = {event['t_s']:.6g} s, also with a step of"
        f" {event['dt_s']:.3g} s. {event['cause']}{snapping(model, end.state)}",
        None,
    )


def _progress_record(
    n_steps: int, model: Model, run: Checkpoint, control: StepControl, dt: float
) -> ProgressRecord:
    effort = run.record.n_gmres
    return ProgressRecord(
        whole_steps(run.position, control),
        n_steps,
        float(run.state.t),
        dt / 2**run.position.level,
        model.names,
        np.asarray(run.state.P_port),
        np.asarray(run.state.Q_port),
        int(effort[-1]) if len(effort) else 0,
        run.record,
    )
