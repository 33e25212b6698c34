"""Colour of the noise of a record that holds one beat a trace.

A stated standard deviation says how large the noise is, not how it spreads over the harmonics. With
several beats their scatter tells (`scatter`). With one beat, the residuals of the base model do,
above the harmonics in which effects show most: of the default spectrum and those of autoregressive
noise of the same variance and the correlation times τ,

    power_k = sd²/n (1 − ρ²)/(1 − 2ρ cos(2πk/n) + ρ²),     ρ = exp(−T/(n τ)),

the mean is taken with weights by their likelihood in the harmonics from `FIRST` on, all traces of
one sensor together. An effect raises these harmonics, most of all in the distal traces, which then
look like noise that spares the low ones. So the least of the sensors' means counts from `FIRST` on,
and the largest below.

Source: autoregressive spectrum, Priestley 1981, Spectral Analysis and Time Series, section 4.12.
"""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis.measured import Measured, noise_power
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import autoregressive_shape

CORRELATION_TIMES = (0.0, 0.003, 0.006, 0.01, 0.015, 0.022, 0.032)
"""Correlation times τ of autoregressive noise [s]; zero is white."""

DEFAULT_SHARE = 0.5
"""Prior probability of the default spectrum."""

FIRST = 11
"""Lowest harmonic from which the colour is learnt: effects change those below by much more."""


def autoregressive_power(
    sd: Float[Array, ""], n: Float[Array, ""], period: Float[Array, ""], time: float
) -> Float[Array, " f"]:
    """Variance of the harmonics over 2 of autoregressive noise, infinite where not measured."""
    k = jnp.arange(HARMONICS + 1).astype(float)
    rho = jnp.exp(-period / (n * time)) if time > 0.0 else jnp.zeros(())
    power = sd**2 / n * autoregressive_shape(rho, jnp.cos(2.0 * jnp.pi * k / n))
    return jnp.where(k < 0.5 * n, power, jnp.inf)


def with_power(batch: Measured) -> Measured:
    """Records with a place for the power of their noise, NaN where it is not known.

    With it the fits before and after the colour is learnt share one compilation.
    """
    if batch.wave_power is not None:
        return batch
    return dataclasses.replace(
        batch, wave_power=jnp.full((*batch.wave_sd.shape, HARMONICS + 1), jnp.nan)
    )


@jax.jit
def coloured(batch: Measured, residual: Float[Array, "b c d"]) -> Measured:
    """Records with the power of their noise by its colour, where no scatter of beats tells it.

    Args:
        batch: records with waveforms and a leading axis, see `with_power`.
        residual: whitened residuals of the base model.
    """
    return jax.vmap(_coloured)(batch, residual)


def _coloured(measured: Measured, residual: Float[Array, "c d"]) -> Measured:
    C, S = measured.n_conditions, measured.n_sensors
    seen = jnp.isfinite(measured.wave_sd)
    sd = jnp.where(seen, measured.wave_sd, 1.0)
    n = jnp.where(seen, measured.wave_samples, 4.0)
    period = jnp.broadcast_to(measured.period[:, None], (C, S))

    def of_all(power):
        return jax.vmap(jax.vmap(power))(sd, n, period)

    default = of_all(lambda sd, n, _: noise_power(sd, n, measured.white_share))
    family = [default]
    for time in CORRELATION_TIMES:
        family.append(of_all(partial(autoregressive_power, time=time)))
    powers = jnp.stack(family)
    count = 2 * HARMONICS + 1
    traces = residual[:, : S * count].reshape(C, S, count)
    square = traces[..., 1 : HARMONICS + 1] ** 2 + traces[..., HARMONICS + 1 :] ** 2
    ratio = default[None, ..., 1:] / powers[..., 1:]
    high = jnp.asarray(np.arange(1, HARMONICS + 1) >= FIRST)
    used = high[None, None] & (square > 0.0) & jnp.isfinite(default[..., 1:])
    known = measured.wave_power
    assert known is not None
    used = used & jnp.isnan(known[..., 1:])
    terms = jnp.where(used[None], jnp.log(ratio) - 0.5 * square[None] * ratio, 0.0)
    share = np.full(len(family), (1.0 - DEFAULT_SHARE) / (len(family) - 1))
    share[0] = DEFAULT_SHARE
    prior = jnp.asarray(np.log(share))[:, None]
    weight = jax.nn.softmax(jnp.sum(terms, axis=(1, 3)) + prior, axis=0)
    mixed = jnp.einsum("fo,fcsk->ocsk", weight, jnp.where(jnp.isfinite(powers), powers, 0.0))
    upper = jnp.asarray(np.arange(HARMONICS + 1) >= FIRST)
    mixed = jnp.where(upper, jnp.min(mixed, axis=0), jnp.max(mixed, axis=0))
    mixed = jnp.where(jnp.isfinite(default), mixed, jnp.inf)
    return dataclasses.replace(measured, wave_power=jnp.where(jnp.isnan(known), mixed, known))
