import numpy as np
import pytest

from diagnosis.steadiness import WORDS, steadiness, unlike
from lumped import MMHG

RNG = np.random.default_rng(5)
PULSE = np.sin(np.pi * np.clip(np.arange(64) / 24.0, 0.0, 1.0)) ** 2
BEATS = 9


def conditions(change=lambda k, c: 0.0, drop=lambda k, c: 8.0, count=BEATS):
    """Four conditions: a pulse of 40 mmHg times 1 + change, breathing, and a noise of 0.5 mmHg."""
    found = []
    for c in range(4):
        k = np.arange(count)
        breath = 3.0 * np.sin(2.0 * np.pi * (0.23 * k + 0.3 * c))
        pulse = 40.0 * (1.0 + 0.25 * breath / 40.0 + np.array([change(i, c) for i in k]))
        P_aorta = 75.0 + breath[:, None] + pulse[:, None] * PULSE
        P_distal = P_aorta * (1.0 + 0.1 * breath[:, None] / 80.0)
        P_distal = P_distal - np.array([drop(i, c) for i in k])[:, None]
        noise = 0.5 * RNG.normal(size=(2, *P_aorta.shape))
        found.append(
            {"P_aorta": (P_aorta + noise[0]) * MMHG, "P_distal": (P_distal + noise[1]) * MMHG}
        )
    return found


IRREGULAR = np.random.default_rng(3).normal(size=(4, BEATS))

UNLIKE = {
    (): conditions(),
    ("alternating",): conditions(lambda k, c: 0.08 * (-1.0) ** k),
    ("irregular",): conditions(lambda k, c: 0.2 * IRREGULAR[c, k]),
    ("wandering",): conditions(drop=lambda k, c: 8.0 - 2.0 * (1.0 - np.cos(0.8 * k + c))),
    ("alternating", "wandering"): conditions(
        lambda k, c: 0.08 * (-1.0) ** (k + c), lambda k, c: 8.0 + 0.4 * k
    ),
}


@pytest.mark.parametrize("ways", UNLIKE, ids="+".join)
def test_ways_in_which_beats_differ_are_found_and_breathing_is_none(ways):
    assert unlike(np.array(steadiness(UNLIKE[ways]))) == ways
    assert set(ways) <= set(WORDS)


def test_numbers_are_those_of_the_beats():
    found = steadiness(conditions(lambda k, c: 0.08 * (-1.0) ** k, lambda k, c: 8.0 + 0.5 * k))
    assert found.alternating == pytest.approx(0.08, rel=0.1)
    trend = 0.5 * np.std(np.arange(BEATS)) * np.sqrt(BEATS / (BEATS - 2)) * MMHG
    # breathing is correlated with a trend of nine beats and takes a part of it
    assert found.wandering == pytest.approx(trend, rel=0.15)


def test_one_beat_and_a_trace_that_may_not_be_used_tell_nothing():
    assert tuple(steadiness(conditions(count=3))) == (0.0, 0.0, 0.0)
    wandering = UNLIKE["wandering",]
    aorta_alone = [{"P_aorta": beats["P_aorta"]} for beats in wandering]
    assert unlike(np.array(steadiness(aorta_alone))) == ()
