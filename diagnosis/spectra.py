"""Waveforms of a beat as harmonics, and back.

Waveforms have `SAMPLES` samples; harmonics are scaled so that
x(t) = X_0 + Σ Re X_k cos(ω_k t) − Im X_k sin(ω_k t). `HARMONICS` of them are kept: those above are
indistinguishable from the noise of a sensor.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from diagnosis.resolution import HARMONICS, SAMPLES

PHASE = np.arange(SAMPLES) / SAMPLES
"""Time of the samples in beats."""

Spectrum = Complex[Array, " f"]


def _tables() -> tuple[np.ndarray, np.ndarray]:
    """Matrices from real coefficients (means, Re, Im) to samples and back."""
    angle = 2.0 * np.pi * np.outer(PHASE, np.arange(1, HARMONICS + 1))
    to_samples = np.concatenate([np.ones((SAMPLES, 1)), np.cos(angle), -np.sin(angle)], axis=1)
    weight = np.full((2 * HARMONICS + 1, 1), 2.0 / SAMPLES)
    weight[0] = 1.0 / SAMPLES
    return to_samples, weight * to_samples.T


TO_SAMPLES, FROM_SAMPLES = _tables()


def autoregressive_shape(rho: Any, cosine: Any) -> Any:
    """Spectrum of autoregressive noise of first order over that of white noise of its variance.

    Args:
        rho: correlation of neighbouring samples.
        cosine: of the angle of a harmonic between two samples.
    """
    return (1.0 - rho**2) / (1.0 - 2.0 * rho * cosine + rho**2)


def harmonics(wave: Float[Array, "*b n"]) -> Complex[Array, "*b f"]:
    """Harmonics of a sampled waveform."""
    return as_harmonics(wave @ jnp.asarray(FROM_SAMPLES.T))


def samples(spectrum: Complex[Array, "*b f"]) -> Float[Array, "*b n"]:
    """Samples of a waveform given by its harmonics."""
    return coefficients(spectrum) @ jnp.asarray(TO_SAMPLES.T)


def coefficients(spectrum: Complex[Array, "*b f"]) -> Float[Array, "*b m"]:
    """Harmonics as real numbers: mean, real parts, imaginary parts."""
    return jnp.concatenate([spectrum.real, spectrum.imag[..., 1:]], axis=-1)


def as_harmonics(q: Float[Array, "*b m"]) -> Complex[Array, "*b f"]:
    """Inverse of `coefficients`."""
    count = q.shape[-1] // 2
    none = jnp.zeros_like(q[..., :1])
    imaginary = jnp.concatenate([none, q[..., count + 1 :]], axis=-1)
    return jax.lax.complex(q[..., : count + 1], imaginary)
