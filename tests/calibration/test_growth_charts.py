import jax
import jax.numpy as jnp
import pytest

from calibration import (
    height_at,
    height_score,
    modified_height_score,
    modified_weight_score,
    weight_at,
    weight_score,
)

# percentiles 5, 50 and 95 of the CDC files statage.csv and wtage.csv at half months, between the
# whole years of our tables
HEIGHTS = [
    (48.5, 1, (95.581, 102.510, 109.522)),
    (48.5, 0, (94.040, 101.034, 108.424)),
    (120.5, 1, (128.162, 138.823, 149.905)),
    (120.5, 0, (127.452, 138.211, 149.604)),
    (192.5, 1, (160.780, 173.610, 185.462)),
    (192.5, 0, (151.942, 162.569, 173.237)),
]
WEIGHTS = [
    (48.5, 1, (13.610, 16.317, 20.283)),
    (48.5, 0, (13.090, 15.878, 20.394)),
    (120.5, 1, (24.944, 32.088, 46.158)),
    (120.5, 0, (24.865, 33.064, 48.175)),
    (192.5, 1, (47.316, 61.095, 84.292)),
    (192.5, 0, (42.956, 53.945, 78.052)),
]
SCORES = (-1.6448536, 0.0, 1.6448536)


@pytest.mark.parametrize(("value", "score", "chart"), [
    (height_at, height_score, HEIGHTS), (weight_at, weight_score, WEIGHTS),
])  # fmt: skip
def test_percentiles_are_those_of_the_published_charts(value, score, chart):
    for months, male, published in chart:
        for z, y in zip(SCORES, published, strict=True):
            # half a month beyond a whole year, where the line leaves the curve by less than this
            assert float(value(months / 12.0, male, z)) == pytest.approx(y, rel=2e-3)
            assert float(score(y, months / 12.0, male)) == pytest.approx(z, abs=0.03)


def test_score_and_value_undo_each_other():
    ages = jnp.linspace(2.0, 20.0, 37)
    for male in (0.0, 1.0):
        for z in (-4.0, -1.0, 0.0, 2.5):
            back = height_score(height_at(ages, male, z), ages, male)
            assert jnp.allclose(back, z, atol=1e-9)  # round-off over S = 0.04


def test_modified_scores_meet_the_others_at_two_and_go_on():
    for male in (0.0, 1.0):
        for z in (-2.0, 2.0):
            weight, height = weight_at(6.0, male, z), height_at(6.0, male, z)
            # round-off
            assert float(modified_weight_score(weight, 6.0, male)) == pytest.approx(z, abs=1e-9)
            assert float(modified_height_score(height, 6.0, male)) == pytest.approx(z, abs=1e-9)
    assert float(weight_score(110.0, 6.0, 0.0)) < 5.0 < float(modified_weight_score(44.0, 6.0, 0.0))


def test_a_vanishing_power_gives_the_logarithm():
    # the girls' L of height passes through zero between 4 and 5 years
    age = 4.0 + 0.238 / (0.238 + 0.048)
    M, S = float(height_at(age, 0.0)), 0.0432 + 0.832 * 0.001
    z = float(height_score(1.1 * M, age, 0.0))
    assert z == pytest.approx(float(jnp.log(1.1)) / S, rel=1e-3)  # S is rounded to 1e-4


def test_derivative_compiled_and_batched():
    ages = jnp.array([4.3, 9.6, 15.2])

    def score(height, age):
        return weight_score(height, age, 1.0)

    batch = jax.jit(jax.vmap(score))(jnp.array([17.0, 30.0, 57.0]), ages)
    for k, (w, age) in enumerate(zip((17.0, 30.0, 57.0), ages, strict=True)):
        assert float(batch[k]) == pytest.approx(float(score(w, age)), rel=1e-13)
        h = 1e-4
        slope = (score(w + h, age) - score(w - h, age)) / (2.0 * h)
        # error of the difference h² f''' and round-off 1e-16/h
        assert float(jax.grad(score)(w, age)) == pytest.approx(float(slope), rel=1e-7)
