"""A chunk of steps in one compiled call that ends early where a step fails or is too coarse.

How many steps to take is a number, not a shape: every chunk of a run is the same program.

The change of a step measures how far its solution lies from the linear extrapolation on which its
geometry, convective velocity and stabilisation rest::

    c = ‖u⁺ − (2u − u⁻)‖ / (‖u⁺‖ + u₀)  ≈  dt² ‖∂²u/∂t²‖ / (‖u‖ + u₀)

with root mean squares over the nodes.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.step.march import History
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.step import RESULTS, advance_step, no_report
from jaxfsi.core.step.stepper import Stepper

VELOCITY_SCALE = 1.0
"""u₀: velocities far below it are not resolved in time for their own sake [cm/s]."""


class Chunk(NamedTuple):
    """Result of a chunk.

    Attributes:
        state: after its last good step.
        history: of its steps; rows from `n_steps` on say nothing.
        change: of each step, see above.
        n_steps: steps that succeeded.
        result: how the last step went.
        coarse: whether it ended because the change of the last step was above the limit.
    """

    state: State
    history: History
    change: Float[Array, " steps"]
    n_steps: Int[Array, ""]
    result: RESULTS
    coarse: Bool[Array, ""]


@eqx.filter_jit
def advance_chunk(
    model: Model,
    state: State,
    stepper: Stepper,
    n_steps: Int[Array, ""],
    change_limit: Float[Array, ""],
    size: int,
) -> Chunk:
    """Advance a state by up to `n_steps` steps.

    Args:
        model: the model.
        state: state at the start.
        stepper: see `prepare`.
        n_steps: steps to take, at most `size`.
        change_limit: a step with more change is the last one.
        size: rows of the history (static).
    """
    n_ports = len(model.ports)
    empty = History(
        jnp.zeros(size),
        jnp.zeros((size, n_ports)),
        jnp.zeros((size, n_ports)),
        jax.tree.map(lambda r: jnp.zeros((size, *r.shape), r.dtype), no_report()),
    )
    start = Chunk(
        state,
        empty,
        jnp.zeros(size),
        jnp.zeros((), int),
        RESULTS.successful,
        jnp.zeros((), bool),
    )

    def proceed(c: Chunk):
        return (c.n_steps < n_steps) & (c.result == RESULTS.successful) & ~c.coarse

    def advance(c: Chunk) -> Chunk:
        after, report = advance_step(model, c.state, stepper)
        good = report.result == RESULTS.successful
        kept = jax.tree.map(lambda new, old: jnp.where(good, new, old), after, c.state)
        change = _change(c.state, after)
        k = c.n_steps
        row = History(after.t, after.P_port, after.Q_port, report)
        history = jax.tree.map(lambda rows, value: rows.at[k].set(value), c.history, row)
        return Chunk(
            kept,
            history,
            c.change.at[k].set(change),
            jnp.where(good, k + 1, k),
            report.result,
            good & (change > change_limit),
        )

    return jax.lax.while_loop(proceed, advance, start)


def _change(before: State, after: State) -> Float[Array, ""]:
    def size(u):
        return jnp.sqrt(jnp.mean(u[0] ** 2 + u[1] ** 2 + u[2] ** 2))

    ahead = 2.0 * before.u - before.u_before
    return size(after.u - ahead) / (size(after.u) + VELOCITY_SCALE)
