import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.blind.clocked import Clock
from diagnosis import measured
from diagnosis.measured import data_of, weights, whitener_of
from diagnosis.record import TRANSDUCER_SD
from diagnosis.scatter import folded_noise
from diagnosis.spectra import FROM_SAMPLES
from lumped import MMHG
from study.case.beat_folding import Folded
from tests.diagnosis.records import clocked, synthetic

CLOCKS = (
    Clock(60.0, 8, 0.03),
    Clock(97.0, 3, 0.01),
    Clock(97.0, 8, 0.0, "stretched", anywhere=True),
    Clock(97.0, 60, 0.04, "stretched"),
    Clock(97.0, 20, 0.02, breath=1.5),
    Clock(128.0, 8, 0.04, memory=0.03),
    Clock(128.0, 5, 0.03, anywhere=True, uneven=0.15),
    Clock(250.0, 12, 0.02, anywhere=True, breath=1.5),
)


def excess(record, waves):
    """χ² of the whitened difference from the true traces, the data, and the largest of them."""
    one = measured(record)
    true = (waves[:, :2] @ FROM_SAMPLES.T).reshape(4, -1)
    true = np.concatenate([true, np.asarray(data_of(one))[:, -4:]], axis=1)
    z = np.asarray(whitener_of(one)(data_of(one) - jnp.asarray(true)))
    seen = np.asarray(weights(one))[:, :-4] > 0.0
    return float((z**2).sum()), int(seen.sum()), float(np.abs(z).max())


def test_an_error_that_all_beats_share_is_no_part_of_exact_equations():
    """Only guessed equations allow for what the scatter of beats cannot show."""
    estimated = measured(clocked({}, Clock(97.0, 60, 0.02), seed=7)[0])
    assert float(estimated.instrument_sd) == pytest.approx(TRANSDUCER_SD)
    assert float(measured(synthetic({})).instrument_sd) == 0.0  # its noise is stated


@pytest.mark.parametrize("clock", CLOCKS, ids=[str(k) for k in range(len(CLOCKS))])
def test_the_mean_of_folded_beats_is_the_true_beat_within_its_noise(clock):
    record, waves = clocked({}, clock, seed=7)
    found, n, largest = excess(record, waves)
    # one record in ten thousand by chance; known from few beats, noise may be a fifth larger
    assert found < 1.44 * chi2.isf(1e-4, n)
    assert found > 0.5 * n
    assert largest < 6.0


def test_beats_cut_by_index_are_not_the_true_beat():
    """What a clock that does not divide the beat does to a fold by index."""

    def by_index(t, traces, period, fewest):
        count = round(t.size * (t[1] - t[0]) / period)
        n = t.size // count
        beats = {name: wave[: n * count].reshape(count, n) for name, wave in traces.items()}
        return Folded(beats, period, None)

    record, waves = clocked({}, Clock(97.0, 8, 0.0), seed=7, read=by_index)
    found, n, _ = excess(record, waves)
    assert found > 3.0 * n


def test_whitening_matches_the_dense_covariance():
    rng = np.random.default_rng(2)
    one = measured(synthetic({}))
    modes = 0.3 * rng.standard_normal((4, weights(one).shape[1], 3))
    joined = dataclasses.replace(one, modes=jnp.asarray(modes))
    W = whitener_of(joined)
    columns = np.asarray(W.columns(jnp.asarray(np.stack([np.eye(modes.shape[1])] * 4))))
    w = np.asarray(weights(one))
    for c in range(4):
        seen = w[c] > 0.0
        scaled = (w[c][:, None] * modes[c])[seen]
        z = columns[c][np.ix_(seen, seen)] / w[c][seen][None, :]
        covariance = np.eye(seen.sum()) + scaled @ scaled.T
        # round-off of a few hundred numbers
        assert np.abs(z @ covariance @ z.T - np.eye(seen.sum())).max() < 1e-10
    y = jnp.asarray(rng.standard_normal(w.shape))
    assert np.allclose(W(y), W.columns(y[..., None])[..., 0], rtol=1e-12, atol=1e-12)


