"""Pressure-flow curve of an artery from a ramp of its pressure drop in 3D.

The wall is prestressed at a pressure P_ref, then the drop over the artery grows at a constant rate;
flow and drop are recorded. Linear least squares give::

    one ramp:  ΔP = R0 Q + K Q|Q| + L dQ/dt
    several:   ΔP = (R0 + R_P p) Q + (K + K_P p) Q|Q| + L dQ/dt,  p = (P_aorta + P_distal)/2 − P_ref

L is the inertance of the blood: the flow of a ramp grows, and a quick ramp would otherwise be read
as resistance. p is the transmural pressure of the artery; in one ramp it is a function of the drop
and cannot be told from the curve, in ramps of the aortic and of the distal pressure it can.

The law is fitted in its weak form, ∫φ ΔP dt = R0 ∫φ Q dt + K ∫φ Q|Q| dt − L ∫φ' Q dt with
hat functions φ of time. While a thin wall flutters for some milliseconds, dQ/dt is ten times that
of the ramp; in a fit sample by sample this alone determines L (2 in place of 37 dyn·s²/cm⁵) and
with it R0.

| resistance | |
|---|---|
| tangent at 40 mmHg | dΔP/dQ = √(R0² + 4 K ΔP): the R0 of the paper's linear law |
| secant at a drop | ΔP/Q: makes a linear surrogate exact at that drop |
| curve | R0 and K: the surrogate of law ``quadratic`` |

Errors: neighbouring residuals are correlated; with the correlation ρ at lag one, the effective
number of n residuals is n (1 − ρ)/(1 + ρ).

Source: the ramp and R0 are those of Puelz et al. 2024, section 2.4; the curve is ours.
"""

from collections.abc import Sequence
from typing import Any, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.reduced_law import PressureFlowLaw
from lumped import MMHG, RESULTS, raise_unless_successful
from lumped.parameters import Parameter, nan_unless, real
from lumped.results import as_result, is_successful

PAPER_DROP = 40.0 * MMHG
"""Pressure drop at which Puelz et al. 2024 take the slope [dyn/cm²]."""

SETTLING = 0.15
"""Share of a ramp that is excluded at its start, while the artery is still filling."""

HATS = 24
"""Hat functions of a ramp; more or fewer move R0 of calm ramps by 0.2 %."""

_LEAST_SAMPLES = 8

RAMP_CURE = (
    "Look at the flow of the ramp: it must not vanish, and must run from the aorta to the distal "
    "end while the drop is positive."
)


class RampRecord(eqx.Module):
    """Recorded ramp, at equal or unequal steps.

    Attributes:
        t: time [s], ascending.
        P_aorta: pressure before the artery [dyn/cm²].
        P_distal: pressure behind it [dyn/cm²].
        Q: flow through it [cm³/s].
    """

    t: Float[Array, " steps"] = eqx.field(converter=real)
    P_aorta: Float[Array, " steps"] = eqx.field(converter=real)
    P_distal: Float[Array, " steps"] = eqx.field(converter=real)
    Q: Float[Array, " steps"] = eqx.field(converter=real)

    def __check_init__(self):
        shapes = {np.shape(v) for v in (self.t, self.P_aorta, self.P_distal, self.Q)}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise ValueError(
                f"The columns of a ramp have shapes {sorted(shapes)}. Give four of one length."
            )

    @property
    def drop(self) -> Float[Array, " steps"]:
        """P_aorta − P_distal [dyn/cm²]."""
        return self.P_aorta - self.P_distal


class RampFit(eqx.Module):
    """A fitted ramp.

    Attributes:
        law: ΔP = R0 Q + K Q|Q| at the reference pressure.
        L: inertance [dyn·s²/cm⁵].
        transmural: R_P [s/cm³] and K_P [s²/cm⁶] per dyn/cm²; zero where one ramp was fitted.
        covariance: of R0 and K.
        rms: of the residuals [dyn/cm²].
        n_effective: independent residuals, one a hat function at most.
        largest_drop: of the record [dyn/cm²]; beyond it the law is an extrapolation.
        result: `lumped.RESULTS`; where it is a failure all numbers are NaN.
    """

    law: PressureFlowLaw
    L: Float[Array, ""]
    transmural: Float[Array, " 2"]
    covariance: Float[Array, "2 2"]
    rms: Float[Array, ""]
    n_effective: Float[Array, ""]
    largest_drop: Float[Array, ""]
    result: RESULTS = eqx.field(converter=as_result)

    def tangent(self, dP: Parameter = PAPER_DROP) -> tuple[Array, Array]:
        """Slope dΔP/dQ at a drop [dyn/cm²] and its standard deviation, in dyn·s/cm⁵."""
        slope = self.law.tangent(dP)
        gradient = jnp.stack([self.law.R0, 2.0 * jnp.asarray(dP, float)]) / slope
        return slope, self._sd(gradient)

    def secant(self, dP: Parameter) -> tuple[Array, Array]:
        """Resistance ΔP/Q at a drop [dyn/cm²] and its standard deviation, in dyn·s/cm⁵."""
        slope = self.law.tangent(dP)
        gradient = (
            jnp.stack([1.0 + self.law.R0 / slope, 2.0 * jnp.asarray(dP, float) / slope]) / 2.0
        )
        return self.law.secant(dP), self._sd(gradient)

    def _sd(self, gradient: Float[Array, " 2"]) -> Array:
        return jnp.sqrt(gradient @ self.covariance @ gradient)


