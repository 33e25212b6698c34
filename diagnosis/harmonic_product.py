"""Multiplication by a waveform, as a matrix that acts on the real coefficients of another.

Real coefficients of a waveform v(t) = Re Σ s_k exp(2πikt/T) are s_0, then Re s_k, then Im s_k. With
w_k the complex Fourier coefficients of the factor, w_{−k} = w_k*, the product has

    p_0 = w_0 s_0 + Re Σ_j w_j* s_j,     p_k = 2 w_k s_0 + Σ_j (w_{k−j} s_j + w_{k+j} s_j*),

j from 1 on: every entry of the matrix is the sum of two numbers out of w, so that it takes a
fraction of the time of sampling, multiplying and analysing each harmonic.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from diagnosis.resolution import SAMPLES


class HarmonicProduct:
    """The matrix of a product, from harmonics up to one number to harmonics up to another."""

    def __init__(self, rows: int, columns: int) -> None:
        """Tables for a product.

        Args:
            rows: harmonics kept of the product, besides the mean.
            columns: harmonics of the waveform that is multiplied, besides the mean.
        """
        most = rows + columns
        if 2 * most >= SAMPLES:
            raise ValueError(f"{most} harmonics: fewer than {SAMPLES // 2} are resolved.")
        angle = 2.0 * np.pi / SAMPLES * np.outer(np.arange(most + 1), np.arange(SAMPLES))
        self._analysis = np.concatenate([np.cos(angle), -np.sin(angle)]) / SAMPLES
        k, of_k = _coefficients(rows)
        j, of_j = _coefficients(columns)
        k, j, of_k, of_j = k[:, None], j[None, :], of_k[:, None], of_j[None, :]
        imaginary = (of_k + of_j) % 2
        below = np.where((imaginary == 1) & (k < j), -1.0, 1.0)  # Im w_{k−j} = −Im w_{j−k}
        below = np.where((of_k == 0) & (of_j == 1), -below, below)
        above = np.where((of_k == 1) & (of_j == 1), -1.0, 1.0)
        # of s_0 both terms are the same; of p_0 they are, and count once
        half = np.where(k == 0, 0.5, 1.0)
        self._place = np.stack([np.abs(k - j), k + j]) + (most + 1) * imaginary
        self._sign = np.stack([half * below, half * above])

    def __call__(self, wave: Float[Array, " n"]) -> Float[Array, "r c"]:
        """The matrix of multiplication by a sampled waveform."""
        w = jnp.asarray(self._analysis) @ wave
        first, second = w[jnp.asarray(self._place)] * jnp.asarray(self._sign)
        return first + second


def _coefficients(harmonics: int) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Harmonic of every real coefficient, and 1 where it is an imaginary part."""
    k = np.arange(1, harmonics + 1)
    return np.r_[0, k, k], np.r_[0, np.zeros_like(k), np.ones_like(k)]
