"""Freedom of uncertain equations: columns of the data along which they may err, see `evidence`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis.evidence import (
    Posterior,
    Whitened,
    absorbed,
    posterior_of_products,
    smooth_scale,
    split,
)
from diagnosis.harmonic_product import HarmonicProduct
from diagnosis.measured import Whitener, correlation
from diagnosis.resolution import HARMONICS

FORM_LENGTHS, FORM_HARMONICS = (0.03, 0.06, 0.12), 14
"""Correlation lengths of the error of a guessed form [beats], and its number of harmonics."""

_PRODUCT = HarmonicProduct(HARMONICS, FORM_HARMONICS)

FORM_SHIFT = 0.06
"""Uncertainty of the time at which an effect acts [beats]."""

KINDS = ("exact", "guessed", "guessed, in a bed of another structure")
"""What the equations of a hypothesis may be, each as likely: the base model's bed, the form of the
effects and the instruments as they are modelled; all of these guessed; and the structure of the bed
guessed too."""


class Freedom(NamedTuple):
    """Freedom of uncertain equations, as columns of data with standard normal coefficients.

    Rows of data lie in groups g of one size r, each with columns of its own: one for every trace.
    Of the last rows, those of the scalars, each has one coefficient. Both are in units of the noise
    without its correlated variations V, the modes, which cross the groups: other columns are
    brought back to those units, and V is absorbed after the groups. All other columns, and the
    shared ones, are whitened.

    Attributes:
        own: columns whose coefficients each group of each condition has for itself.
        scalars: standard deviations of the last data.
        shared: columns of all rows whose coefficients all conditions share.
        whitener: of the record.
    """

    own: Float[Array, "*b c g r m"]
    scalars: Float[Array, "*b c q"]
    shared: Float[Array, "*b c d s"]
    whitener: Whitener

    def posterior(self, linear: Whitened, sided: Float[Array, " k"]) -> Posterior:
        """Evidence and posterior of the unknowns of a linearised hypothesis, the freedom apart."""
        left, log_volume = self.absorbed_products(linear.J, linear.e[..., None])
        return posterior_of_products(*split(left), log_volume, sided)

    def misfits(self, residuals: Float[Array, "t c d"]) -> Float[Array, " t"]:
        """Σ rᵀ C⁻¹ r of several residuals, C being noise and freedom together."""
        return jnp.diagonal(self.absorbed_products(jnp.moveaxis(residuals, 0, -1))[0])

    def absorbed_products(self, *others: Float[Array, "c d _"]) -> tuple[Array, Array]:
        """Inner products of other columns once the freedom is part of the noise, and ½ ln|C|."""
        left, own_volume = self.own_absorbed(self.shared, *others)
        left, volume = absorbed(jnp.sum(left, axis=0), self.shared.shape[-1])
        return left, jnp.sum(own_volume) + volume

    def own_absorbed(self, *others: Float[Array, "c d _"]) -> tuple[Array, Array]:
        """By condition, the same once the freedom that each has for itself is part of the noise."""
        (C, g, r, m), V = self.own.shape, self.whitener.modes
        columns = self.whitener.correlated(jnp.concatenate(others, axis=-1))
        if V is not None:
            columns = jnp.concatenate([V, columns], axis=-1)
        traces = columns[:, : g * r].reshape(C, g, r, columns.shape[-1])
        scalars = columns[:, g * r :] / jnp.sqrt(1.0 + self.scalars**2)[..., None]
        traces = jnp.concatenate([self.own, traces], axis=-1)
        products = jnp.einsum("cgrm,cgrl->cgml", traces, traces)
        left, volume = jax.vmap(jax.vmap(lambda one: absorbed(one, m)))(products)
        left = jnp.sum(left, axis=1) + jnp.einsum("cqm,cql->cml", scalars, scalars)
        volume = jnp.sum(volume, axis=1) + 0.5 * jnp.sum(jnp.log1p(self.scalars**2), axis=-1)
        if V is None:
            return left, volume
        left, more = jax.vmap(lambda one: absorbed(one, V.shape[-1]))(left)
        # in whitened units the noise alone has none
        alone = jax.vmap(lambda V: absorbed(V.T @ V, V.shape[-1])[1])(V)
        return left, volume + more - alone

    def dense(self) -> Float[Array, "c d n"]:
        """All columns whose coefficients each condition has for itself, whitened."""
        return self.whitener.uncorrelated(_block_diagonal(self.own, self.scalars))


def _block_diagonal(
    own: Float[Array, "c g r m"], scalars: Float[Array, "c q"]
) -> Float[Array, "c d n"]:
    """Columns of groups of rows, and a number for each of the last rows, side by side."""
    C, g, r, m = own.shape
    columns = jnp.zeros((C, g * r + scalars.shape[1], g * m + scalars.shape[1]))
    for k in range(g):
        columns = columns.at[:, k * r : (k + 1) * r, k * m : (k + 1) * m].set(own[:, k])
    return columns.at[:, g * r :, g * m :].set(jax.vmap(jnp.diag)(scalars))


def form_freedom(
    W: Whitener,
    power: Float[Array, "c s n"],
    scalar_power: Float[Array, "c 4"],
    shared_power: Float[Array, "c s n"],
    shared_scalar_power: Float[Array, "c 4"],
    shared_columns: Float[Array, "c d m"],
) -> Freedom:
    """Freedom of guessed equations: smooth random waveforms about where the effects act.

    Their variance is the squared product of tolerance and change by the effect, averaged over
    neighbouring times: both strength and timing of an effect are uncertain.

    Args:
        W: whitener of the record.
        power: variance of the signals with a waveform that each condition has for itself [their
            units squared].
        scalar_power: that of the last four data.
        shared_power: variance of what all conditions share; not in the first signal, the aortic
            pressure.
        shared_scalar_power: that of the last four data.
        shared_columns: further columns of the data [their units] that all conditions share.
    """
    own, shared = _columns(power), _columns(shared_power[:, 1:])
    scalars, shared_scalars = jnp.sqrt(scalar_power), jnp.sqrt(shared_scalar_power)
    C, S, r, m = own.shape
    none = jnp.zeros((C, min(S, 1) * r, shared.shape[1] * m + scalars.shape[1]))
    together = jnp.concatenate([none, _block_diagonal(shared, shared_scalars)], axis=1)
    together = jnp.concatenate([together, shared_columns], axis=2)
    weight = W.weight[:, : S * r].reshape(C, S, r, 1)
    return Freedom(weight * own, W.weight[:, S * r :] * scalars, W.columns(together), W)


def _columns(power: Float[Array, "c s n"]) -> Float[Array, "c s r m"]:
    """Columns of smooth random waveforms of a variance, for every signal."""
    lengths = [smooth_scale(length, FORM_HARMONICS) ** 2 for length in FORM_LENGTHS]
    scale = np.sqrt(np.mean(lengths, axis=0))
    near = correlation(FORM_SHIFT)
    near = jnp.asarray(near / near.sum(axis=1, keepdims=True))
    # the derivative of the root at zero is infinite, but nothing is differentiated here
    return jax.vmap(jax.vmap(lambda wave: _PRODUCT(wave) * scale[None, :]))(
        jnp.sqrt(power @ near.T)
    )
