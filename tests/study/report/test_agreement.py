import math

import numpy as np
import pytest
import scipy.stats

from study.report.agreement import agreement


def test_numbers_of_a_small_table():
    """Differences +1, 0, −1, +2 hundredths, by hand."""
    found = agreement([0.91, 0.90, 0.84, 0.82], [0.90, 0.90, 0.85, 0.80])
    assert found.n == 4
    assert found.bias == pytest.approx(0.005)
    assert found.sd == pytest.approx(math.sqrt(5e-4 / 3.0))
    assert found.rmse == pytest.approx(math.sqrt(6e-4 / 4.0))
    assert found.high - found.low == pytest.approx(2 * 1.96 * found.sd)
    assert found.bias_95 == pytest.approx(scipy.stats.t.ppf(0.975, 3) * found.sd / 2.0)


def test_limits_hold_the_share_they_promise():
    generator = np.random.default_rng(3)
    error = generator.normal(0.02, 0.03, 4000)
    found = agreement(0.9 + error, np.full(4000, 0.9))
    inside = np.mean((error > found.low) & (error < found.high))
    assert inside == pytest.approx(0.95, abs=0.01)
    assert math.isnan(found.r)  # measured values that are all alike correlate with nothing


def test_one_pair_and_none():
    found = agreement([0.9], [0.88])
    assert found.rmse == pytest.approx(0.02)
    assert math.isnan(found.sd)
    with pytest.raises(ValueError, match="at least one"):
        agreement([], [])
