"""Derivative of a 3D pressure ratio with respect to everything in the model and its start.

The ratio of a run is that of the means over its last cycle::

    r = Σ P_distal / Σ P_aorta,    ∂r = Σ (∂P_distal − r ∂P_aorta) / Σ P_aorta

summed over equal steps. One sweep in reverse mode gives ∂r by every number of the model (moduli,
boundary blocks, prestress, node positions) and of the state at the start. What a parameter does to
these is cheap, and multiplied with it afterwards.

The steps go in chunks. The first sweep keeps the state at the start of each; the second takes them
from the last to the first, solves each again and then its transposed equations. Memory is that of
one chunk, progress is told after each, and what is gathered can be kept, so that an interrupted
sweep goes on.

Source: reverse accumulation with checkpoints, Griewank 1992, Optim. Methods Softw. 1:35.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.step import RESULTS, advance_step
from jaxfsi.core.step.stepper import Stepper


class RatioSensors(eqx.Module):
    """Where the two pressures of a ratio are read.

    Attributes:
        aorta: nodes of the blood whose mean is the aortic pressure; None: at the port `inlet`.
        distal: index of the port of the distal pressure (static).
        inlet: index of the port of the aortic inlet (static).
    """

    aorta: Int[Array, " nodes"] | None
    distal: int = eqx.field(static=True)
    inlet: int = eqx.field(static=True)

    def __call__(self, state: State) -> Float[Array, " 2"]:
        """Aortic and distal pressure of a state [dyn/cm²]."""
        aorta = state.P_port[self.inlet] if self.aorta is None else jnp.mean(state.p[self.aorta])
        return jnp.stack([aorta, state.P_port[self.distal]])


class Part(NamedTuple):
    """A chunk of steps.

    Attributes:
        state: at its end.
        sums: of aortic and distal pressure over its steps [dyn/cm²].
        results: of its steps, see `RESULTS`.
    """

    state: State
    sums: Float[Array, " 2"]
    results: RESULTS


class RatioGradient(NamedTuple):
    """A ratio and its derivative.

    Attributes:
        ratio: mean distal over mean aortic pressure [-].
        P_aorta: mean over the last cycle [dyn/cm²].
        P_distal: mean over the last cycle [dyn/cm²].
        model: derivative of the ratio by each number of the model.
        state: derivative by each number of the state at the start.
    """

    ratio: float
    P_aorta: float
    P_distal: float
    model: Model
    state: State


class SweepStore(Protocol):
    """Where a sweep keeps what it has gathered, to go on from after an interruption."""

    def load(self) -> dict[str, np.ndarray] | None:
        """What was kept, or None."""
        ...

    def save(self, arrays: dict[str, np.ndarray]) -> None:
        """Keep this in place of what was kept before."""
        ...


Tell = Callable[[str, int, int], None]
"""Told after each chunk: which sweep, chunks done, chunks in all."""


@eqx.filter_jit
def advance_part(
    model: Model, state: State, stepper: Stepper, reading: RatioSensors, n_steps: int
) -> Part:
    """Take a chunk of equal steps.

    Args:
        model: the model.
        state: state at its start.
        stepper: see `jaxfsi.core.step.stepper.prepare`.
        reading: where pressures are read.
        n_steps: steps of the chunk (static).
    """

    def one(before: State, _):
        after, report = advance_step(model, before, stepper)
        return after, (reading(after), report.result)

    end, (pressures, results) = jax.lax.scan(one, state, length=n_steps)
    return Part(end, jnp.sum(pressures, axis=0), results)


@eqx.filter_jit
def _pulled(
    model: Model,
    state: State,
    stepper: Stepper,
    reading: RatioSensors,
    n_steps: int,
    by_end: State,
    by_sums: Float[Array, " 2"],
) -> tuple[Model, State]:
    """Derivative by model and start of a chunk, from that by its end and its sums."""
    numbers, rest = eqx.partition((model, state), eqx.is_inexact_array)

    def part(numbers: tuple[Model, State]) -> tuple[State, Float[Array, " 2"]]:
        model, state = eqx.combine(numbers, rest)
        found = advance_part(model, state, stepper, reading, n_steps)
        return found.state, found.sums

    return jax.vjp(part, numbers)[1]((by_end, by_sums))[0]


def ratio_gradient(
    model: Model,
    state: State,
    stepper: Stepper,
    reading: RatioSensors,
    *,
    n_steps: int,
    per_cycle: int | None = None,
    chunk: int = 10,
    kept: SweepStore | None = None,
    tell: Tell | None = None,
) -> RatioGradient:
    """Ratio of a run and its derivative by model and start.

    Args:
        model: the model; its numbers must be concrete.
        state: state at the start.
        stepper: see `jaxfsi.core.step.stepper.prepare`; the transposed systems are solved to a
            tenth of its tolerance and need more iterations (`max_iterations`) than a step.
        reading: where pressures are read.
        n_steps: steps of the run.
        per_cycle: steps of its last cycle, whose means count; None: all.
        chunk: steps of a chunk; divides both numbers of steps.
        kept: where what is gathered is kept; None: nowhere.
        tell: told of each chunk.

    Raises:
        ValueError: the chunk does not divide the numbers of steps.
        RuntimeError: a step failed, or a transposed system was not solved.
    """
    counted = n_steps if per_cycle is None else per_cycle
    if chunk < 1 or n_steps % chunk or counted % chunk or not 0 < counted <= n_steps:
        raise ValueError(
            f"{n_steps} steps with {counted} in the last cycle cannot be cut into chunks of"
            f" {chunk}. Take a chunk that divides both."
        )
    tell = tell or (lambda *_: None)
    n_parts, first = n_steps // chunk, (n_steps - counted) // chunk
    starts, sums = [state], jnp.zeros(2)
    for k in range(n_parts):
        part = advance_part(model, starts[-1], stepper, reading, chunk)
        _check_steps(part, k * chunk)
        starts.append(part.state)
        sums = sums + (part.sums if k >= first else 0.0)
        tell("forwards", k + 1, n_parts)
    ratio = sums[1] / sums[0]
    by_sums = jnp.stack([-ratio, jnp.ones(())]) / sums[0]
    zero = jax.tree.map(jnp.zeros_like, eqx.filter((model, starts.pop()), eqx.is_inexact_array))
    gathered = _kept_before(_Gathered(n_parts, *zero), kept)
    for k in range(gathered.left - 1, -1, -1):
        own = by_sums if k >= first else jnp.zeros(2)
        by_model, by_state = _pulled(
            model, starts[k], stepper, reading, chunk, gathered.by_state, own
        )
        gathered = _Gathered(k, jax.tree.map(jnp.add, gathered.by_model, by_model), by_state)
        if not all(bool(jnp.all(jnp.isfinite(a))) for a in jax.tree.leaves(by_state)):
            raise RuntimeError(
                f"A transposed system of the steps {k * chunk + 1} to {(k + 1) * chunk} was not"
                " solved. Allow more iterations (max_iterations) or take a smaller dt."
            )
        if kept is not None:
            kept.save({str(i): np.asarray(a) for i, a in enumerate(jax.tree.leaves(gathered))})
        tell("backwards", n_parts - k, n_parts)
    means = np.asarray(sums) / counted
    P_aorta, P_distal = means.tolist()
    return RatioGradient(float(ratio), P_aorta, P_distal, gathered.by_model, gathered.by_state)


class _Gathered(NamedTuple):
    """What the second sweep knows.

    Attributes:
        left: chunks that are left.
        by_model: derivative by the model through the chunks done.
        by_state: derivative by the state at their start.
    """

    left: int
    by_model: Model
    by_state: State


def _check_steps(part: Part, done: int) -> None:
    failed = np.flatnonzero(~np.asarray(part.results == RESULTS.successful))
    if len(failed):
        first = int(failed[0])
        cause = jax.tree.map(lambda values: values[first], part.results)
        raise RuntimeError(
            f"Step {done + first + 1} failed, and a derivative needs equal steps. {RESULTS[cause]}"
        )


def _kept_before(gathered: _Gathered, kept: SweepStore | None) -> _Gathered:
    """What an earlier sweep of the same run kept, if anything."""
    found: dict[str, Any] | None = None if kept is None else kept.load()
    leaves, tree = jax.tree.flatten(gathered)
    if found is None or len(found) != len(leaves):
        return gathered
    old = [found[str(i)] for i in range(len(leaves))]
    if any(np.shape(a) != np.shape(b) for a, b in zip(old, leaves, strict=True)):
        return gathered
    return jax.tree.unflatten(tree, [int(old[0]), *map(jnp.asarray, old[1:])])
