"""The scale factor α of the coronary resistances, from the measured resting pressure ratio.

Three ways, one answer:

- `alpha_closed_form`, exact for the linear surrogate (lumped.surrogate states the theorem):
  α = R0 d / ((1 − d) R_total),  d = (r P̄ − P_venous)/(P̄ − P_venous),  P̄ = mean aortic pressure;
- `calibrate_alpha`, Newton's method on 1/α ↦ 1/ratio, which is affine for the linear surrogate
  without venous pressure (two steps), and nearly so with a quadratic loss. There the periodic state
  and α are found together. Its derivatives follow the implicit-function theorem;
- `calibration.bisection`, the paper's method, kept as a check.

Source: Puelz et al. 2024, algorithm 1.
"""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from lumped import (
    MMHG,
    RESULTS,
    HaemodynamicCondition,
    Network,
    Shooting,
    Surrogate,
    aligned_times,
    averaged,
    march,
    raise_unless_successful,
    scale_resistances,
    waveform_mean,
)
from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.parameters import Parameter, in_range, is_traced, nan_unless, only_if
from lumped.periodic_solution import mean_start, rest_state
from lumped.results import as_result, is_successful
from lumped.sources import PressureSource

TOLERANCE = 1e-13
"""Of 1/α and 1/ratio, relative; Newton's last step is quadratic, so this is round-off."""

MAX_STEPS = 32


class AlphaFit(eqx.Module):
    """A calibrated scale factor.

    Attributes:
        alpha: scale of R_1, R_2 and R_3 [-]; NaN where none was found.
        ratio: pressure ratio reached [-]; NaN likewise.
        iterations: steps or model evaluations taken.
        result: `lumped.RESULTS`, successful or the reason why not.
    """

    alpha: Float[Array, ""]
    ratio: Float[Array, ""]
    iterations: Any
    result: RESULTS = eqx.field(converter=as_result)


def with_alpha(network: Network, alpha: Parameter) -> Network:
    """A surrogate's network with the resistances of its coronary bed multiplied by α."""
    k = network.names.index("coronary")
    bed = scale_resistances(network.elements[k], alpha)
    return eqx.tree_at(lambda n: n.elements[k], network, bed)


def mean_aortic_pressure(surrogate: Surrogate, condition: HaemodynamicCondition) -> Array:
    """Cycle mean of the aortic pressure of a condition [dyn/cm²].

    NaN where a traced number of the condition lies outside its range.
    """
    source = surrogate.network(condition)["inlet"]
    assert isinstance(source, PressureSource)
    usable = in_range((condition, source))
    return waveform_mean(source.waveform, condition.period) * nan_unless(usable)


def require_feasible(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: Parameter
) -> None:
    """Refuse a ratio that no scale factor can reach (concrete values only).

    Raises:
        ValueError: cause and cure.
    """
    if is_traced(target, *jax.tree.leaves((surrogate, condition))):
        return
    R0, ratio = np.asarray(surrogate.R0), np.asarray(target)
    if not np.all(np.isfinite(ratio)):
        raise ValueError(f"The pressure ratio {target} is not finite. Give the measured one.")
    if np.any(ratio >= 1.0):
        raise ValueError(
            f"A pressure ratio of {np.max(ratio):g} cannot be reached: with any resistance "
            "upstream the distal mean lies below the aortic one. A measured value of 1 or more "
            "means no obstruction, or drift of the pressure wire: check the equalisation."
        )
    K = np.asarray(0.0 if surrogate.K is None else surrogate.K)
    if np.any((R0 <= 0.0) & (K <= 0.0)):
        raise ValueError(
            f"R0 = {np.min(R0):g} dyn·s/cm⁵ must be positive: without upstream resistance the "
            "ratio is 1 for every scale factor. Give R0 from a ramp or from the lumen."
        )
    floor = surrogate.coronary.P_venous / mean_aortic_pressure(surrogate, condition)
    if np.any(ratio <= np.asarray(floor)) or np.any(ratio <= 0.0):
        raise ValueError(
            f"A pressure ratio of {np.min(ratio):g} cannot be reached: even without coronary "
            f"resistance the venous pressure keeps it above {np.max(np.asarray(floor)):g}. "
            "Check the ratio and P_venous."
        )


