"""Discrete Fourier transforms of real periodic samples, as matrix products.

The transforms here are short (a few hundred samples) and many. As products they cost about what a
fast transform costs, run on every device, and avoid a fault of XLA's CPU transform: batched inside
a loop it can wait forever for its own thread pool (openxla/xla issue 46345 and its neighbours).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float


def _tables(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Cos and sin of 2π jk/n for harmonics j ≤ n/2 and samples k; exact integer phase."""
    phase = np.outer(np.arange(n // 2 + 1), np.arange(n)) % n
    return np.cos(2.0 * np.pi * phase / n), np.sin(2.0 * np.pi * phase / n)


def to_harmonics(samples: Float[Array, "n k"]) -> Complex[Array, "f k"]:
    """v̂_j = Σ_k v_k exp(−2πi jk/n) for j = 0 … n/2, n even; along the first axis."""
    cos, sin = _tables(samples.shape[0])
    return jax.lax.complex(jnp.asarray(cos) @ samples, -jnp.asarray(sin) @ samples)


def from_harmonics(x_hat: Complex[Array, " f"], n: int) -> Float[Array, " n"]:
    """The n samples whose harmonics are x̂: the inverse of `to_harmonics`."""
    cos, sin = _tables(n)
    # a real signal has conjugate harmonics: all but the mean and the last count twice
    weight = np.full(n // 2 + 1, 2.0 / n)
    weight[0] = weight[-1] = 1.0 / n
    table = jnp.asarray(np.concatenate([weight[:, None] * cos, -weight[:, None] * sin]))
    return jnp.concatenate([x_hat.real, x_hat.imag]) @ table
