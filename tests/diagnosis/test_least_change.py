"""The least change of a lumen that has a wanted loss, and the loss that a record wants."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import lumen_law
from diagnosis.least_change import CLOSEST, changed_lumen, half_axes, least_change
from jaxfsi import Lumen

BLOOD = {"mu": 0.04, "rho": 1.06}
SD = 0.01
ANGLE = 2.0 * np.pi * np.arange(24) / 24
S = np.linspace(0.0, 2.0, 21)


def elliptic(major, minor, s=S, turned=0.4):
    """Elliptic sections of given half-axes [cm], turned and off their centre."""
    major, minor = (np.broadcast_to(axis, s.shape)[:, None] for axis in (major, minor))
    x, y = major * np.cos(ANGLE), minor * np.sin(ANGLE)
    c, n = np.cos(turned), np.sin(turned)
    return Lumen(jnp.asarray(np.stack([c * x - n * y + 0.3, n * x + c * y], -1)), jnp.asarray(s))


TUBE = elliptic(0.15, 0.15)
SLIT = elliptic(np.where(S < 1.0, 0.2, 0.17), 0.17 - 0.1 * np.exp(-((S - 0.6) ** 2) / 0.1))


def test_the_change_of_a_straight_round_tube_is_that_of_poiseuille():
    found = least_change(TUBE, 1.5, sd=SD, correlation_length=1e6, **BLOOD)
    radius = float(half_axes(TUBE)[0, 1])
    # R0 ~ 1/r⁴; errors alike everywhere but for the jitter of 1e-10
    np.testing.assert_allclose(found.delta_r, radius * (1.5**-0.25 - 1.0), rtol=1e-7)
    assert found.n_sd == pytest.approx(radius * (1.0 - 1.5**-0.25) / SD, rel=1e-7)


@pytest.mark.parametrize("Q", [0.0, 1.5])
@pytest.mark.parametrize("factor", [0.8, 1.0, 1.4, 3.0])
def test_the_loss_wanted_is_met_and_the_change_is_the_least(factor, Q):
    found = least_change(SLIT, factor, sd=SD, Q=Q, **BLOOD)
    before, after = lumen_law(SLIT, **BLOOD), lumen_law(found.lumen, **BLOOD)
    ratio = float((after.R0 + after.K * Q) / (before.R0 + before.K * Q))
    assert abs(np.log(ratio / factor)) < CLOSEST
    assert float(found.imbalance) < 1e-6  # z parallel to the gradient: the Lagrange condition
    assert np.sign(found.delta_r[np.argmax(np.abs(found.delta_r))]) == np.sign(1.0 - factor)


def test_no_other_change_with_the_same_loss_is_smaller():
    found = least_change(SLIT, 1.4, sd=SD, **BLOOD)
    correlation = np.exp(-0.5 * ((S[:, None] - S) / 0.15) ** 2) + 1e-10 * np.eye(S.size)

    @jax.jit
    def loss(delta):
        return lumen_law(changed_lumen(SLIT, delta), **BLOOD).R0

    def n_sd(delta):
        return float(np.sqrt(delta @ np.linalg.solve(SD**2 * correlation, delta)))

    def met(delta):
        """The same change stretched until it has the loss."""
        low, high = 0.0, 3.0
        wanted = 1.4 * float(lumen_law(SLIT, **BLOOD).R0)
        for _ in range(60):
            middle = 0.5 * (low + high)
            short = float(loss(middle * delta)) < wanted
            low, high = (middle, high) if short else (low, middle)
        return middle * delta

    delta = np.asarray(found.delta_r)
    assert n_sd(delta) == pytest.approx(float(found.n_sd), rel=1e-6)
    rng = np.random.default_rng(0)
    root = SD * np.linalg.cholesky(correlation)
    for _ in range(5):
        other = met(delta + 0.2 * root @ rng.standard_normal(S.size))
        assert n_sd(other) > float(found.n_sd)


def test_the_gradient_of_the_loss_is_that_of_central_differences():
    @jax.jit
    def R0(delta):
        return lumen_law(changed_lumen(SLIT, delta), **BLOOD).R0

    at = jnp.asarray(0.005 * np.sin(3.0 * S))
    slope, h = jax.grad(R0)(at), 1e-6
    for k in (0, 6, 20):
        e = jnp.zeros(S.size).at[k].set(h)
        # truncation 1e-9 of a third derivative of order 1/r³, rounding 1e-10
        assert (R0(at + e) - R0(at - e)) / (2.0 * h) == pytest.approx(float(slope[k]), rel=1e-6)


def test_changed_ellipses_stay_ellipses():
    grown = changed_lumen(SLIT, jnp.full(S.size, 0.02))
    before, after = half_axes(SLIT), half_axes(grown)
    np.testing.assert_allclose(after - before, 0.02, rtol=1e-9)
    factors = 1.0 + 0.02 / np.asarray(before)
    np.testing.assert_allclose(grown.area, SLIT.area * factors.prod(axis=1), rtol=1e-12)


def test_a_narrowing_stays_where_the_scan_may_err():
    sd = np.where(S > 1.0, 0.01, 0.0)
    found = least_change(SLIT, 1.1, sd=sd, **BLOOD)
    assert np.all(np.asarray(found.delta_r)[S <= 1.0] == 0.0)
    assert float(found.n_sd) > float(least_change(SLIT, 1.1, sd=SD, **BLOOD).n_sd)


def test_jitted_and_batched_it_is_the_same_and_bad_numbers_are_nan():
    @jax.jit
    def n_sd(factors):
        return jax.vmap(lambda f: least_change(SLIT, f, sd=SD, Q=1.5, **BLOOD).n_sd)(factors)

    factors = (0.9, 1.4, -1.0)
    found = n_sd(jnp.asarray(factors))
    for k, factor in enumerate(factors[:2]):
        own = least_change(SLIT, factor, sd=SD, Q=1.5, **BLOOD).n_sd
        assert found[k] == pytest.approx(float(own), rel=1e-7)
    assert np.isnan(found[2])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lumen": elliptic(0.15, 0.0)}, "half-axis must be positive"),
        ({"lumen": elliptic(0.15, 0.1, s=S[::-1])}, "s must increase"),
        ({"factor": 0.0}, "give a positive, finite one"),
        ({"factor": np.nan}, "give a positive, finite one"),
        ({"sd": 0.0}, "above 0 somewhere"),
        ({"correlation_length": 0.0}, "correlation length"),
        ({"Q": -1.0}, "flow"),
        ({"mu": 0.0}, "viscosity"),
        ({"factor": 0.3, "sd": np.where(S > 1.9, 0.01, 0.0)}, "no change of the lumen was found"),
    ],
)
def test_bad_input_is_refused_once_and_clearly(change, words):
    given = {"lumen": SLIT, "factor": 1.4, "sd": SD, **BLOOD} | change
    with pytest.raises(ValueError, match=words):
        least_change(given.pop("lumen"), given.pop("factor"), **given)