def fit_ramp(
    records: RampRecord | Sequence[RampRecord],
    *,
    P_ref: Parameter = 0.0,
    settling: float = SETTLING,
    throw: bool = True,
) -> RampFit:
    """Fit the curve of one ramp, or of several with the dependence on transmural pressure.

    Differentiable in pressures and flow; times must be concrete. Where R0 or K would be negative,
    which no artery has, it is set to zero and the other fitted again.

    Args:
        records: one ramp, or ramps at different pressures of the artery.
        P_ref: pressure at which the wall was prestressed [dyn/cm²]; matters with several.
        settling: share of each ramp's duration that is left out at its start.
        throw: raise when no law was found (outside jit). With False look at `result`.

    Returns:
        The curve; NaN with the reason where the record has none: it is not finite, has no flow, or
        the flow runs against the drop.

    Raises:
        ValueError: too few samples are left, or times do not ascend.
        RuntimeError: the record has no curve.
    """
    records = [records] if isinstance(records, RampRecord) else list(records)
    if not records or not 0.0 <= settling < 1.0:
        raise ValueError(
            f"{len(records)} ramps of which a share of {settling} is left out: give at least one, "
            "and a share from 0 to below 1."
        )
    for record in records:
        t = np.asarray(record.t)
        if not (t.size and np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
            raise ValueError("The times of a ramp must be finite and ascend. Sort its samples.")
    kept = [_settled(record, settling) for record in records]
    n = min(len(record.t) for record in kept)
    if n < _LEAST_SAMPLES:
        raise ValueError(
            f"{n} samples of a ramp are too few for its curve. Take a smaller dt or a slower ramp:"
            f" at least {_LEAST_SAMPLES} must follow the first {settling:.0%} of it."
        )
    several = len(records) > 1
    parts = [_weak_form(record, P_ref if several else None) for record in kept]
    X, drop = (jnp.concatenate([part[k] for part in parts]) for k in (0, 1))
    largest = jnp.max(jnp.stack([jnp.max(record.drop) for record in records]))
    fitted = _fitted(X, drop, largest)
    if throw:
        raise_unless_successful(fitted.result, RAMP_CURE)
    return fitted


def _fitted(X: Float[Array, "n k"], drop: Float[Array, " n"], largest: Array) -> RampFit:
    """Least squares on the weak form; NaN and a reason where the coefficients are not physical."""
    n = drop.size
    everything = jnp.ones(X.shape[1])
    whole, spread = _least_squares(X, drop, everything)
    no_a, spread_no_a = _least_squares(X, drop, everything.at[0].set(0.0))
    no_b, spread_no_b = _least_squares(X, drop, everything.at[1].set(0.0))
    bad_a, bad_b = whole[0] < 0.0, whole[1] < 0.0
    found = jnp.where(bad_b, no_b, jnp.where(bad_a, no_a, whole))
    inverse = jnp.where(bad_b, spread_no_b, jnp.where(bad_a, spread_no_a, spread))
    left = drop - X @ found
    rho = jnp.clip(jnp.sum(left[1:] * left[:-1]) / jnp.sum(left**2), 0.0, 0.999)
    independent = jnp.maximum(n * (1.0 - rho) / (1.0 + rho), 1.0 + X.shape[1])
    variance = jnp.sum(left**2) / n * (n / independent)
    more = found[3:] if X.shape[1] > 3 else jnp.zeros(2)
    flows = jnp.all(jnp.max(jnp.abs(X[:, :2]), axis=0) > 0.0)
    lawful = (found[0] >= 0.0) & (found[1] >= 0.0) & ((found[0] > 0.0) | (found[1] > 0.0))
    finite = jnp.all(jnp.isfinite(X)) & jnp.all(jnp.isfinite(drop))
    good, bad = cast(Any, RESULTS.successful), cast(Any, RESULTS.undetermined)
    result = RESULTS.where(flows & lawful, good, bad)
    result = RESULTS.where(finite, result, cast(Any, RESULTS.nonfinite))
    factor = nan_unless(is_successful(result))
    law = PressureFlowLaw(R0=1.0, K=1.0)  # what takes its place is NaN where there is no law
    return RampFit(
        law=eqx.tree_at(lambda one: (one.R0, one.K), law, (found[0] * factor, found[1] * factor)),
        L=found[2] * factor,
        transmural=more * factor,
        covariance=variance * inverse[:2, :2] * factor,
        rms=jnp.sqrt(jnp.mean(left**2)) * factor,
        n_effective=independent * factor,
        largest_drop=largest * factor,
        result=result,
    )


def measured_slope(
    record: RampRecord, dP: float = PAPER_DROP, *, width: float = 10.0 * MMHG
) -> float | None:
    """Slope dΔP/dQ of the record itself at a drop, by a parabola through its surroundings.

    As in Puelz et al. 2024: no law, no inertance. None where the ramp does not reach the drop, is
    not finite, or where the flow does not grow with the drop.

    Args:
        record: the ramp.
        dP: the drop [dyn/cm²].
        width: half width of the surroundings [dyn/cm²].
    """
    drop, Q = np.asarray(record.drop), np.asarray(record.Q)
    if not (np.all(np.isfinite(drop)) and np.all(np.isfinite(Q)) and dP > 0.0 and width > 0.0):
        return None
    near = np.abs(drop - dP) <= width
    if drop.max(initial=0.0) < dP or np.count_nonzero(near) < 4:
        return None
    slope = np.polyfit(drop[near] - dP, Q[near], 2)[1]
    return float(1.0 / slope) if slope > 0.0 else None


def _settled(record: RampRecord, settling: float) -> RampRecord:
    """The record after its start; its times stay concrete under jit."""
    t = np.asarray(record.t)
    first = int(np.searchsorted(t, t[0] + settling * (t[-1] - t[0])))
    columns = (record.P_aorta[first:], record.P_distal[first:], record.Q[first:])
    return eqx.tree_at(lambda r: (r.t, r.P_aorta, r.P_distal, r.Q), record, (t[first:], *columns))


def _weak_form(record: RampRecord, P_ref: Parameter | None) -> tuple[Array, Array]:
    """Columns of the law and the drop, in means weighted by hat functions of time.

    Args:
        record: the ramp.
        P_ref: reference of the transmural pressure [dyn/cm²]; None leaves its columns out.
    """
    t, Q = np.asarray(record.t), record.Q
    wanted = np.linspace(t[0], t[-1], min(HATS, t.size - 2) + 2)
    nodes = t[np.unique([np.argmin(np.abs(t - time)) for time in wanted])]
    at_nodes = np.eye(nodes.size)[1:-1]
    hats = np.array([np.interp(t, nodes, values) for values in at_nodes])
    middles = (t[1:] + t[:-1]) / 2.0
    slopes = (at_nodes[:, 1:] - at_nodes[:, :-1]) / np.diff(nodes)
    slopes = slopes[:, np.searchsorted(nodes, middles) - 1]
    # trapezium rule: exact for a flow that is linear between samples
    step = np.diff(t)
    weights = hats * (np.r_[step, 0.0] + np.r_[0.0, step]) / 2.0
    size = weights.sum(axis=1, keepdims=True)
    mean = jnp.asarray(weights / size)
    growth = jnp.asarray(-slopes * step / size) @ ((Q[1:] + Q[:-1]) / 2.0)
    columns = [mean @ Q, mean @ (Q * jnp.abs(Q)), growth]
    if P_ref is not None:
        p = (record.P_aorta + record.P_distal) / 2.0 - P_ref
        columns += [mean @ (p * Q), mean @ (p * Q * jnp.abs(Q))]
    return jnp.stack(columns, axis=1), mean @ record.drop


def _least_squares(
    X: Float[Array, "n k"], y: Float[Array, " n"], used: Float[Array, " k"]
) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Coefficients of the columns used, zero for others, and (XᵀX)⁻¹ with zeros for those."""
    scale = jnp.sqrt(jnp.sum(X**2, axis=0))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    A = X / scale[None, :] * used[None, :]
    normal = A.T @ A + jnp.diag(1.0 - used)
    inverse = jnp.linalg.inv(normal) * used[:, None] * used[None, :]
    return (inverse @ (A.T @ y)) / scale, inverse / (scale[:, None] * scale[None, :])