def _reachable(target: Parameter, P_mean: Array, P_venous: Parameter) -> Array:
    """Whether a scale factor exists for a ratio; traceable, False for NaN."""
    above = (target * P_mean > P_venous) & (target > 0.0)
    return above & (target < 1.0) & (P_mean > P_venous) & jnp.isfinite(P_mean)


def alpha_closed_form(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: Parameter
) -> Float[Array, ""]:
    """α of the linear surrogate in closed form; `surrogate.alpha` and `surrogate.K` are not used.

    Under jit and vmap α is NaN where no scale factor reaches the ratio or a parameter lies outside
    its range.

    Args:
        surrogate: R0 [dyn·s/cm⁵], the coronary bed at α = 1 and its venous pressure.
        condition: the resting condition; matters only with a venous pressure.
        target: measured resting pressure ratio, below 1.

    Raises:
        ValueError: no α can reach the ratio (outside jit).
    """
    linear = eqx.tree_at(lambda s: s.K, surrogate, None, is_leaf=lambda leaf: leaf is None)
    require_feasible(linear, condition, target)
    P_mean = mean_aortic_pressure(linear, condition)
    P_venous = surrogate.coronary.P_venous
    usable = _reachable(target, P_mean, P_venous) & (surrogate.R0 > 0.0) & in_range(linear)
    goal = jnp.where(usable, target, 0.5)
    d = (goal * P_mean - P_venous) / (P_mean - P_venous)
    alpha = surrogate.R0 * d / ((1.0 - d) * surrogate.coronary.R_total)
    return alpha * nan_unless(usable)


def calibrate_alpha(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    target: Parameter,
    *,
    solver: Shooting | None = None,
    throw: bool = True,
) -> AlphaFit:
    """Find α such that the surrogate's pressure ratio is the measured one.

    Differentiable in all leaves of the surrogate and the condition and in the target; jit and
    vmap it for batches (`calibrate_many`).

    Args:
        surrogate: the patient; its own `alpha` is not used.
        condition: the resting condition.
        target: measured resting pressure ratio.
        solver: how to march the cycle of a surrogate with quadratic loss; unused without.
        throw: raise when there is no α (outside jit). With False look at `result`.

    Returns:
        α, the ratio it gives, steps taken and the result code; NaN with the reason where there is
        none.

    Raises:
        ValueError: no α can reach the ratio (outside jit).
        RuntimeError: Newton's method did not converge.
    """
    if throw:
        require_feasible(surrogate, condition, target)
    fit = _calibrate(surrogate, condition, jnp.asarray(target, float), solver or Shooting())
    if throw:
        raise_unless_successful(
            fit.result, "Check R0, K and the ratio, or bracket α with `bisect_alpha`."
        )
    return fit


@eqx.filter_jit
def _calibrate(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: Array, solver: Shooting
) -> AlphaFit:
    in_order, reachable = answerable(surrogate, condition, target)
    usable = in_order & reachable
    # a solvable problem spares the solver an endless search, and its adjoint NaN
    patient, state = _usual_unless(usable, surrogate, condition)
    goal = jnp.where(usable, target, 0.9)
    network = patient.network(state)
    if network.is_linear:
        # the means of the patient's own waveforms are known from `answerable`: chosen, not computed
        own = nominal(surrogate).network(condition)
        means = [waveform_mean(w, condition.period) for w in own.waveforms()]
        direct = network.with_sources([jnp.where(usable, mean, 95.0 * MMHG) for mean in means])
        fit = _calibrate_linear(direct, goal)
    else:
        fit = _calibrate_nonlinear(network, state.period, goal, solver)
    return checked_fit(fit, in_order, reachable, (surrogate, condition, target))


