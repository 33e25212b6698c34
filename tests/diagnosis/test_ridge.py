"""Evidence by an integral over the size: the integral itself, fits at a size, and a ridge."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp

from diagnosis import CATALOGUE, Effect, find_effect, measured, stacked
from diagnosis.effects import NEAR_ZERO
from diagnosis.engine import base_start, run_fits
from diagnosis.hypothesis import numbers_of
from diagnosis.ridge import FINE, SIZES, along_ridges, integrals
from tests.diagnosis.records import synthetic

TWO_PI = 2.0 * np.pi


def _factor(x):
    """Factor of the normal prior of a size, see `diagnosis.effects`."""
    return (1.0 - NEAR_ZERO) * x**2 + NEAR_ZERO


def only(name: str) -> tuple[Effect, ...]:
    return (find_effect(CATALOGUE, name),)


def test_the_integral_of_a_parabola_is_that_of_its_closed_form():
    def integrand(x: float, power: int) -> float:
        prior = 2.0 * _factor(x) * np.exp(-0.5 * x**2) / TWO_PI**0.5
        return prior * np.exp(0.7 + 2.0 * x - 1.5 * x**2) * x**power

    x = np.append(0.0, SIZES)
    total, mean, sd = integrals((0.7 + 2.0 * x - 1.5 * x**2)[None])
    moments = [quad(integrand, 0.0, FINE[-1], args=(power,))[0] for power in range(3)]
    # a sum over steps of 0.01 of a smooth function, by the trapezoidal rule
    assert total[0] == pytest.approx(np.log(moments[0]), abs=1e-5)
    assert mean[0] == pytest.approx(moments[1] / moments[0], abs=1e-5)
    expected = np.sqrt(moments[2] / moments[0] - (moments[1] / moments[0]) ** 2)
    assert sd[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [("sensor_height", 4.0), ("inertance", 0.08)])
def test_fits_at_given_sizes_add_up_to_the_evidence_of_the_fit(name, size):
    """Where waveforms leave no ridge, the integral over the size is the parabola's."""
    batch, effects = stacked([measured(synthetic({name: size}, seed=1))]), only(name)
    numbers = numbers_of(effects)
    fit = run_fits(batch, [0], [(0, -1)], base_start(batch), numbers, effects)
    width = float(numbers.sd[0])
    x = fit.x[0, -2] + fit.size_sd[0, 0] / width * np.linspace(-5.0, 5.0, 21)
    starts = np.tile(fit.x, (x.size, 1))
    held = run_fits(batch, [0] * x.size, [(0, -1)] * x.size, starts, numbers, effects, fixed_size=x)
    np.testing.assert_allclose(held.x[:, -2], x)
    np.testing.assert_allclose(held.sizes[:, 0], x * width)
    one_sided = effects[0].one_sided
    log_prior = np.log(_factor(x)) - 0.5 * x**2 + np.log((2.0 if one_sided else 1.0) / TWO_PI**0.5)
    total = logsumexp(held.log_evidence + log_prior) + np.log(x[1] - x[0])
    # the model is not quite linear over the posterior: 0.003 and 0.04
    assert total == pytest.approx(fit.log_evidence[0], abs=0.1)


@pytest.mark.slow
def test_three_ratios_hardly_speak_against_a_loss_that_flow_can_hide():
    """Some α fits with any size: evidence near one, size as before; a parabola denies the loss."""
    effects = only("quadratic_loss")
    batch = stacked([measured(synthetic({}, seed=3), "ffr")])
    numbers = numbers_of(effects)
    base = run_fits(batch, [0], [(-1, -1)], base_start(batch), numbers, effects)
    found = along_ridges(batch, base, np.array([0]), numbers, effects)
    alone = run_fits(batch, [0], [(0, -1)], base.x, numbers, effects)
    assert bool(found.sound[0])
    assert found.log_evidence[0] - base.log_evidence[0] > -2.5
    assert alone.log_evidence[0] - base.log_evidence[0] < -3.5
    # mean and standard deviation of the main part of the prior: 5.5 and 2.3
    assert 4.0 < found.sizes[0, 0] < 7.0
    assert 1.5 < found.size_sd[0, 0] < 3.0
