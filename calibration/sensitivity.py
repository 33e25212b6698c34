"""Sensitivity of a pressure ratio to the parameters, at fixed α and through the calibration.

All are logarithmic derivatives, ∂ log r / ∂ log p: the per cent by which the ratio r moves when the
parameter p grows by one per cent. With α tuned so that the resting ratio r₀(α, p) keeps its
measured value m, the implicit-function theorem gives

    d log α / d log p = − (∂ log r₀/∂ log p) / (∂ log r₀/∂ log α),
    d log α / d log m = 1 / (∂ log r₀/∂ log α),
    d log r / d log p = ∂ log r/∂ log p + (∂ log r/∂ log α) (d log α/d log p).

For the linear surrogate with P_venous = 0 all of them follow from the divider: waveform, period
and compliances do not enter, and R0 only through the calibration's α ∝ R0, so that its total
derivative is zero.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped import (
    AbstractPeriodicSolver,
    HaemodynamicCondition,
    Metrics,
    Network,
    PeriodicSolution,
    Shooting,
    StressRule,
    Surrogate,
    aligned_times,
    march,
    mean_state,
    metrics,
    solve_periodic,
)
from lumped.nominal import NOMINAL
from lumped.parameters import Parameter

REST_RULE = StressRule(R_2=1.0, C_a=1.0, C_im=1.0, R_distal=1.0, C=1.0)
"""The stress rule that changes nothing: at rest the same compiled function serves."""

STRESS_PREFIX = "stress_"
"""Begins the name of a stress factor, `stress_R_2`."""


class RatioResponse(NamedTuple):
    """A periodic state, its numbers, and the derivatives of its pressure ratio.

    Attributes:
        solution: the periodic state.
        metrics: the numbers read off it.
        sensitivity: ∂ log ratio / ∂ log parameter at fixed α [-], by name: R0, K (where there is
            one), alpha, C0, R_1, R_2, R_3, C_a, C_im, P_venous, im_factor, P_systolic,
            P_diastolic, period, and stress_R_1, ... for the factors of the rule.
    """

    solution: PeriodicSolution
    metrics: Metrics
    sensitivity: dict[str, Float[Array, ""]]


def ratio_response(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    *,
    rule: StressRule = REST_RULE,
    solver: AbstractPeriodicSolver | None = None,
) -> RatioResponse:
    """Solve a surrogate in a condition and differentiate its pressure ratio; for use under jit.

    Args:
        surrogate: the surrogate, α included.
        condition: pressures and cycle length.
        rule: stress rule; by default rest.
        solver: periodic solver, as in `solve_periodic`.

    Returns:
        The response; whether the solver succeeded is in `solution.result`.
    """
    network = surrogate.network(condition, rule=rule)
    solution = solve_periodic(network, condition.period, solver, throw=False)
    model = (surrogate, condition, rule)
    if network.is_linear:
        slope = jax.grad(_mean_log_ratio)(model, condition)
    else:
        slope = _implicit_slope(model, solution, solver)
    values, slopes = _by_name(model), _by_name(slope)
    sensitivity = {name: values[name] * slopes[name] for name in values}
    return RatioResponse(solution, metrics(solution), sensitivity)


_Model = tuple[Surrogate, HaemodynamicCondition, StressRule]


def _network(model: _Model, nominal: HaemodynamicCondition) -> Network:
    """Network of a model; a measured beat goes along where its condition leaves the nominal one."""
    surrogate, condition, rule = model
    moved = nominal.moved(
        P_systolic=condition.P_systolic,
        P_diastolic=condition.P_diastolic,
        period=condition.period,
    )
    return surrogate.network(moved, rule=rule)


def _mean_log_ratio(model: _Model, nominal: HaemodynamicCondition) -> Array:
    """Log ratio of a linear surrogate, from the direct-current network."""
    network = _network(model, nominal)
    return _log_ratio(network, mean_state(network, model[1].period))


def _implicit_slope(
    model: _Model, solution: PeriodicSolution, solver: AbstractPeriodicSolver | None
) -> _Model:
    """∂ log ratio/∂(every leaf of the model), with the periodic start found by x(T; x₀, p) = x₀.

        d log r/dp = ∂ log r/∂p + ∂ log r/∂x₀ (I − ∂x(T)/∂x₀)⁻¹ ∂x(T)/∂p,

    from one marched cycle. Written out here because it needs no second root solve, and leaves no
    host callback in the compiled function, which would keep it out of the compilation cache.
    """
    scheme = solver if isinstance(solver, Shooting) else Shooting()
    start = jax.lax.stop_gradient(solution.initial)
    n = solution.network.n_states

    nominal = model[1]

    def cycle(model: _Model, x: Array) -> tuple[Array, Array]:
        network = _network(model, nominal)
        ts = aligned_times(network, model[1].period, scheme.n_steps)
        path = march(ts, network, start.at[:n].set(x), order=scheme.order)
        return path.z[-1, :n], _log_ratio(network, path.integral)

    (end_model, end_x), (ratio_model, ratio_x) = jax.jacrev(cycle, argnums=(0, 1))(model, start[:n])
    adjoint = jnp.linalg.solve((jnp.eye(n) - end_x).T, ratio_x)
    return jax.tree.map(
        lambda direct, through: direct + jnp.tensordot(adjoint, through, axes=1),
        ratio_model,
        end_model,
    )


def _log_ratio(network: Network, mean: Array) -> Array:
    """Log of mean distal over mean aortic pressure, from the means (or integrals) of a cycle."""
    distal, aorta = network.pressure_index("distal"), network.pressure_index("aorta")
    return jnp.log(mean[distal] / mean[aorta])


def alpha_response(rest: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """D log α / d log parameter, the measured resting ratio kept; of `rest_ratio` itself as well.

    Args:
        rest: sensitivity of the resting ratio at the calibrated α.
    """
    per_alpha = rest["alpha"]
    moved = {
        name: -slope / per_alpha
        for name, slope in rest.items()
        if name != "alpha" and not name.startswith(STRESS_PREFIX)
    }
    return {**moved, "rest_ratio": 1.0 / per_alpha}


SHARED = ("R0", "K", "C0", *NOMINAL, "P_venous", "im_factor")
"""Parameters that rest and stress have in common; pressures and period each have their own."""


def through_calibration(
    stress: Mapping[str, Parameter], rest: Mapping[str, Parameter]
) -> dict[str, Parameter]:
    """D log FFR / d log parameter with α recalibrated to the measured resting ratio.

    Args:
        stress: sensitivity of the ratio under stress at the calibrated α.
        rest: sensitivity of the resting ratio at the same α.

    Returns:
        By name: the shared parameters, `rest_ratio`, the pressures and the period under stress by
        their names and those at rest as `rest_P_systolic`, ..., and the stress factors.
    """
    moved = alpha_response(rest)
    per_alpha = stress["alpha"]
    total = {
        name: slope + (per_alpha * moved[name] if name in SHARED else 0.0)
        for name, slope in stress.items()
        if name != "alpha"
    }
    own = {
        f"rest_{name}": per_alpha * moved[name] for name in ("P_systolic", "P_diastolic", "period")
    }
    return {**total, "rest_ratio": per_alpha * moved["rest_ratio"], **own}


def _by_name(model: _Model) -> dict[str, Array]:
    surrogate, condition, rule = model
    bed = surrogate.coronary
    named = {"R0": surrogate.R0, "K": surrogate.K, "alpha": surrogate.alpha, "C0": surrogate.C0}
    named |= {name: getattr(bed, name) for name in (*NOMINAL, "P_venous", "im_factor")}
    named |= {name: getattr(condition, name) for name in ("P_systolic", "P_diastolic", "period")}
    named |= {f"{STRESS_PREFIX}{name}": getattr(rule, name) for name in NOMINAL}
    return {name: jnp.asarray(value) for name, value in named.items() if value is not None}
