"""Harmonics that few samples a beat fold back, against a beat that is known between its samples."""

import numpy as np
import pytest

import lumped
from diagnosis.aliasing import aliased_power
from diagnosis.resolution import HARMONICS
from lumped import MMHG

FINE = 1600


@pytest.fixture(scope="module")
def distal():
    """A distal pressure under dobutamine, whose upstroke is steep [mmHg]."""
    condition = lumped.condition_from_clinic(135.0, 67.0, 0.51)
    surrogate = lumped.Surrogate(R0=2.5 * MMHG, alpha=0.1, coronary=lumped.nominal_coronary())
    beat = lumped.solve_periodic(surrogate.network(condition), 0.51, lumped.Fourier(n_samples=FINE))
    return np.asarray(beat.pressure("distal")) / MMHG


@pytest.mark.parametrize("n", [32, 50, 64])
def test_power_is_that_of_the_harmonics_that_are_folded_back(distal, n):
    few = distal[:: FINE // n] if FINE % n == 0 else distal[np.arange(n) * FINE // n]
    kept = np.arange(1, n // 2)
    true = np.fft.rfft(distal)[kept] / FINE
    folded = np.abs(np.fft.rfft(few)[kept] / n - true) ** 2
    estimated = aliased_power(few, np.zeros(HARMONICS + 1))[kept]
    # the spectrum of a beat has gaps, and is no power law: a factor of two in amplitude is enough
    upper = slice(n // 4, None)
    ratio = np.sum(estimated[upper]) / np.sum(folded[upper])
    assert 0.5 < np.sqrt(ratio) < 2.5


def test_nothing_is_folded_back_where_samples_are_many_or_the_beat_is_smooth(distal):
    none = np.zeros(HARMONICS + 1)
    many = distal[::4]
    assert np.sqrt(np.max(aliased_power(many, none))) < 0.005
    smooth = 90.0 + 10.0 * np.sin(2.0 * np.pi * np.arange(50) / 50.0)
    assert np.max(aliased_power(smooth, none)) < 1e-20


def test_noise_of_the_highest_harmonics_is_not_taken_for_a_steep_beat():
    n, sd = 50, 0.2
    noise = np.where(np.arange(HARMONICS + 1) < n / 2, sd**2 / n, np.inf)
    rng = np.random.default_rng(0)
    found = [aliased_power(rng.normal(0.0, sd, n), noise)[n // 2 - 1] for _ in range(400)]
    assert np.mean(found) < 0.2 * sd**2 / n
