"""Parameters of 0D vessels from pressures and flows at both their ends (equation error).

The record of a vessel (`vessel_record`) holds pressures, flows and their time derivatives at both
ends, from a 3D or 1D run or from measurements. The parameters are those that leave the smallest
residuals in its momentum and mass equations at the recorded instants; nothing is integrated in
time. The objective is the plain sum of squares of both residuals in CGS, as in the calibrator of
svZeroDSolver (Richter et al. 2025, "Bayesian Windkessel calibration using optimized
zero-dimensional surrogate models", doi 10.1098/rsta.2024.0223). Every parameter enters the
equations of one vessel only, so the vessels are independent problems.

We depart from svZeroDSolver in the method, not in the optimum. Both residuals are linear
in (1, R, L, K) and (1, C, CR, CK), so one QR factorisation of each keeps the objective exactly in
at most eight numbers, whatever the number of samples. The damped Gauss-Newton loop on these, in
variables scaled to unit columns, needs 3-7 steps and was measured 2 to 9 times faster than
`optimistix.LevenbergMarquardt` on the same eight numbers, which beyond rtol 1e-8 no longer met its
own criterion. Steps come from a singular value decomposition: combinations of parameters
that the data do not determine stay where they started.

An outlet of a junction that has R, L and K of its own obeys the momentum equation with
Q_in = Q_out: calibrate it with `with_capacitance=False`.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from calibration.vessel_record import (
    VesselParameters,
    VesselRecord,
    apply_columns,
    equation_columns,
    residuals_of_one,
)
from lumped.parameters import only_if

_RANK_TOLERANCE = 1e-10
"""Singular values below this share of the largest count as zero (columns have unit length)."""

_STEP_TOLERANCE = 1e-12
"""The loop ends when a step is below this share of the scaled parameters."""

_MAX_STEPS = 50


class FreeParameters(eqx.Module):
    """Which parameters of which vessel are fitted; the others keep their initial values."""

    R_viscous: Bool[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    C: Bool[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    L: Bool[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    K_stenosis: Bool[Array, " vessels"] = eqx.field(converter=jnp.asarray)

    def as_table(self) -> Bool[Array, "vessels 4"]:
        """The columns R_viscous, C, L, K_stenosis."""
        return jnp.stack([self.R_viscous, self.C, self.L, self.K_stenosis], axis=-1)


class VesselFit(eqx.Module):
    """Optimum of `calibrate_vessels`.

    Attributes:
        parameters: the optimum; carries derivatives with respect to the record.
        residual_norm: root of the sum of squares of both residuals over all samples, momentum
            in dyn/cm² and mass in cm³/s, added as they stand.
        rank: number of independent combinations of free parameters that the data determine.
        iterations: Gauss-Newton steps taken.
        result: `optimistix.RESULTS` of every vessel.
    """

    parameters: VesselParameters
    residual_norm: Float[Array, " vessels"]
    rank: Int[Array, " vessels"]
    iterations: Int[Array, " vessels"]
    result: optx.RESULTS


def calibrate_vessels(
    record: VesselRecord,
    *,
    with_stenosis: bool = True,
    with_capacitance: bool = True,
    free: FreeParameters | None = None,
    initial: VesselParameters | None = None,
    throw: bool = True,
) -> VesselFit:
    """Find the vessel parameters with the smallest squared residuals of the vessel equations.

    The optimum is not constrained: C, L or K may come out negative where the data say so.
    Its derivative with respect to the record follows from the implicit function theorem, also
    for higher derivatives. Where `rank` is below the number of free parameters, the result is the
    minimiser nearest to `initial` in the scaled variables (R·‖Q‖, C·‖dP‖, L·‖dQ‖, K·‖Q²‖), and
    its derivative is that of the determined combinations only. In steady flow this leaves
    R + K·abs(Q): starting from zero, half of the loss goes to each.

    Args:
        record: what was recorded; one row a vessel.
        with_stenosis: False holds K_stenosis at 0.
        with_capacitance: False holds C at 0.
        free: parameters to fit; all by default. The two switches above take precedence.
        initial: start of the iteration [CGS]; zero by default. Held parameters keep it.
        throw: raise when a vessel did not converge. Under a JAX transformation nothing is
            raised: read `result`.

    Returns:
        The optimum of every vessel; NaN where none was found, as for records that are not finite.

    Raises:
        ValueError: a vessel did not converge, which finite records have not been seen to do.
    """
    vessels, samples = record.P_in.shape
    if vessels == 0 or samples == 0:
        raise ValueError(
            f"A record of {vessels} vessels with {samples} samples determines nothing. Give at "
            "least one vessel and as many samples as it has free parameters."
        )
    for name, given in (("initial", initial), ("free", free)):
        if given is not None and {leaf.shape for leaf in jax.tree.leaves(given)} != {(vessels,)}:
            raise ValueError(
                f"{name} does not fit the record of {vessels} vessels. Give one value a vessel."
            )
    fit, converged = _calibrate(record, free, initial, with_stenosis, with_capacitance)
    if throw and not isinstance(converged, Tracer):
        _raise_unless_all(np.asarray(converged))
    return fit


@eqx.filter_jit
def _calibrate(
    record: VesselRecord,
    free: FreeParameters | None,
    initial: VesselParameters | None,
    with_stenosis: bool,
    with_capacitance: bool,
) -> tuple[VesselFit, Bool[Array, " vessels"]]:
    shape = (record.P_in.shape[0], 4)
    possible = jnp.array([True, with_capacitance, True, with_stenosis])[None, :]
    mask = possible & (jnp.ones(shape, bool) if free is None else free.as_table())
    start = jnp.zeros(shape) if initial is None else initial.as_table()
    theta_0 = jnp.where(possible, start, 0.0)
    frozen_record, frozen_start = jax.lax.stop_gradient((record, theta_0))
    theta, rank, iterations, converged = jax.vmap(_minimise)(frozen_record, mask, frozen_start)
    theta = jnp.where(mask, theta, theta_0)
    theta = jax.vmap(_with_implicit_derivative)(theta, mask, record)
    momentum, mass = jax.vmap(residuals_of_one)(theta, record)
    finite = jax.vmap(_is_finite)((record, theta))
    theta = jax.vmap(only_if)(converged & finite, theta, record)
    R, C, L, K = theta.T
    fit = VesselFit(
        parameters=VesselParameters(R_viscous=R, C=C, L=L, K_stenosis=K),
        residual_norm=_norm(jnp.concatenate([momentum, mass], axis=1)),
        rank=rank,
        iterations=iterations,
        result=jax.vmap(_result)(converged, finite),
    )
    return fit, converged & finite


def _result(converged: Bool[Array, ""], finite: Bool[Array, ""]) -> optx.RESULTS:
    result = optx.RESULTS.where(
        converged, optx.RESULTS.successful, optx.RESULTS.nonlinear_max_steps_reached
    )
    return optx.RESULTS.where(finite, result, optx.RESULTS.nonfinite)


def _raise_unless_all(converged: Bool[np.ndarray, " vessels"]) -> None:
    lost = np.flatnonzero(~converged).tolist()
    if lost:
        raise ValueError(
            f"The calibration of vessels {lost} (counted from 0) did not converge in "
            f"{_MAX_STEPS} steps. Look for infinite or missing values in their records."
        )


def _is_finite(tree: Any) -> Bool[Array, ""]:
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)]))


def _norm(values: Float[Array, "vessels entries"]) -> Float[Array, " vessels"]:
    """Euclidean norm of each row, with derivative 0 where the row vanishes."""
    square = jnp.sum(values**2, axis=1)
    return jnp.where(square == 0.0, 0.0, jnp.sqrt(jnp.where(square == 0.0, 1.0, square)))


def _scales(momentum: Float[Array, "rows 4"], mass: Float[Array, "rows 4"]) -> Float[Array, "4"]:
    """Lengths of the columns of R, C, L and K; 1 for a column of zeros."""
    norms = jnp.stack(
        [
            jnp.linalg.norm(momentum[:, 1]),
            jnp.linalg.norm(mass[:, 1]),
            jnp.linalg.norm(momentum[:, 2]),
            jnp.linalg.norm(momentum[:, 3]),
        ]
    )
    return jnp.where(norms > 0.0, norms, 1.0)


def _minimise(
    record: VesselRecord, free: Bool[Array, "4"], theta_0: Float[Array, "4"]
) -> tuple[Float[Array, "4"], Int[Array, ""], Int[Array, ""], Bool[Array, ""]]:
    """Damped Gauss-Newton on the compressed residuals; (theta, rank, steps, converged).

    The damping starts at zero (plain Gauss-Newton). A step that raises the objective is refused
    and the damping raised tenfold, from 1e-6 on; an accepted step lowers it a hundredfold.
    """
    momentum, mass = (jnp.linalg.qr(columns, mode="r") for columns in equation_columns(record))
    scale = _scales(momentum, mass)

    def residual(x: Float[Array, "4"]) -> Float[Array, " rows"]:
        return jnp.concatenate(apply_columns(momentum, mass, x / scale))

    def decompose(x: Float[Array, "4"]) -> tuple[Array, Array, Array, Array]:
        jacobian = jax.jacfwd(residual)(x) * free[None, :].astype(x.dtype)
        U, sigma, Vt = jnp.linalg.svd(jacobian, full_matrices=False)
        return U, sigma, Vt, sigma > _RANK_TOLERANCE * sigma[0]

    def step(carry):
        x, r, cost, damping, count, _ = carry
        U, sigma, Vt, determined = decompose(x)
        filtered = jnp.where(determined, sigma / jnp.where(determined, sigma**2 + damping, 1.0), 0)
        dx = -Vt.T @ (filtered * (U.T @ r))
        x_new = x + dx
        r_new = residual(x_new)
        cost_new = r_new @ r_new
        # the margin admits steps at the level of round-off, where cost no longer falls
        accepted = cost_new <= cost * (1.0 + 1e-12)
        small = jnp.linalg.norm(dx) <= _STEP_TOLERANCE * jnp.linalg.norm(x_new)
        x = jnp.where(accepted, x_new, x)
        r = jnp.where(accepted, r_new, r)
        damping = jnp.where(accepted, 0.01 * damping, jnp.maximum(10.0 * damping, 1e-6))
        return x, r, jnp.where(accepted, cost_new, cost), damping, count + 1, small

    def unfinished(carry):
        return ~carry[-1] & (carry[-2] < _MAX_STEPS)

    x_0 = theta_0 * scale
    r_0 = residual(x_0)
    start = (x_0, r_0, r_0 @ r_0, jnp.zeros(()), jnp.zeros((), int), jnp.zeros((), bool))
    x, _, _, _, count, converged = jax.lax.while_loop(unfinished, step, start)
    rank = jnp.sum(decompose(x)[3] & (decompose(x)[1] > 0.0))
    return _with_exact_capacitance(x / scale, mass, free), rank, count, converged


def _with_exact_capacitance(
    theta: Float[Array, "4"], mass: Float[Array, "rows 4"], free: Bool[Array, "4"]
) -> Float[Array, "4"]:
    """Replace C by its closed-form optimum for the given R and K.

    The loop measures its steps against pressures, beside which C counts little; here C becomes
    as exact as R and K are.
    """
    factor = mass[:, 1:] @ jnp.stack([jnp.ones_like(theta[0]), theta[0], theta[3]])
    square = factor @ factor
    usable = free[1] & (square > 0.0)
    C = -(mass[:, 0] @ factor) / jnp.where(usable, square, 1.0)
    return theta.at[1].set(jnp.where(usable, C, theta[1]))


@jax.custom_jvp
def _with_implicit_derivative(
    theta: Float[Array, "4"], free: Bool[Array, "4"], record: VesselRecord
) -> Float[Array, "4"]:
    """`theta`, the optimum for `record`, with d theta = -H⁻¹ d(gradient) from data and held values.

    H is the Hessian of half the sum of squares at the optimum, in scaled variables and
    restricted to the free parameters; its pseudo-inverse leaves out what is not determined.
    """
    return theta


@_with_implicit_derivative.defjvp
def _implicit_derivative(primals, tangents):
    theta, free, record = primals
    theta_dot, _, record_dot = tangents
    theta = _with_implicit_derivative(theta, free, record)
    scale = jax.lax.stop_gradient(_scales(*equation_columns(record)))
    weight = free.astype(theta.dtype)

    def gradient(x: Float[Array, "4"], data: VesselRecord) -> Float[Array, "4"]:
        def half_squares(z: Float[Array, "4"]) -> Float[Array, ""]:
            momentum, mass = residuals_of_one(z / scale, data)
            return 0.5 * (momentum @ momentum + mass @ mass)

        return weight * jax.grad(half_squares)(x)

    x = theta * scale
    hessian = jax.jacfwd(gradient)(x, record) * weight[None, :]
    held_dot = (1.0 - weight) * theta_dot * scale
    _, gradient_dot = jax.jvp(gradient, (x, record), (held_dot, record_dot))
    free_dot = -jnp.linalg.pinv(hessian, hermitian=True) @ gradient_dot
    return theta, (weight * free_dot + held_dot) / scale
