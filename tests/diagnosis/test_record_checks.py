import math

import numpy as np
import pytest

from diagnosis import (
    Folding,
    Record,
    RecordedCondition,
    diagnose,
    measured,
    stacked,
)
from lumped import MMHG

GOOD = {"period": 0.8, "P_systolic": 110.0 * MMHG, "P_diastolic": 65.0 * MMHG, "ffr": 0.9}

BEATS = MMHG * (90.0 + np.random.default_rng(0).standard_normal((4, 32)))


def _record(noise=None, **changes):
    condition = RecordedCondition("rest", "none", 0, False, **{**GOOD, **changes})
    return Record("a", (condition,), **(noise or {}))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"period": -0.8}, "period"),
        ({"P_systolic": 60.0 * MMHG}, r"60 mmHg\) lies below"),
        ({"P_systolic": 110.0, "P_diastolic": 65.0}, "multiply those in mmHg by lumped.MMHG"),
        ({"P_diastolic": math.nan}, "P_diastolic"),
        ({"ffr": -0.9}, "ffr"),
        ({"mean_P_distal": 0.0}, "mean_P_distal"),
        ({"mean_Q": math.inf}, "mean_Q"),
        ({"beats": {"P_aorta": np.full((2, 32), math.nan)}}, "not finite"),
        ({"beats": {"P_aorta": np.zeros((0, 32))}}, "beats × samples"),
        ({"beats": {"P_aorta": np.ones((4, 1))}}, "one sample a beat"),
        ({"beats": {"P_aorta": BEATS, "P_dist": BEATS}}, "'P_dist' are of no sensor.*P_distal"),
        ({"beats": {"P_distal": BEATS}}, "several beats of P_distal without P_aorta"),
        ({"beats": {"P_aorta": BEATS, "P_distal": BEATS[:, ::2]}}, r"differ.*P_distal \(4, 16\)"),
        ({"beats": {"P_aorta": BEATS, "P_distal": BEATS[:3]}}, r"differ.*P_distal \(3, 32\)"),
        ({"folding": Folding(0.0, 0.01)}, "folding.samples"),
        ({"folding": Folding(30.0, math.nan)}, "folding.start_sd"),
    ],
)
def test_condition_with_numbers_that_cannot_be_is_refused(changes, words):
    with pytest.raises(ValueError, match=f"condition 'rest'.*{words}"):
        measured(_record(**changes))


@pytest.mark.parametrize("name", ["pressure_sd", "flow_relative_sd", "ffr_sd", "R0", "K", "L"])
def test_record_with_noise_or_losses_that_cannot_be_is_refused(name):
    for value in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=f"record: {name} = .*must be finite"):
            measured(_record({name: value}))


def test_all_faults_of_a_record_are_told_at_once_and_a_good_one_has_none():
    with pytest.raises(ValueError, match=r"R0 = -1.*period = 0.*ffr = nan"):
        measured(_record({"R0": -1.0}, period=0.0, ffr=math.nan))
    assert measured(_record({"K": 0.0})).scalars[0, 2] == 0.9
    assert measured(_record(P_systolic=8e4, P_diastolic=8e4)).n_conditions == 1


def test_conditions_with_waveforms_have_an_order_of_acquisition_each():
    wave = {"P_aorta": BEATS[:1], "P_distal": BEATS[1:2]}

    def pair(beats, *orders):
        conditions = [
            RecordedCondition(f"c{k}", "none", order, False, **GOOD, beats=beats)
            for k, order in enumerate(orders)
        ]
        return Record("a", tuple(conditions))

    with pytest.raises(ValueError, match=r"record: the conditions have the orders 0, 2, 0"):
        measured(pair(wave, 0, 2, 0))
    assert measured(pair(wave, 2, 0, 1)).n_conditions == 3
    # of means no waveform is looked up: the same order says that nothing drifted in between
    assert measured(pair({}, 0, 0)).n_conditions == 2


def test_single_beats_may_differ_in_their_samples_and_stand_alone():
    wave = {"P_aorta": BEATS[:1], "P_distal": BEATS[:1, ::2]}
    assert measured(_record(beats=wave)).n_sensors == 2
    assert measured(_record(beats={"P_distal": BEATS[:1]})).n_sensors == 2


def test_diagnosis_needs_effects_and_a_positive_prior_scale():
    batch = stacked([measured(_record())])
    for scale in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="positive scale"):
            diagnose(batch, prior_scale=scale)
    with pytest.raises(ValueError, match="at least one effect"):
        diagnose(batch, effects=())
