import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    AorticPressure,
    Constant,
    Ramp,
    Sinusoid,
    Stretched,
    VentricularPressure,
    sampled,
    waveform_mean,
)
from lumped.verification import Pulse
from lumped.waveforms import smooth_bump

T = 0.8
AORTA = AorticPressure(P_systolic=110.0, P_diastolic=65.0, period=T)
VENTRICLE = VentricularPressure(P_peak=110.0, period=T)
PERIODIC = {
    "aorta": AORTA,
    "ventricle": VENTRICLE,
    "sinusoid": Sinusoid(mean=1.0, amplitude=2.0, period=T, phase=0.4),
    "linear": sampled([0.0, 0.2, 0.5], [1.0, 3.0, -1.0], T),
    "cubic": sampled([0.1, 0.2, 0.5, 0.7], [1.0, 3.0, -1.0, 0.5], T, kind="cubic"),
}


@jax.jit
def evaluate(waveform, t):
    return jax.vmap(waveform)(t)


@jax.jit
def slopes(waveform, t):
    return jax.vmap(jax.grad(waveform))(t)


@pytest.mark.parametrize("waveform", PERIODIC.values(), ids=PERIODIC)
def test_waveform_repeats_and_is_continuous(waveform):
    t = jnp.linspace(0.0, T, 301)[:-1] + 1e-3
    marks = jnp.concatenate([jnp.array([0.0, T]), waveform.breakpoints()])
    ts = jnp.concatenate([t, t + 3 * T, t - 2 * T, marks - 1e-9, marks + 1e-9])
    now, later, before, left, right = jnp.split(
        evaluate(waveform, ts), np.cumsum([300, 300, 300, marks.size])
    )
    np.testing.assert_allclose(later, now, rtol=0, atol=1e-11)
    np.testing.assert_allclose(before, now, rtol=0, atol=1e-11)
    # continuous: a jump would not shrink with the distance; slopes stay below 1e5 a second
    np.testing.assert_allclose(left, right, rtol=0, atol=2e-4)


@pytest.mark.parametrize("waveform", PERIODIC.values(), ids=PERIODIC)
def test_waveform_derivative_matches_differences_away_from_breakpoints(waveform):
    t = jnp.array([0.031, 0.15, 0.23, 0.34, 0.61, 0.777])
    h = 1e-6
    difference = (evaluate(waveform, t + h) - evaluate(waveform, t - h)) / (2 * h)
    # truncation h² f''' and rounding 1e-16 · 110/h
    np.testing.assert_allclose(slopes(waveform, t), difference, rtol=1e-5, atol=1e-5)


def test_aortic_pressure_at_its_landmarks():
    assert float(AORTA(0.3 * T)) == pytest.approx(110.0, rel=1e-15)
    assert float(AORTA(0.0)) == pytest.approx(65.0, rel=1e-15)
    assert float(AORTA(jnp.nextafter(jnp.asarray(T), 0.0))) == pytest.approx(65.0, rel=1e-12)
    g = 0.35 / 0.3 - 1.0
    P_valve = 45.0 * np.exp(2.0 - 2.0 / (1.0 - g**2)) + 65.0
    assert float(AORTA(0.35 * T)) == pytest.approx(P_valve, rel=1e-14)
    # exponential decay: half way through diastole the geometric mean of its ends
    assert float(AORTA(0.675 * T)) == pytest.approx(np.sqrt(P_valve * 65.0), rel=1e-14)
    assert np.allclose(AORTA.breakpoints(), [0.28])


def test_ventricular_pressure_at_its_landmarks():
    peak = 0.5 * (0.0692 + 0.4) * T
    assert float(VENTRICLE(peak)) == pytest.approx(110.0, rel=1e-14)
    for t in (0.0, 0.0692 * T, 0.4 * T, 0.5, 0.7999):
        assert float(VENTRICLE(t)) == 0.0
    h = 0.5
    expected = 110.0 * np.exp(0.3 - 0.3 / (1 - h**2))
    assert float(VENTRICLE(peak + 0.25 * (0.4 - 0.0692) * T)) == pytest.approx(expected, rel=1e-13)
    assert np.allclose(VENTRICLE.breakpoints(), [0.0692 * T, 0.4 * T])


