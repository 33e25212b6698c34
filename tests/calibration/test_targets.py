import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import (
    Experiment,
    diastolic_target,
    mean_flow_target,
    mean_pressure_target,
    ratio_target,
    systolic_target,
    waveform_target,
)
from calibration.targets import interpolate as interpolate_now
from lumped import MMHG, Fourier, Shooting, Surrogate, condition_from_clinic, metrics

REST = condition_from_clinic(110.0, 65.0, 0.8)
MODEL = Surrogate(R0=5e3, alpha=0.3)
interpolate = jax.jit(interpolate_now)


@pytest.fixture(scope="module")
def solution():
    return eqx.filter_jit(Experiment(REST, (), solver=Fourier(128)).solution)(MODEL)


def test_targets_read_the_metrics_in_units_of_sd(solution):
    known = metrics(solution)
    distal = np.asarray(solution.pressure("distal"))
    cases = [
        (mean_pressure_target, "distal", known.mean_P_distal),
        (mean_flow_target, "ostium", known.mean_Q),
        (systolic_target, "distal", distal.max()),
        (diastolic_target, "distal", distal.min()),
    ]
    for make, place, value in cases:
        # definition, round-off
        np.testing.assert_allclose(make(place, value - 3.0 * 7.0, 7.0)(solution), 3.0, rtol=1e-9)
    np.testing.assert_allclose(ratio_target(known.ratio + 0.02, 0.01)(solution), -2.0, rtol=1e-9)


def test_waveform_at_the_samples_is_the_waveform(solution):
    P, Q = solution.pressure("distal"), solution.flow("ostium")
    later = solution.t + 0.8  # a second beat
    for place, values in (("distal", P), ("ostium", Q)):
        target = waveform_target(place, later, values, 1.0)
        # interpolation is exact at samples; round-off of time over the sampling interval
        np.testing.assert_allclose(target.predicted(solution), values, rtol=1e-9, atol=1e-9)


def test_interpolation_is_of_fourth_order_on_uneven_samples():
    rng = np.random.default_rng(0)
    at = jnp.asarray(rng.uniform(0.0, 3.0, 200))

    def wave(t):
        return jnp.sin(2 * jnp.pi * t / 1.3) + 0.3 * jnp.cos(6 * jnp.pi * t / 1.3)

    errors = []
    for n in (64, 128):
        share = np.arange(n) / n
        t = jnp.asarray(1.3 * (share + 0.05 * np.sin(2 * np.pi * share)))
        errors.append(float(jnp.max(jnp.abs(interpolate(at, t, wave(t), 1.3) - wave(at)))))
    # order 4 with random points: 3.8 leaves room for where they fall
    assert np.log2(errors[0] / errors[1]) > 3.8


def test_interpolation_passes_over_repeated_times():
    t = jnp.array([0.0, 0.1, 0.1, 0.1, 0.3, 0.5, 0.8, 0.9])
    at = jnp.array([0.02, 0.1, 0.2, 0.45, 0.85, 0.95])
    found = interpolate(at, t, 2.0 + 0.0 * t, 1.0)
    np.testing.assert_allclose(found, 2.0, rtol=1e-12)  # weights sum to 1
    line = interpolate(at[1:4], t, 3.0 * t, 1.0)
    np.testing.assert_allclose(line, 3.0 * at[1:4], rtol=1e-12)  # exact for lines inside
    slope = jax.jacfwd(lambda s: interpolate(s, t, t, 1.0))(at)
    assert np.all(np.isfinite(np.asarray(slope)))


def test_systolic_target_follows_the_envelope_theorem():
    experiment = Experiment(REST, (systolic_target("distal", 0.0, MMHG),), solver=Fourier(128))

    def systolic(log_R0):
        return experiment(eqx.tree_at(lambda m: m.R0, MODEL, jnp.exp(log_R0)))[0]

    at, h = jnp.log(5e3), 1e-4
    both = jax.jit(jax.value_and_grad(systolic))
    central = (both(at + h)[0] - both(at - h)[0]) / (2 * h)
    # h² and round-off/h
    np.testing.assert_allclose(both(at)[1], central, rtol=1e-6)


def test_default_solvers_agree_between_samples():
    t = np.linspace(0.0, 0.8, 57, endpoint=False)
    target = waveform_target("distal", t, np.zeros(57), MMHG)
    found = [
        np.asarray(eqx.filter_jit(Experiment(REST, (target,), solver=solver))(MODEL))
        for solver in (None, Shooting())
    ]
    # mmHg; next to the closing valve, where a slope jumps, the sampling decides
    np.testing.assert_allclose(found[1], found[0], atol=0.1)


def test_bad_targets_are_refused():
    with pytest.raises(ValueError, match="positive standard deviation"):
        ratio_target(0.9, 0.0)
    with pytest.raises(ValueError, match="not finite"):
        mean_pressure_target("distal", np.nan, 1.0)
    with pytest.raises(ValueError, match="equal length"):
        waveform_target("distal", np.zeros(3), np.zeros(4), 1.0)
