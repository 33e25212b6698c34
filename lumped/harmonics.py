"""Discrete Fourier transforms of real periodic samples, as matrix products.

The transforms here are short (a few hundred samples) and many. As products, with the symmetries of
cosine and sine used once each, they cost about what a fast transform costs, run on every device,
and avoid a fault of XLA's CPU transform: batched inside a loop it can wait forever for its own
thread pool (openxla/xla issue 46345 and its neighbours; met here with chunks of 1000).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float


def _tables(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of 2π jk/n for harmonics j ≤ n/2 and samples k; exact integer phase."""
    phase = np.outer(np.arange(n // 2 + 1), np.arange(n)) % n
    return np.cos(2.0 * np.pi * phase / n), np.sin(2.0 * np.pi * phase / n)


def to_harmonics(samples: Float[Array, "n k"]) -> Complex[Array, "f k"]:
    """v̂_j = Σ_k v_k exp(−2πi jk/n) for j = 0 … n/2, n even; along the first axis."""
    cos, sin = _tables(samples.shape[0])
    return jax.lax.complex(jnp.asarray(cos) @ samples, -jnp.asarray(sin) @ samples)


def from_harmonics(x_hat: Complex[Array, " f"], n: int) -> Float[Array, " n"]:
    """The n samples whose harmonics are x̂: the inverse of `to_harmonics`, n a multiple of 4.

    x_k = Σ_j w_j (Re x̂_j cos(2π jk/n) − Im x̂_j sin(2π jk/n)): the cosine sum is even in k and the
    sine sum odd, and about k = n/4 the even harmonics of each have one parity and the odd ones the
    other. So four sums over a quarter of the samples give all.
    """
    cos, sin = _tables(n)
    quarter = n // 4 + 1
    # a real signal has conjugate harmonics: all but the mean and the last count twice
    weight = np.full((n // 2 + 1, 1), 2.0 / n)
    weight[0] = weight[-1] = 1.0 / n
    C, S = jnp.asarray(weight * cos)[:, :quarter], jnp.asarray(-weight * sin)[:, :quarter]
    real, imag = x_hat.real, x_hat.imag
    cos_even, cos_odd = real[0::2] @ C[0::2], real[1::2] @ C[1::2]
    sin_even, sin_odd = imag[0::2] @ S[0::2], imag[1::2] @ S[1::2]
    even = jnp.concatenate([cos_even + cos_odd, (cos_even - cos_odd)[-2::-1]])
    odd = jnp.concatenate([sin_even + sin_odd, (sin_odd - sin_even)[-2::-1]])
    return jnp.concatenate([even + odd, (even - odd)[-2:0:-1]])
