"""Many steps in one compiled loop, with what happened at the ports.

A failed step ends the march: the state stays as it was before that step, and the result says why.
For reverse-mode derivatives the state after every step is kept, which for 60 000 elements takes
2 MB a step, and nothing is solved twice. With `recompute` only the states at the start of groups of
steps are kept and the groups are run again: memory grows with the square root of the number of
steps, and a gradient takes one more run (two-level checkpointing, Griewank 1992).
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.step import RESULTS, StepReport, advance_step, no_report
from jaxfsi.core.step.stepper import Stepper
from lumped.parameters import is_traced


class History(NamedTuple):
    """What happened at each step.

    Attributes:
        t: time at its end [s].
        P_port: mean pressure of each port [dyn/cm²].
        Q_port: flow out of each port [cm³/s].
        report: how it went.
    """

    t: Float[Array, " steps"]
    P_port: Float[Array, "steps ports"]
    Q_port: Float[Array, "steps ports"]
    report: StepReport


class March(NamedTuple):
    """Result of a march.

    Attributes:
        state: at its end, or before the step that failed.
        history: of all steps; those after a failure repeat it.
        n_steps: steps that succeeded.
        result: see `RESULTS`.
    """

    state: State
    history: History
    n_steps: Int[Array, ""]
    result: RESULTS


def march(
    model: Model,
    state: State,
    stepper: Stepper,
    n_steps: int,
    *,
    throw: bool = True,
    recompute: bool = False,
) -> March:
    """Advance a state by a number of steps.

    Args:
        model: the model.
        state: state at the start.
        stepper: see `prepare`.
        n_steps: number of steps (static).
        throw: raise where a step fails; otherwise the result says so.
        recompute: save memory in reverse mode at the price of time (static).

    Raises:
        ValueError: the stepper is that of another mesh.
        RuntimeError: a step failed and `throw` is set.
    """
    made_for, nodes = stepper.preconditioner.velocity_scale.shape[-1], model.x.shape[-1]
    if made_for != nodes:
        raise ValueError(
            f"the stepper was prepared for {made_for} nodes, and the model has {nodes}. Call"
            " prepare(dt, model) with a model on this mesh."
        )
    end = _march(model, state, stepper, n_steps, recompute)
    if throw and not is_traced(end.n_steps) and int(end.n_steps) < n_steps:
        raise RuntimeError(
            f"Step {int(end.n_steps) + 1} of {n_steps} failed at t ="
            f" {float(end.state.t):.6g} s. {RESULTS[end.result]}"
        )
    return end


@eqx.filter_jit
def _march(model: Model, state: State, stepper: Stepper, n_steps: int, recompute: bool) -> March:
    def one(carry, index):
        before, done, result, last = carry
        running = (result == RESULTS.successful) & (index < n_steps)
        after, report = advance_step(model, before, stepper, running)
        report = jax.tree.map(lambda new, old: jnp.where(running, new, old), report, last)
        good = running & (report.result == RESULTS.successful)
        kept = jax.tree.map(lambda new, old: jnp.where(good, new, old), after, before)
        result = RESULTS.where(running, report.result, result)
        entry = History(kept.t, kept.P_port, kept.Q_port, report)
        return (kept, done + good.astype(int), result, report), entry

    # One compiled step serves all: the last group is filled up with steps that do nothing.
    inner = max(1, math.isqrt(n_steps) if recompute else n_steps)
    outer = -(-n_steps // inner)
    index = jnp.arange(outer * inner).reshape(outer, inner)
    zero = jnp.zeros((), int)
    start = (_filled(state, model, stepper), zero, RESULTS.successful, no_report())

    def group(carry, indices):
        return jax.lax.scan(one, carry, indices)

    if outer == 1:
        (state, done, result, _), history = group(start, index[0])
    else:
        (state, done, result, _), history = jax.lax.scan(jax.checkpoint(group), start, index)
        history = jax.tree.map(lambda h: h.reshape(outer * inner, *h.shape[2:])[:n_steps], history)
    return March(state, history, done, result)


@eqx.filter_custom_jvp
def _filled(state: State, model: Model, stepper: Stepper) -> State:
    """The state, where all that a step changes has a tangent if anything has.

    JAX differentiates a loop again for each pass after which more of its carry has a tangent:
    three times from a state that has none.
    """
    del model, stepper
    return state


@_filled.def_jvp
def _(primals, tangents):
    state, _, stepper = primals
    zero = 0.0 * sum(jnp.sum(change) for change in jax.tree.leaves(tangents))
    change = tangents[0]

    def changed(s: State):
        mesh = () if stepper.motion is None else (s.d_mesh,)
        fields = (s.u, s.a, s.d, s.p, s.u_before, s.p_before, s.d_before, *mesh)
        return (*fields, *s.blocks, s.P_port, s.Q_port)

    full = tuple(
        jnp.broadcast_to(zero, value.shape) if tangent is None else tangent
        for value, tangent in zip(changed(state), changed(change), strict=True)
    )
    return state, eqx.tree_at(changed, change, full, is_leaf=lambda leaf: leaf is None)
