import math

import jax
import jax.numpy as jnp
import pytest

from diagnosis import RATIO_SD, ratio_gap


def test_gap_of_two_standard_deviations_has_the_normal_p_value():
    gap = ratio_gap(0.84, 0.80, 0.02)
    # round-off of a difference of two numbers near one
    assert float(gap.difference) == pytest.approx(0.04, abs=1e-15)
    assert float(gap.z) == pytest.approx(2.0, rel=1e-13)
    assert float(gap.p_value) == pytest.approx(0.045500263896358, rel=1e-12)


def test_gap_uses_the_reproducibility_of_ffr_by_default():
    assert float(ratio_gap(0.80 + RATIO_SD, 0.80).z) == pytest.approx(1.0, rel=1e-12)


def test_no_gap_is_certain_to_arise_by_chance():
    assert float(ratio_gap(0.9, 0.9).p_value) == 1.0


@pytest.mark.parametrize("sd", [0.0, -0.01, math.nan])
def test_gap_refuses_an_error_that_is_not_positive(sd):
    with pytest.raises(ValueError, match=r"must be positive. Leave it out"):
        ratio_gap(0.8, 0.8, sd)


def test_traced_numbers_out_of_range_make_all_of_a_gap_no_number():
    for bad in ((0.8, 0.7, -0.02), (0.8, 0.7, 0.0), (0.8, 0.7, math.nan), (math.inf, 0.7, 0.02)):
        assert all(math.isnan(value) for value in jax.jit(ratio_gap)(*bad)), bad


def test_gap_of_a_batch_equals_the_loop_and_jit():
    predicted, measured = jnp.array([0.7, 0.8, 0.95]), jnp.array([0.75, 0.8, 0.91])
    batch = jax.jit(ratio_gap)(predicted, measured)
    for k in range(3):
        one = ratio_gap(predicted[k], measured[k])
        # the compiler may fuse multiply and add: the last bit
        assert float(batch.p_value[k]) == pytest.approx(float(one.p_value), rel=1e-14)


def test_derivative_of_p_matches_central_differences():
    def p(x):
        return ratio_gap(x, 0.8, 0.02).p_value

    h = 1e-6
    central = (p(0.83 + h) - p(0.83 - h)) / (2.0 * h)
    # truncation h² p''' is 1e-9 relative, round-off 1e-16/h
    assert float(jax.grad(p)(0.83)) == pytest.approx(float(central), rel=1e-7)
