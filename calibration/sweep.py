"""Many surrogates at once: over scale factors, patients and conditions.

One jitted call; `calibration.cases` shares the cases out among chunks and devices.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.alpha import AlphaFit, calibrate_alpha
from calibration.cases import length, map_cases
from lumped import (
    RESULTS,
    AbstractPeriodicSolver,
    Fourier,
    HaemodynamicCondition,
    Metrics,
    Shooting,
    StressRule,
    Surrogate,
    metrics,
    solve_periodic,
)
from lumped.parameters import Parameter


class Sweep(eqx.Module):
    """Periodic states of many surrogates.

    Attributes:
        metrics: `lumped.Metrics`, each of shape (cases,).
        error_estimate: of each periodic state [-], shape (cases,).
        result: `lumped.RESULTS` of each; where it is a failure the numbers are NaN.
        t: sample times [s], shape (cases, samples), or None where waveforms were not asked for.
        P_aorta, P_distal: pressures [dyn/cm²], shape (cases, samples), or None.
        Q: flow into the anomalous coronary [cm³/s], shape (cases, samples), or None.
    """

    metrics: Metrics
    error_estimate: Float[Array, "*cases"]
    result: RESULTS
    t: Float[Array, "*cases samples"] | None
    P_aorta: Float[Array, "*cases samples"] | None
    P_distal: Float[Array, "*cases samples"] | None
    Q: Float[Array, "*cases samples"] | None


def simulate_many(
    surrogates: Surrogate,
    conditions: HaemodynamicCondition,
    *,
    rule: StressRule | None = None,
    n_samples: int = 256,
    batch_size: int | None = None,
    waveforms: bool = True,
) -> Sweep:
    """Periodic states of surrogates in their conditions, pair by pair.

    Args:
        surrogates: a surrogate whose array leaves have a leading axis (cases,) or none; leaves
            without are shared by all cases.
        conditions: likewise.
        rule: stress rule, likewise; None at rest.
        n_samples: samples a period.
        batch_size: cases a chunk; None: what suits the device.
        waveforms: keep the waveforms, not only the metrics.

    Returns:
        Metrics and waveforms of all cases; NaN, with the reason in `result`, where there is no
        periodic state.
    """
    return _simulate(
        surrogates, conditions, rule, n_samples=n_samples, batch_size=batch_size, keep=waveforms
    )


@eqx.filter_jit
def _simulate(
    surrogates: Surrogate,
    conditions: HaemodynamicCondition,
    rule: StressRule | None,
    *,
    n_samples: int,
    batch_size: int | None,
    keep: bool,
) -> Sweep:
    solver: AbstractPeriodicSolver = (
        Fourier(n_samples) if surrogates.K is None else Shooting(n_samples)
    )

    def one(case: tuple[Surrogate, HaemodynamicCondition, StressRule | None]) -> Sweep:
        surrogate, condition, stress = case
        network = surrogate.network(condition, rule=stress)
        solution = solve_periodic(network, condition.period, solver, throw=False)
        return Sweep(
            metrics=metrics(solution),
            error_estimate=solution.error_estimate,
            result=solution.result,
            t=solution.t if keep else None,
            P_aorta=solution.pressure("aorta") if keep else None,
            P_distal=solution.pressure("distal") if keep else None,
            Q=solution.flow("ostium") if keep else None,
        )

    return map_cases(one, (surrogates, conditions, rule), batch_size=batch_size)


def sweep_alpha(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    alphas: Float[Array, " n"],
    *,
    rule: StressRule | None = None,
    n_samples: int = 256,
    batch_size: int | None = None,
    waveforms: bool = True,
) -> Sweep:
    """Periodic states of one patient over scale factors.

    Args:
        surrogate: the patient; its own `alpha` is replaced.
        condition: the condition.
        alphas: scale factors [-], shape (n,).
        rule: stress rule, None at rest.
        n_samples: samples a period.
        batch_size: cases a chunk; None: what suits the device.
        waveforms: keep the waveforms, not only the metrics.
    """
    scaled = eqx.tree_at(lambda s: s.alpha, surrogate, jnp.asarray(alphas, float))
    options = {"n_samples": n_samples, "batch_size": batch_size, "waveforms": waveforms}
    return simulate_many(scaled, condition, rule=rule, **options)


def grid(*axes: Any) -> tuple[Any, ...]:
    """All combinations of several batched pytrees, as pytrees with one common leading axis.

    For example ``surrogates, conditions = grid(surrogates, conditions)`` turns 10 patients and 3
    conditions into 30 pairs, the last axis running fastest; reshape results with
    ``x.reshape(10, 3)``. Leaves without a leading axis stay shared.
    """
    counts = [length(axis) for axis in axes]
    index = jnp.meshgrid(*(jnp.arange(count) for count in counts), indexing="ij")
    return tuple(
        jax.tree.map(lambda leaf, k=k: leaf[k.reshape(-1)] if jnp.ndim(leaf) else leaf, axis)
        for axis, k in zip(axes, index, strict=True)
    )


class Calibrations(eqx.Module):
    """Calibrated scale factors of many patients, with their derivatives.

    Attributes:
        fit: α, ratio, iterations and result, each of shape (cases,).
        d_surrogate: ∂α/∂(every leaf of the surrogate), same structure, or None.
        d_condition: ∂α/∂(every leaf of the condition), or None.
        d_target: ∂α/∂target, shape (cases,), or None.
    """

    fit: AlphaFit
    d_surrogate: Surrogate | None
    d_condition: HaemodynamicCondition | None
    d_target: Float[Array, "*cases"] | None


def calibrate_many(
    surrogates: Surrogate,
    conditions: HaemodynamicCondition,
    targets: Parameter,
    *,
    derivatives: bool = False,
    batch_size: int | None = None,
) -> Calibrations:
    """Calibrate α for many patients at once.

    Args:
        surrogates: a surrogate whose leaves have a leading axis (cases,) or none.
        conditions: likewise.
        targets: measured resting pressure ratios, shape (cases,).
        derivatives: also the exact derivatives of every α with respect to all of its data.
        batch_size: cases a chunk; None: what suits the device.

    Returns:
        Scale factors; NaN, with the reason in `fit.result`, for patients without one. Their
        derivatives are NaN too.
    """
    targets = jnp.asarray(targets, float)
    return _calibrate(
        surrogates, conditions, targets, derivatives=derivatives, batch_size=batch_size
    )


@eqx.filter_jit
def _calibrate(
    surrogates: Surrogate,
    conditions: HaemodynamicCondition,
    targets: Array,
    *,
    derivatives: bool,
    batch_size: int | None,
) -> Calibrations:
    def alpha(data: Any) -> tuple[Array, AlphaFit]:
        fit = calibrate_alpha(*data, throw=False)
        return fit.alpha, fit

    def one(data: Any) -> Calibrations:
        if not derivatives:
            return Calibrations(alpha(data)[1], None, None, None)
        (_, fit), slopes = jax.value_and_grad(alpha, has_aux=True)(data)
        return Calibrations(fit, *slopes)

    return map_cases(one, (surrogates, conditions, targets), batch_size=batch_size)