@pytest.mark.parametrize("k", [0.3, 2.0])
def test_bump_has_finite_derivatives_at_and_beyond_its_ends(k):
    g = jnp.array([-5.0, -1.0, -1.0 + 1e-16, 0.0, 1.0 - 1e-15, 1.0, 1.0 + 1e-15, 7.0])
    bump = lambda s: smooth_bump(s, k)  # noqa: E731
    for derivative in (bump, jax.grad(bump), jax.grad(jax.grad(bump))):
        values = np.asarray(jax.jit(jax.vmap(derivative))(g))
        assert np.all(np.isfinite(values))
        assert np.all(values[[0, 1, 5, 6, 7]] == 0.0)
    assert float(bump(0.0)) == 1.0


def test_pressures_have_finite_gradients_at_their_breakpoints():
    for waveform in (AORTA, VENTRICLE):
        for t in [0.0, T, *np.asarray(waveform.breakpoints())]:
            gradient = jax.grad(lambda w, t=t: w(t))(waveform)
            assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(gradient))


@pytest.mark.parametrize("waveform", [AORTA, VENTRICLE], ids=["aorta", "ventricle"])
def test_pressure_gradient_matches_central_differences(waveform, assert_gradient):
    weights = jnp.array([1.0, 0.3, -0.4, 0.7])
    times = jnp.array([0.1, 0.22, 0.263, 0.5])
    assert_gradient(lambda w: weights @ jax.vmap(w)(times), waveform)


def test_mean_of_a_waveform_is_exact():
    # composite Gauss with 40 graded panels a stretch, converged to rounding
    nodes, weights = np.polynomial.legendre.leggauss(20)
    for waveform in (AORTA, VENTRICLE, Pulse(3.0, 0.1, 0.3, T)):
        marks = np.sort(np.concatenate([[0.0, T], waveform.breakpoints()]))
        share = 0.5 * (1.0 - np.cos(np.pi * np.arange(41) / 40))
        edges = marks[:-1, None] + np.diff(marks)[:, None] * share
        half = 0.5 * np.diff(edges)[..., None]
        t = edges[:, :-1, None] + half * (1.0 + nodes)
        values = np.asarray(evaluate(waveform, jnp.asarray(t.reshape(-1)))).reshape(t.shape)
        expected = np.sum(half * weights * values) / T
        assert float(waveform_mean(waveform, T)) == pytest.approx(expected, rel=3e-13), waveform


def test_mean_of_many_samples_is_exact():
    t = np.linspace(0.0, T, 120, endpoint=False)
    wave = sampled(t, np.cos(2 * np.pi * t / T) ** 2, T)
    # the trapezoidal rule on the samples is the integral of their linear interpolation
    assert float(waveform_mean(wave, T)) == pytest.approx(0.5, rel=1e-13)


@pytest.mark.parametrize(("kind", "order"), [("linear", 2), ("cubic", 4)])
def test_sampled_beat_converges(kind, order):
    def beat(t):
        return np.exp(np.sin(2 * np.pi * t / T))

    t = np.linspace(-1.0, 2.0, 1003)
    errors = []
    for count in (20, 40, 80):
        # uneven samples, which start after zero
        s = np.linspace(0.0, 1.0, count, endpoint=False)
        ts = T * (0.02 + s + 0.05 * np.sin(2 * np.pi * s))
        values = evaluate(sampled(ts, beat(ts), T, kind=kind), jnp.asarray(t))
        errors.append(np.max(np.abs(np.asarray(values) - beat(t))))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > order - 0.4), (errors, rates)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_sampled_beat_passes_through_its_samples_and_has_a_gradient(kind, assert_gradient):
    ts, values = np.array([0.05, 0.2, 0.41, 0.7]), np.array([1.0, 3.0, -1.0, 0.5])
    wave = sampled(ts, values, T, kind=kind)
    np.testing.assert_allclose(jax.vmap(wave)(jnp.asarray(ts)), values, rtol=0, atol=1e-14)

    def probe(values):
        wave = sampled(jnp.asarray(ts), jnp.stack(values), T, kind=kind)
        return wave(0.3) + 0.5 * wave(0.78)

    assert_gradient(probe, [jnp.asarray(v) for v in values])


