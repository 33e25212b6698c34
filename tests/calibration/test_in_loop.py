"""α corrected with a model that the surrogate does not know."""

import pytest

from calibration import (
    calibrate_in_loop,
    next_alpha,
    surrogate_ratio,
)
from calibration.in_loop import Trial
from lumped import Surrogate, condition_from_clinic

REST = condition_from_clinic(110.0, 65.0, 0.8)


SURROGATE = Surrogate(R0=300.0, K=1000.0)


def _three_dimensional(alpha):
    """A model with a larger and differently shaped loss than the surrogate's."""
    return surrogate_ratio(Surrogate(R0=1500.0, K=1300.0), REST, alpha)


def test_loop_meets_the_target_within_two_extra_runs():
    start = 0.119  # of the surrogate itself
    fit = calibrate_in_loop(SURROGATE, REST, 0.91, _three_dimensional, [start])
    assert abs(_three_dimensional(start) - 0.91) > 0.01  # there is something to mend
    assert fit.reached
    assert fit.extra_runs <= 2
    assert fit.ratio == pytest.approx(0.91, abs=0.002)
    assert _three_dimensional(fit.alpha) == fit.ratio


def test_loop_is_exact_where_the_surrogate_errs_by_a_factor():
    """The linear surrogate with three times the resistance: one correction is the answer."""
    linear = Surrogate(R0=5000.0)
    run = lambda alpha: surrogate_ratio(Surrogate(R0=15000.0), REST, alpha)  # noqa: E731
    alpha = next_alpha(linear, REST, 0.9, [Trial(0.1, run(0.1))])
    assert run(alpha) == pytest.approx(0.9, abs=1e-9)


def test_loop_that_cannot_reach_says_so():
    fit = calibrate_in_loop(SURROGATE, REST, 0.9, lambda alpha: 0.8, [0.1])
    assert not fit.reached
    assert fit.extra_runs == 2
    with pytest.raises(ValueError, match="between 0 and 1"):
        next_alpha(SURROGATE, REST, 0.9, [Trial(0.1, 1.2)])
    good = Trial(0.1, 0.85)
    assert next_alpha(SURROGATE, REST, 0.9, [Trial(2.0, 1.01), good]) == next_alpha(
        SURROGATE, REST, 0.9, [good]
    )
    with pytest.raises(ValueError, match="at least one"):
        calibrate_in_loop(SURROGATE, REST, 0.9, lambda alpha: 0.8, [])
