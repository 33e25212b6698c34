"""The curve of a ramp."""

import equinox as eqx
import jax
import numpy as np
import pytest

from calibration import (
    RampRecord,
    fit_ramp,
    measured_slope,
)
from lumped import MMHG

A, B, L = 300.0, 1000.0, 45.0


def _record(rate=37.5 * MMHG, *, n=300, noise=0.0, shift=0.0, transmural=(0.0, 0.0)):
    """A ramp that obeys the law exactly: Q(t) rises, the drop follows."""
    t = np.linspace(0.0, 42.0 * MMHG / rate, n)
    Q = 7.0 * (t / t[-1]) ** 0.6
    growth = np.zeros(n)
    growth[1:] = 0.6 * Q[1:] / t[1:]
    P_distal = np.full(n, 60.0 * MMHG + shift)
    drop = A * Q + B * Q * np.abs(Q) + L * growth
    for _ in range(60):  # the drop stands in the transmural pressure too
        p = P_distal + drop / 2.0 - 60.0 * MMHG
        a, b = A + transmural[0] * p, B + transmural[1] * p
        drop = a * Q + b * Q * np.abs(Q) + L * growth
    generator = np.random.default_rng(0)
    return RampRecord(t, P_distal + drop + noise * generator.standard_normal(n), P_distal, Q)


def test_curve_of_an_exact_ramp_is_found():
    """Up to the trapezium rule of the means, whose error falls with the square of the step."""
    fits = [fit_ramp(_record(n=n)) for n in (481, 961)]
    errors = [np.abs(np.array([f.law.R0, f.law.K, f.L]) / [A, B, L] - 1.0) for f in fits]
    assert errors[1].max() < 1e-5
    assert np.all((errors[0] / errors[1] > 3.8) & (errors[0] / errors[1] < 4.2))
    fit = fits[1]
    slope, _ = fit.tangent()
    assert float(slope) == pytest.approx(np.sqrt(A**2 + 4.0 * B * 40.0 * MMHG), rel=1e-5)
    secant, _ = fit.secant(40.0 * MMHG)
    assert float(secant) == pytest.approx((float(fit.law.R0) + float(slope)) / 2.0, rel=1e-8)


def test_fluttering_wall_does_not_decide_the_curve():
    """A flow that swings by 2 % and 110 Hz for 30 ms of a quick ramp, as a 3D run's did."""
    calm = _record(150.0 * MMHG)
    t = np.asarray(calm.t)
    swing = 0.02 * np.sin(2.0 * np.pi * 110.0 * t) * ((t > 0.23) & (t < 0.26))
    fit = fit_ramp(eqx.tree_at(lambda r: r.Q, calm, calm.Q * (1.0 + swing)))
    assert float(fit.L) == pytest.approx(L, rel=0.2)
    assert float(fit.law.secant(8.0 * MMHG)) == pytest.approx(
        float(fit_ramp(calm).law.secant(8.0 * MMHG)), rel=0.02
    )


def test_errors_cover_the_truth_as_often_as_they_say():
    """Tangents of 60 noisy ramps lie within two standard deviations 95 times in a hundred."""
    truth = np.sqrt(A**2 + 4.0 * B * 40.0 * MMHG)
    hits = 0
    for seed in range(60):
        record = _record(n=200)
        noise = 0.3 * MMHG * np.random.default_rng(seed).standard_normal(200)
        fit = fit_ramp(eqx.tree_at(lambda r: r.P_aorta, record, record.P_aorta + noise))
        slope, sd = fit.tangent()
        hits += abs(float(slope) - truth) < 2.0 * float(sd)
    assert 50 <= hits <= 60


def test_negative_coefficient_is_left_out():
    """A ramp that is straight with noise may fit b < 0; then b is 0 and a the plain slope."""
    t = np.linspace(0.0, 1.0, 100)
    Q = 2.0 * t
    record = RampRecord(t, 500.0 * Q - 8.0 * Q**2, np.zeros(100), Q)
    fit = fit_ramp(record, settling=0.0)
    assert float(fit.law.K) == 0.0
    assert float(fit.law.R0) > 0.0


def test_transmural_dependence_needs_two_ramps():
    truth = (1e-3, 5e-3)
    records = [_record(transmural=truth), _record(shift=30.0 * MMHG, transmural=truth)]
    fit = fit_ramp(records, P_ref=60.0 * MMHG)
    np.testing.assert_allclose(fit.transmural, truth, rtol=1e-4)
    np.testing.assert_allclose([fit.law.R0, fit.law.K], [A, B], rtol=1e-4)
    np.testing.assert_array_equal(fit_ramp(records[0]).transmural, 0.0)


def test_slope_of_the_record_itself():
    slow = RampRecord(*_columns())
    expected = np.sqrt(A**2 + 4.0 * B * 40.0 * MMHG)
    # a parabola over ±10 mmHg of a square root: 1 %
    assert measured_slope(slow) == pytest.approx(expected, rel=0.01)
    assert measured_slope(slow, 80.0 * MMHG) is None


def _columns():
    Q = np.linspace(1e-6, 7.4, 400)
    drop = A * Q + B * Q**2
    return np.linspace(0.0, 1.0, 400), drop, np.zeros(400), Q


def test_derivative_of_the_tangent_matches_differences():
    record = _record(noise=0.2 * MMHG)

    def tangent(scale):
        scaled = eqx.tree_at(lambda r: r.Q, record, record.Q * scale)
        return fit_ramp(scaled).tangent()[0]

    h = 1e-5
    difference = (tangent(1.0 + h) - tangent(1.0 - h)) / (2.0 * h)
    assert float(jax.grad(tangent)(1.0)) == pytest.approx(float(difference), rel=1e-6)


def test_faulty_ramps_are_refused():
    with pytest.raises(ValueError, match="four of one length"):
        RampRecord(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(4))
    few = RampRecord(*(column[:5] for column in _columns()))
    with pytest.raises(ValueError, match="too few"):
        fit_ramp(few)
    with pytest.raises(ValueError, match="too few"):
        fit_ramp([_record(), few])