def test_cubic_beat_has_continuous_curvature():
    wave = PERIODIC["cubic"]
    curvature = jax.jit(jax.vmap(jax.grad(jax.grad(wave))))
    marks = wave.breakpoints()
    np.testing.assert_allclose(curvature(marks - 1e-9), curvature(marks + 1e-9), rtol=1e-5)


def test_closing_sample_is_dropped():
    closed = sampled([0.0, 0.3, T], [1.0, 2.0, 1.0], T)
    assert closed.times.shape == (2,)


@pytest.mark.parametrize(
    ("times", "values", "period", "message"),
    [
        ([0.0, 0.3, T], [1.0, 2.0, 1.5], T, "does not close"),
        ([0.0, 0.3], [1.0, np.nan], T, "not finite"),
        ([0.0, 0.3, 0.2], [1.0, 2.0, 1.0], T, "must ascend"),
        ([0.0, 0.9], [1.0, 2.0], T, "more than the period"),
        ([0.0], [1.0], T, "two or more"),
        ([0.0, 0.3], [1.0, 2.0, 3.0], T, "two or more"),
        ([0.0, 0.3], [1.0, 2.0], 0.0, "must be positive"),
        ([0.0, 0.3], [1.0, 2.0], float("nan"), "must be positive"),
    ],
)
def test_what_is_not_a_beat_is_refused(times, values, period, message):
    with pytest.raises(ValueError, match=message):
        sampled(times, values, period)


@pytest.mark.parametrize(
    "make",
    [
        lambda: AorticPressure(65.0, 110.0, T),
        lambda: AorticPressure(110.0, 110.0, T),
        lambda: AorticPressure(110.0, 0.0, T),
        lambda: AorticPressure(110.0, 65.0, 0.0),
        lambda: AorticPressure(float("inf"), 65.0, T),
        lambda: VentricularPressure(-1.0, T),
        lambda: Sinusoid(1.0, 1.0, -T),
        lambda: Sinusoid(float("nan"), 1.0, T),
        lambda: Constant(float("nan")),
    ],
)
def test_impossible_waveforms_are_refused(make):
    with pytest.raises(ValueError, match=r"P_|must be"):
        make()


def test_ramp_and_constant_follow_their_formulas():
    ramp = Ramp(start=2.0, slope=3.0, t_start=1.0)
    assert float(ramp(1.5)) == 3.5
    assert float(Constant(4.0)(7.0)) == 4.0


def test_numbers_of_any_kind_become_double_precision():
    wave = AorticPressure(np.float32(110.0), np.int64(65), jnp.asarray(1, dtype=jnp.int32))
    assert all(leaf.dtype == jnp.float64 for leaf in jax.tree.leaves(wave))


def test_waveform_batch_equals_loop():
    t = jnp.array([0.1, 0.3, 0.6])
    periods = jnp.array([0.5, 0.8])

    def values(period):
        return jax.vmap(AorticPressure(110.0, 65.0, period))(t)

    looped = jnp.stack([values(period) for period in periods])  # eager
    np.testing.assert_allclose(jax.jit(jax.vmap(values))(periods), looped, rtol=1e-14)


def test_a_stretched_waveform_is_the_other_one_in_longer_time():
    wave = sampled(np.array([0.0, 0.2, 0.5]), np.array([1.0, 3.0, 2.0]), T)
    longer = Stretched(wave, 1.5, gain=2.0, offset=0.5)
    for t in (0.0, 0.1, 0.45, 0.7):
        assert float(longer(1.5 * t)) == pytest.approx(2.0 * float(wave(t)) + 0.5)
    assert float(longer.repeats_after()) == pytest.approx(1.5 * T)
    np.testing.assert_allclose(longer.breakpoints(), 1.5 * wave.breakpoints())
    assert Stretched(Constant(1.0), 2.0).repeats_after() is None
    with pytest.raises(ValueError, match="factor"):
        Stretched(wave, -1.0)