def _usual_unless(
    usable: Array, surrogate: Surrogate, condition: HaemodynamicCondition
) -> tuple[Surrogate, HaemodynamicCondition]:
    """The patient at α = 1, with nominal numbers where the input has no solution."""

    def chosen(value: Parameter, number: float) -> Array:
        return jnp.where(usable, value, number)

    names = (*NOMINAL, "P_venous", "im_factor")
    usual = {**NOMINAL, "P_venous": 0.0, "im_factor": 1.0}
    bed = eqx.tree_at(
        lambda b: [getattr(b, name) for name in names],
        surrogate.coronary,
        [chosen(getattr(surrogate.coronary, name), usual[name]) for name in names],
    )
    patient = eqx.tree_at(
        lambda s: (s.R0, s.C0, s.alpha, s.coronary),
        surrogate,
        (chosen(surrogate.R0, 1e3), chosen(surrogate.C0, C0_NOMINAL), jnp.ones(()), bed),
    )
    if surrogate.K is not None:
        patient = eqx.tree_at(lambda s: s.K, patient, chosen(surrogate.K, 100.0))
    state = eqx.tree_at(
        lambda c: (c.P_systolic, c.P_diastolic, c.period),
        condition,
        (
            chosen(condition.P_systolic, 120.0 * MMHG),
            chosen(condition.P_diastolic, 80.0 * MMHG),
            chosen(condition.period, 0.8),
        ),
    )
    return patient, state


def checked_fit(fit: AlphaFit, in_order: Array, reachable: Array, data: Any) -> AlphaFit:
    """The fit with the result code of an input without solution, and NaN where it failed.

    Args:
        fit: what a solver found.
        in_order: whether all numbers of the input lie in their ranges.
        reachable: whether a scale factor exists.
        data: the input, by which derivatives are NaN too.
    """
    result = fit.result
    positive = (fit.alpha > 0.0) | ~is_successful(result)
    result = RESULTS.where(positive, result, cast(Any, RESULTS.nonlinear_divergence))
    result = RESULTS.where(reachable, result, cast(Any, RESULTS.infeasible))
    result = RESULTS.where(in_order, result, cast(Any, RESULTS.outside_range))
    alpha, ratio = only_if(is_successful(result), (fit.alpha, fit.ratio), data)
    return AlphaFit(alpha, ratio, fit.iterations, result)


def answerable(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: Array
) -> tuple[Array, Array]:
    """Whether all numbers lie in their ranges, and whether a scale factor exists; traceable."""
    patient = nominal(surrogate)
    P_mean = mean_aortic_pressure(patient, condition)
    K = jnp.zeros(()) if patient.K is None else patient.K
    obstructed = jnp.maximum(patient.R0, K) > 0.0
    in_order = in_range((patient, condition, patient.network(condition))) & jnp.isfinite(target)
    return in_order, _reachable(target, P_mean, patient.coronary.P_venous) & obstructed


def nominal(surrogate: Surrogate) -> Surrogate:
    """The patient at α = 1."""
    return eqx.tree_at(lambda s: s.alpha, surrogate, jnp.ones(()))


def _calibrate_linear(direct: Network, target: Array) -> AlphaFit:
    """Newton on 1/α ↦ 1/ratio of the direct-current network."""
    aorta, distal = direct.pressure_index("aorta"), direct.pressure_index("distal")

    def ratio(inverse_alpha, model):
        z, _ = rest_state(with_alpha(model, 1.0 / inverse_alpha))
        return z[distal] / z[aorta]

    def mismatch(inverse_alpha, args):
        model, goal = args
        return 1.0 / ratio(inverse_alpha, model) - 1.0 / goal

    newton = optx.Newton(rtol=TOLERANCE, atol=TOLERANCE)
    guess = jax.lax.stop_gradient(1.0 / _steady_alpha(direct, target))
    solution = optx.root_find(
        mismatch, newton, guess, (direct, target), max_steps=MAX_STEPS, throw=False
    )
    return AlphaFit(
        alpha=1.0 / solution.value,
        ratio=ratio(solution.value, direct),
        iterations=solution.stats["num_steps"],
        result=solution.result,
    )


