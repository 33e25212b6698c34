import numpy as np
import pytest

from diagnosis import Record, RecordedCondition, measured, noise_of
from diagnosis.measured import noise_correlation
from diagnosis.resolution import SAMPLES
from lumped import MMHG
from tests.diagnosis.records import synthetic

PLAIN = {"drug": "none", "held_out": False, "period": 0.8, "P_systolic": 1.5e5, "P_diastolic": 9e4}


def test_noise_is_estimated_from_the_scatter_of_beats():
    noise = noise_of(synthetic({}, beats=12, sd=0.5))
    assert noise.origin == "estimated"
    # the beats' own means count as offset and take 4 % of the sd with them
    assert noise.pressure_sd == pytest.approx(0.5 * MMHG, rel=0.1)
    assert 0.4 < noise.white_share < 0.65


def test_white_share_pools_conditions_of_unlike_samples_whatever_their_order():
    rng, white, beats = np.random.default_rng(3), 0.4, 400
    conditions, lagged, if_smooth = [], 0.0, 0.0
    for order, n in enumerate((41, 17)):
        at = np.round(SAMPLES * np.arange(n) / n).astype(int)
        K = white * np.eye(n) + (1.0 - white) * noise_correlation()[np.abs(at[:, None] - at[None])]
        noise = rng.standard_normal((beats, n)) @ np.linalg.cholesky(K).T
        wave = {"P_aorta": MMHG * (90.0 + noise)}
        conditions.append(RecordedCondition(f"c{n}", order=order, beats=wave, **PLAIN))
        left = K - K.mean(axis=0) - K.mean(axis=1)[:, None] + K.mean()  # less the beats' means
        lagged += np.trace(np.roll(left, -1, axis=1))
        if_smooth += np.trace(left) * noise_correlation()[round(SAMPLES / n)]
    found = noise_of(Record("a", tuple(conditions))).white_share
    # 23 000 draws: 1 %
    assert found == pytest.approx(1.0 - lagged / if_smooth, abs=0.02)
    assert noise_of(Record("a", tuple(conditions[::-1]))).white_share == pytest.approx(found)


def test_a_mean_beside_its_own_trace_is_not_used_twice():
    wave = np.full((1, 32), 95.0 * MMHG)
    means = {"mean_P_aorta": 95.0 * MMHG, "mean_P_distal": 80.0 * MMHG}
    condition = RecordedCondition("rest", order=0, beats={"P_aorta": wave}, **means, **PLAIN)
    one = measured(Record("a", (condition,)))
    assert np.isfinite(one.wave_sd[0]).tolist() == [True, False]
    assert np.isfinite(one.scalar_sd[0]).tolist() == [False, True, False, False]
    bare = measured(Record("a", (condition,)), "means")
    assert np.isfinite(bare.scalar_sd[0]).tolist() == [True, True, False, False]
