"""Columns F of the form tolerance: how uncertain equations spread over the data, see `evidence`."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis.circuit import FROM_SAMPLES, TO_SAMPLES
from diagnosis.evidence import absorbed, smooth_scale
from diagnosis.measured import Whitener, correlation

FORM_LENGTHS, FORM_HARMONICS = (0.03, 0.06, 0.12), 14
"""Correlation lengths of the error of a guessed form [beats], and its number of harmonics."""

FORM_SHIFT = 0.06
"""Uncertainty of the time at which an effect acts [beats]."""


def form_columns(
    W: Whitener,
    power: Float[Array, "c 3 n"],
    scalar_power: Float[Array, "c 4"],
    n_sensors: int,
) -> Float[Array, "c d m"]:
    """Columns F of the form tolerance: smooth random waveforms about where the effects act.

    Their variance is the squared product of tolerance and change by the effect, averaged over
    neighbouring times: both strength and timing of an effect are uncertain.
    """
    lengths = [smooth_scale(length, FORM_HARMONICS) ** 2 for length in FORM_LENGTHS]
    scale = np.sqrt(np.mean(lengths, axis=0))
    size = TO_SAMPLES.shape[1] // 2
    kept = np.r_[0 : FORM_HARMONICS + 1, size + 1 : size + 1 + FORM_HARMONICS]
    basis = jnp.asarray(TO_SAMPLES[:, kept] * scale)
    near = correlation(FORM_SHIFT)
    near = jnp.asarray(near / near.sum(axis=1, keepdims=True))
    # the derivative of the root at zero is infinite, but nothing is differentiated here
    envelope = jnp.sqrt(power @ near.T)
    C, m = power.shape[0], basis.shape[1]
    rows = TO_SAMPLES.shape[1]
    F = jnp.zeros((C, W.weight.shape[1], n_sensors * m + 4))
    for s in range(n_sensors):
        block = jnp.einsum("qn,cn,nm->cqm", jnp.asarray(FROM_SAMPLES), envelope[:, s], basis)
        F = F.at[:, s * rows : (s + 1) * rows, s * m : (s + 1) * m].set(block)
    own = jax.vmap(jnp.diag)(jnp.sqrt(scalar_power))
    F = F.at[:, n_sensors * rows :, n_sensors * m :].set(own)
    return W.columns(F)


def without_form(residuals: Float[Array, "t c d"], F: Float[Array, "c d m"]) -> Float[Array, " t"]:
    """Σ rᵀ (I + F Fᵀ)⁻¹ r over the conditions, of several residuals."""
    columns = jnp.concatenate([F, jnp.moveaxis(residuals, 0, -1)], axis=-1)
    products = jnp.einsum("cdm,cdl->cml", columns, columns)
    left, _ = jax.vmap(lambda one: absorbed(one, F.shape[-1]))(products)
    return jnp.diagonal(jnp.sum(left, axis=0))
