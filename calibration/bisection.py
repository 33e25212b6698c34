"""Bisection for α: the paper's method, kept as a reference for the Newton calibration.

It halves a bracket of log α by the sign of ratio(α) − target. On the periodic state it is right to
its tolerance; on a few cycles run from rest, as simulation codes are used, it is not: where the
network remembers (large α) four cycles miss α by several per cent. `ratio_after_cycles` exists to
show that.
"""

from collections.abc import Callable
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from calibration.alpha import AlphaFit, answerable, checked_fit, require_feasible
from lumped import (
    RESULTS,
    AbstractPeriodicSolver,
    HaemodynamicCondition,
    Surrogate,
    pressure_ratio,
    raise_unless_successful,
    solve_periodic,
    state_space,
)
from lumped.parameters import Parameter, in_range, nan_unless
from lumped.results import as_result

RatioModel = Callable[[Surrogate, HaemodynamicCondition], Array]


def ratio_of_periodic_state(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    *,
    solver: AbstractPeriodicSolver | None = None,
) -> Float[Array, ""]:
    """Pressure ratio of the surrogate's periodic state."""
    network = surrogate.network(condition)
    return pressure_ratio(solve_periodic(network, condition.period, solver, throw=False))


def ratio_after_cycles(
    surrogate: Surrogate, condition: HaemodynamicCondition, *, cycles: int = 4, n_steps: int = 200
) -> Float[Array, ""]:
    """Pressure ratio of the last of a few cycles run from diastolic pressure and no flow.

    Backward Euler with equal steps, as the established codes' lumped models are stepped:

        (I − dt A) x(t + dt) = x(t) + dt B v(t + dt).

    Not converged; linear surrogates only. NaN where a traced parameter lies outside its range.

    Raises:
        ValueError: the surrogate has a quadratic loss, or there is no cycle or no step.
    """
    if cycles < 1 or n_steps < 1:
        raise ValueError(f"{n_steps} steps in {cycles} cycles: both must be at least 1. Give more.")
    network = surrogate.network(condition)
    system = state_space(network)
    dt = condition.period / n_steps
    ts = dt * (1.0 + jnp.arange(n_steps, dtype=float))
    v = system.sources(ts)
    n = network.n_states
    inverse = jnp.linalg.inv(jnp.eye(n) - dt * system.A)
    push = dt * v @ (inverse @ system.B).T

    def advance(x: Array, forcing: Array) -> tuple[Array, Array]:
        x = inverse @ x + forcing
        return x, x

    def cycle(_: Any, x: Array) -> Array:
        return jax.lax.scan(advance, x, push)[0]

    start = jnp.full(n, condition.P_diastolic).at[n - 1].set(0.0)
    _, x = jax.lax.scan(advance, jax.lax.fori_loop(0, cycles - 1, cycle, start), push)
    w = x @ system.C.T + v @ system.D.T
    mean = jnp.concatenate([jnp.mean(x, axis=0), jnp.mean(w, axis=0)])
    ratio = mean[network.pressure_index("distal")] / mean[network.pressure_index("aorta")]
    return ratio * nan_unless(in_range((condition, network)))


def bisect_alpha(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    target: Parameter,
    *,
    solver: AbstractPeriodicSolver | None = None,
    bracket: tuple[float, float] = (1e-4, 1e4),
    tolerance: float = 1e-12,
    ratio: RatioModel | None = None,
    throw: bool = True,
) -> AlphaFit:
    """Find α by bisection of log α.

    Args:
        surrogate: the patient; its own `alpha` is not used.
        condition: the resting condition.
        target: measured resting pressure ratio.
        solver: for the periodic state; by default the one `solve_periodic` chooses.
        bracket: α values whose ratios enclose the target.
        tolerance: of log α.
        ratio: another model of the ratio, for example `ratio_after_cycles`.
        throw: raise when the bracket does not hold the root (outside jit). With False look at
            `result`: α and ratio are NaN where it is a failure.

    Raises:
        ValueError: no α can reach the ratio (outside jit), or the bracket is not one.
        RuntimeError: the bracket does not enclose the root.
    """
    if throw:
        require_feasible(surrogate, condition, target)
    low_end, high_end = bracket
    if not (0.0 < low_end < high_end < float("inf")):
        raise ValueError(f"The bracket {bracket} of α must be two positive numbers, ascending.")

    def model(patient, state):
        if ratio is not None:
            return ratio(patient, state)
        return ratio_of_periodic_state(patient, state, solver=solver)

    def mismatch(log_alpha, args):
        patient, state, goal = args
        patient = eqx.tree_at(lambda s: s.alpha, patient, jnp.exp(log_alpha))
        return model(patient, state) - goal

    low, high = jnp.log(jnp.asarray(bracket[0], float)), jnp.log(jnp.asarray(bracket[1], float))
    args = (surrogate, condition, jnp.asarray(target, float))
    # FFR rises with α: given this, optimistix bisects without raising inside jit; a bracket without
    # a root ends at one of its ends, which the reached ratio shows
    bisection = optx.Bisection(rtol=tolerance, atol=tolerance, flip=False)
    options = {"lower": low, "upper": high}
    solution = optx.root_find(
        mismatch, bisection, 0.5 * (low + high), args, options=options, max_steps=100, throw=False
    )
    missed = mismatch(solution.value, args)
    result = RESULTS.where(
        jnp.abs(missed) < jnp.maximum(1e-6, tolerance),
        as_result(solution.result),
        cast(Any, RESULTS.nonlinear_divergence),
    )
    found = AlphaFit(
        alpha=jnp.exp(solution.value),
        ratio=missed + args[2],
        iterations=solution.stats["num_steps"],
        result=result,
    )
    in_order, reachable = answerable(surrogate, condition, args[2])
    fit = checked_fit(found, in_order, reachable, args)
    if throw:
        raise_unless_successful(fit.result, "Widen the bracket of α.")
    return fit