def _steady_alpha(direct: Network, target: Array) -> Array:
    """α under steady flow: the drop (1 − r) P̄ = R0 Q + K Q² gives Q, the bed takes the rest."""
    ostium: Any = direct["ostium"]
    bed: Any = direct["coronary"]
    source: Any = direct["inlet"]
    P_mean = source.waveform(0.0)
    drop = (1.0 - target) * P_mean
    R0 = ostium.R_viscous
    K = 0.0 if ostium.K_stenosis is None else ostium.K_stenosis
    Q = steady_flow(R0, K, drop)
    return (target * P_mean - bed.P_venous) / (Q * bed.R_total)


def steady_flow(R: Parameter, K: Parameter, drop: Parameter) -> Array:
    """Flow Q of a drop R Q + K Q² [cm³/s]; stable for K → 0, where the usual formula cancels."""
    return 2.0 * drop / (R + jnp.sqrt(R**2 + 4.0 * K * drop))


def _calibrate_nonlinear(
    network: Network, period: Parameter, target: Array, solver: Shooting
) -> AlphaFit:
    """Newton on the periodic start x₀ and 1/α together; one marched cycle an evaluation."""
    n = network.n_states
    aorta, distal = network.pressure_index("aorta"), network.pressure_index("distal")
    fix = jax.lax.stop_gradient
    alpha_0 = fix(_steady_alpha(averaged(network, period), target))
    guess = fix(mean_start(with_alpha(network, alpha_0), period))
    scale = jnp.max(jnp.abs(guess))

    def evaluate(unknown, args):
        model, T, _ = args
        x = unknown[:n] * scale
        ts = aligned_times(model, T, solver.n_steps)
        start = jnp.concatenate([x, guess[n:]])
        path = march(ts, with_alpha(model, alpha_0 / unknown[n]), start, order=solver.order)
        return (path.z[-1, :n] - x) / scale, path.integral[distal] / path.integral[aorta]

    def mismatch(unknown, args):
        drift, ratio = evaluate(unknown, args)
        return jnp.append(drift, 1.0 / ratio - 1.0 / args[2])

    args = (network, jnp.asarray(period, float), target)
    newton = optx.Newton(rtol=solver.tolerance, atol=solver.tolerance)
    start = jnp.append(guess[:n] / scale, 1.0)
    solution = optx.root_find(mismatch, newton, start, args, max_steps=MAX_STEPS, throw=False)
    return AlphaFit(
        alpha=alpha_0 / solution.value[n],
        ratio=evaluate(solution.value, args)[1],
        iterations=solution.stats["num_steps"],
        result=solution.result,
    )


def alpha_sensitivities(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: Parameter
) -> dict[str, Float[Array, ""]]:
    """Relative sensitivities d log α / d log p of the calibrated factor, for every datum p.

    A parameter that is zero has no relative change and is given 0.

    Returns:
        By name: the target ratio, R0, C0, K where present, the five coronary parameters, P_venous,
        im_factor and the pressures and period of the condition. Under jit all are NaN where there
        is no α.

    Raises:
        ValueError: no α can reach the ratio (outside jit).
    """
    require_feasible(surrogate, condition, target)

    def log_alpha(data):
        return jnp.log(calibrate_alpha(*data, throw=False).alpha)

    data = (surrogate, condition, jnp.asarray(target, float))
    g_surrogate, g_condition, g_target = eqx.filter_jit(jax.grad(log_alpha))(data)
    pairs = {"ratio": (target, g_target)}
    for name in ("R0", "C0", "K"):
        if getattr(surrogate, name) is not None:
            pairs[name] = (getattr(surrogate, name), getattr(g_surrogate, name))
    for name in ("R_1", "R_2", "R_3", "C_a", "C_im", "P_venous", "im_factor"):
        pairs[name] = (getattr(surrogate.coronary, name), getattr(g_surrogate.coronary, name))
    for name in ("P_systolic", "P_diastolic", "period"):
        pairs[name] = (getattr(condition, name), getattr(g_condition, name))
    return {name: jnp.asarray(value * slope) for name, (value, slope) in pairs.items()}
