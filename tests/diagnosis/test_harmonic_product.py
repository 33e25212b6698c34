"""Multiplication by a waveform against samples."""

import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis.harmonic_product import HarmonicProduct
from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import FROM_SAMPLES, TO_SAMPLES


def places(harmonics):
    """Positions of the real coefficients of the first harmonics."""
    return np.r_[0 : harmonics + 1, HARMONICS + 1 : HARMONICS + 1 + harmonics]


@pytest.mark.parametrize(("rows", "columns"), [(24, 24), (HARMONICS, 14), (3, 9)])
def test_the_matrix_is_that_of_samples(rows, columns):
    wave = np.random.default_rng(3).normal(size=SAMPLES)
    sampled = FROM_SAMPLES[places(rows)] @ (wave[:, None] * TO_SAMPLES[:, places(columns)])
    found = HarmonicProduct(rows, columns)(jnp.asarray(wave))
    np.testing.assert_allclose(found, sampled, atol=1e-13)


def test_harmonics_that_samples_do_not_resolve_are_refused():
    with pytest.raises(ValueError, match="140 harmonics"):
        HarmonicProduct(100, 40)