def test_what_all_sensors_share_is_not_counted_as_their_own_noise():
    """A level that both pressures have leaves their difference as sharp as it was."""
    rng = np.random.default_rng(4)
    n, b = 55, 40
    wave = MMHG * (80.0 + 20.0 * np.sin(2.0 * np.pi * np.arange(256) / 256))
    level = 3.0 * MMHG * rng.standard_normal((b, 1))
    beats = {
        name: wave[np.arange(n) * 256 // n] + level + 0.5 * MMHG * rng.standard_normal((b, n))
        for name in ("P_aorta", "P_distal")
    }
    power = {name: np.full(41, (0.5 * MMHG) ** 2 / n / b) for name in beats}
    found = folded_noise(
        beats, dict.fromkeys(beats, wave), power, np.zeros(41), 0.01, estimate=True
    )
    U = found.modes
    means = U[:, 0]
    shared = means[0] @ means[1] / np.sqrt((means[0] @ means[0]) * (means[1] @ means[1]))
    assert shared > 0.95
    assert np.sqrt(means[0] @ means[0]) == pytest.approx(3.0 * MMHG / np.sqrt(b), rel=0.35)
    # white noise of 0.5 a sample: a fifth for its being estimated from forty beats
    assert np.sqrt(found.power[0, 3:25].mean() * n * b) == pytest.approx(0.5 * MMHG, rel=0.1)


def pulse(phase):
    """A beat with an upstroke [mmHg]."""
    return 80.0 + 30.0 * np.exp(-0.5 * ((phase - 0.4) / 0.07) ** 2)


def beats_of(n, b, added, sd=0.5):
    """Beats of both pressures: one wave, what is added to the beats of each, and white noise."""
    rng = np.random.default_rng(4)
    wave = MMHG * pulse(np.arange(256) / 256)
    beats = {
        name: MMHG * (pulse(np.arange(n) / n) + more + sd * rng.standard_normal((b, n)))
        for name, more in zip(("P_aorta", "P_distal"), added, strict=True)
    }
    power = {name: np.full(41, (sd * MMHG) ** 2 / n / b) for name in beats}
    return beats, dict.fromkeys(beats, wave), power


def test_breathing_is_no_noise_of_the_low_harmonics():
    """A baseline that both pressures share moves within the beats as well."""
    n, b = 55, 8
    t = np.arange(n * b).reshape(b, n) / n
    breath = 3.0 * np.sin(2.0 * np.pi * t / 3.4)
    given = beats_of(n, b, (breath, breath))
    found = folded_noise(*given, np.zeros(41), 0.0, estimate=True)
    white = (0.5 * MMHG) ** 2 / n / b
    # from seven degrees of freedom and two sensors
    np.testing.assert_allclose(found.power[:, :4] / white, 1.0, atol=0.6)
    drop = found.modes[0] - found.modes[1]
    assert np.sqrt(drop[0] @ drop[0]) < 0.5 * np.sqrt(found.modes[0, 0] @ found.modes[0, 0])


def test_beats_that_are_alike_are_known_to_be():
    n, b = 55, 5
    late = 0.006 * np.array([1.0, -1.0, 0.5, -0.5, 0.0])[:, None]
    phase = np.arange(n) / n
    moved = pulse(phase - late) - pulse(phase)
    size = {}
    for name, added in {"alike": 0.0, "varied": moved}.items():
        found = folded_noise(*beats_of(n, b, (added, added)), None, 0.0, estimate=True)
        size[name] = np.linalg.norm(found.modes[0, 4:15])  # breathing has none of these harmonics
    # 0.5 mmHg a sample tells the time of a beat to 0.0005
    assert size["alike"] < 0.25 * size["varied"]


def test_stated_noise_has_the_colour_of_the_scatter_and_its_own_size():
    n, b = 55, 12
    beats, waves, stated = beats_of(n, b, (0.0, 0.0))
    smooth = np.exp(-0.5 * np.arange(41.0))  # as if all noise were in the lowest harmonics
    total = stated["P_aorta"][0] + 2.0 * stated["P_aorta"][1:28].sum()
    told = {k: 2.0 * total * smooth / (2.0 * smooth[:28].sum() - 1.0) for k in stated}
    found = folded_noise(beats, waves, told, None, 0.0, estimate=False).power[:, :28]
    np.testing.assert_allclose(found[:, 0] + 2.0 * found[:, 1:].sum(axis=1), 2.0 * total, rtol=0.01)
    assert found[:, 20:].mean() == pytest.approx(found[:, 1:8].mean(), rel=0.4)
