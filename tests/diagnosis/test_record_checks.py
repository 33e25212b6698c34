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


def test_diagnosis_needs_effects_and_a_positive_prior_scale():
    batch = stacked([measured(_record())])
    for scale in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="positive scale"):
            diagnose(batch, prior_scale=scale)
    with pytest.raises(ValueError, match="at least one effect"):
        diagnose(batch, effects=())
