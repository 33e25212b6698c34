"""The matrix transforms equal NumPy's fast ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped.harmonics import from_harmonics, to_harmonics


@pytest.mark.parametrize("n", [4, 8, 12, 64, 256, 1000])
def test_transforms_equal_numpy_and_invert_each_other(n):
    # 1e-12: sums of n terms of size one
    samples = np.random.default_rng(n).normal(size=(n, 2))
    x_hat = to_harmonics(jnp.asarray(samples))
    np.testing.assert_allclose(x_hat, np.fft.rfft(samples, axis=0), atol=1e-11)
    back = jax.vmap(from_harmonics, (1, None), 1)(x_hat, n)
    np.testing.assert_allclose(back, samples, atol=1e-12)
