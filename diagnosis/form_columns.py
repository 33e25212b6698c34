"""Freedom of uncertain equations: columns of the data along which they may err, see `evidence`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis.circuit import FROM_SAMPLES, TO_SAMPLES
from diagnosis.evidence import (
    Posterior,
    Whitened,
    absorbed,
    posterior_of_products,
    smooth_scale,
    split,
)
from diagnosis.measured import Whitener, correlation

FORM_LENGTHS, FORM_HARMONICS = (0.03, 0.06, 0.12), 14
"""Correlation lengths of the error of a guessed form [beats], and its number of harmonics."""

FORM_SHIFT = 0.06
"""Uncertainty of the time at which an effect acts [beats]."""

KINDS = ("exact", "guessed", "guessed, in a bed of another structure")
"""What the equations of a hypothesis may be, each as likely: the base model's bed and the form of
the effects; a guessed form in that bed; a guessed form in a bed whose structure is guessed too."""


class Freedom(NamedTuple):
    """Freedom of uncertain equations, as columns of data with standard normal coefficients.

    Attributes:
        own: columns F whose coefficients each condition has for itself.
        shared: columns whose coefficients all conditions share.
    """

    own: Float[Array, "*b c d m"]
    shared: Float[Array, "*b c d s"]

    def posterior(self, linear: Whitened, sided: Float[Array, " k"]) -> Posterior:
        """Evidence and posterior of the unknowns of a linearised hypothesis, the freedom apart."""
        left, log_volume = self._absorbed(linear.J, linear.e[..., None])
        return posterior_of_products(*split(left), log_volume, sided)

    def misfits(self, residuals: Float[Array, "t c d"]) -> Float[Array, " t"]:
        """Σ rᵀ C⁻¹ r of several residuals, C being noise and freedom together."""
        return jnp.diagonal(self._absorbed(jnp.moveaxis(residuals, 0, -1))[0])

    def _absorbed(self, *others: Float[Array, "c d _"]) -> tuple[Array, Array]:
        """Inner products of other columns once the freedom is part of the noise, and ½ ln|C|."""
        m, s = self.own.shape[-1], self.shared.shape[-1]
        columns = jnp.concatenate([self.own, self.shared, *others], axis=-1)
        products = jnp.einsum("cdm,cdl->cml", columns, columns)
        left, own_volume = jax.vmap(lambda one: absorbed(one, m))(products)
        left, volume = absorbed(jnp.sum(left, axis=0), s)
        return left, jnp.sum(own_volume) + volume


def form_columns(
    W: Whitener,
    power: Float[Array, "c 3 n"],
    scalar_power: Float[Array, "c 4"],
    n_sensors: int,
    *,
    first: int = 0,
) -> Float[Array, "c d m"]:
    """Columns F of the form tolerance: smooth random waveforms about where the effects act.

    Their variance is the squared product of tolerance and change by the effect, averaged over
    neighbouring times: both strength and timing of an effect are uncertain.

    Args:
        W: whitener of the record.
        power: variance of the signals [their units squared].
        scalar_power: variance of the last four data.
        n_sensors: number of sensors with a waveform.
        first: the first of them that is uncertain (static).
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
    width = max(n_sensors - first, 0) * m
    F = jnp.zeros((C, W.weight.shape[1], width + 4))
    for s in range(first, n_sensors):
        at = (s - first) * m
        block = jnp.einsum("qn,cn,nm->cqm", jnp.asarray(FROM_SAMPLES), envelope[:, s], basis)
        F = F.at[:, s * rows : (s + 1) * rows, at : at + m].set(block)
    own = jax.vmap(jnp.diag)(jnp.sqrt(scalar_power))
    F = F.at[:, n_sensors * rows :, width:].set(own)
    return W.columns(F)
