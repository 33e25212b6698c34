"""The colour of the noise, learnt where one beat a trace was recorded."""

import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis import measured, stacked
from diagnosis.colour import (
    CORRELATION_TIMES,
    FIRST,
    autoregressive_power,
    coloured,
    with_power,
)
from diagnosis.measured import noise_power, weights
from diagnosis.resolution import HARMONICS
from tests.diagnosis.records import synthetic

SD, N, PERIOD = 0.5, 100, 0.8


@pytest.mark.parametrize("time", [0.0, 0.006, 0.022])
def test_power_is_that_of_drawn_noise(time):
    rng = np.random.default_rng(1)
    rho = np.exp(-PERIOD / (N * time)) if time else 0.0
    wave = np.zeros((4000, 8 * N))
    wave[:, 0] = rng.normal(0.0, SD, 4000)
    for k in range(1, wave.shape[1]):
        wave[:, k] = rho * wave[:, k - 1] + rng.normal(0.0, SD * np.sqrt(1.0 - rho**2), 4000)
    seen = np.abs(np.fft.rfft(wave[:, -N:], axis=1)[:, : HARMONICS + 1] / N) ** 2
    power = autoregressive_power(jnp.asarray(SD), jnp.asarray(float(N)), jnp.asarray(PERIOD), time)
    # 4000 draws: 1.6 % a harmonic; a beat of noise that does not repeat leaks a few per cent
    np.testing.assert_allclose(seen.mean(axis=0)[5:], power[5:], rtol=0.12)


def with_noise(power_of):
    """A record whose residuals are noise of some power, and these whitened by the default."""
    record = with_power(stacked([measured(synthetic({}))]))
    shape = record.wave_sd.shape
    n = np.asarray(record.wave_samples)
    found = np.zeros((1, *np.asarray(weights(measured(synthetic({})))).shape))
    rng = np.random.default_rng(2)
    count = 2 * HARMONICS + 1
    for c in range(shape[1]):
        for s in range(shape[2]):
            if not np.isfinite(record.wave_sd[0, c, s]):
                continue
            sd, period = record.wave_sd[0, c, s], record.period[0, c]
            default = np.asarray(noise_power(sd, n[0, c, s], record.white_share[0]))
            ratio = np.asarray(power_of(sd, jnp.asarray(n[0, c, s]), period, default)) / default
            scale = np.sqrt(np.concatenate([ratio, ratio[1:]]))
            draw = rng.normal(size=count) * np.where(np.isfinite(scale), scale, 0.0)
            found[0, c, s * count : (s + 1) * count] = draw
    return record, found


@pytest.mark.parametrize("time", [0.0, 0.006, 0.015])
def test_colour_is_found_from_the_upper_harmonics(time):
    record, residual = with_noise(lambda sd, n, T, _: autoregressive_power(sd, n, T, time))
    power = np.asarray(coloured(record, jnp.asarray(residual)).wave_power)[0, 0, 0]
    sd, n, T = (
        x[0, 0] for x in (record.wave_sd[..., 0], record.wave_samples[..., 0], record.period)
    )
    nearby = [t for t in CORRELATION_TIMES if abs(t - time) <= 0.005]
    bounds = np.array([autoregressive_power(sd, n, T, t) for t in nearby])
    seen = slice(1, 30)
    assert np.all(power[seen] > 0.8 * bounds.min(axis=0)[seen])
    assert np.all(power[seen] < 1.25 * bounds.max(axis=0)[seen])


def test_default_noise_keeps_its_spectrum():
    record, residual = with_noise(lambda sd, n, T, default: default)
    power = np.asarray(coloured(record, jnp.asarray(residual)).wave_power)[0, 0, 0]
    sd, n = record.wave_sd[0, 0, 0], record.wave_samples[0, 0, 0]
    default = np.asarray(noise_power(sd, n, record.white_share[0]))
    np.testing.assert_allclose(power[1:30], default[1:30], rtol=0.1)


def test_what_an_effect_does_to_one_sensor_is_no_colour():
    """A residual of the distal traces that falls along the harmonics is that of reddish noise."""
    record, residual = with_noise(lambda sd, n, T, default: default)
    count = 2 * HARMONICS + 1
    k = np.arange(HARMONICS + 1)
    raised = np.where(k >= FIRST, 1.0 + 2.0 * np.exp(-(k - FIRST) / 8.0), 1.0)
    residual[:, :, count : 2 * count] *= np.concatenate([raised, raised[1:]])
    power = np.asarray(coloured(record, jnp.asarray(residual)).wave_power)[0, 0, 0]
    sd, n = record.wave_sd[0, 0, 0], record.wave_samples[0, 0, 0]
    default = np.asarray(noise_power(sd, n, record.white_share[0]))
    assert np.all(power[1:30] > 0.9 * default[1:30])
    np.testing.assert_allclose(power[FIRST:30], default[FIRST:30], rtol=0.1)
