"""What is predicted after a diagnosis."""

from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.diagnose import Diagnosis
from diagnosis.hypothesis import Fitted
from diagnosis.shrink import expected_waves

BASE, KNOWN = np.zeros((1, 3, 4)), np.ones((1, 3, 4))


def _diagnosis(verdict, probabilities, beside, measured=KNOWN):
    blank = Fitted(**dict.fromkeys(Fitted._fields))._replace(sound=np.array(True))
    fits = {(): blank._replace(waves=BASE), ("delay",): blank._replace(waves=KNOWN)}
    fields = dict.fromkeys(Diagnosis._fields)
    record = SimpleNamespace(
        waves=measured[:, :2], wave_sd=np.array([[0.1, np.inf]]), held_out=np.zeros(1)
    )
    judgement = SimpleNamespace(verdict=verdict, probabilities=probabilities)
    return Diagnosis(
        **fields | {"record": record, "judgement": judgement, "fits": fits, "beside": beside}
    )


@pytest.mark.parametrize(
    ("verdict", "probabilities", "beside", "share"),
    [
        ("named", {"none": 0.1, "delay": 0.8}, {(): 0.05, ("delay",): 0.05}, 0.85),
        ("unknown", {"none": 0.0, "delay": 0.0}, {(): 0.1, ("delay",): 0.9}, 0.9),
        ("unknown", {"none": 0.0, "delay": 0.3}, {(): 0.6, ("delay",): 0.1}, 0.0),
        ("no_gap", {"none": 0.7, "delay": 0.2}, {(): 0.05, ("delay",): 0.05}, 0.0),
    ],
)
def test_prediction_keeps_what_is_known_to_act(verdict, probabilities, beside, share):
    found = _diagnosis(verdict, probabilities, beside)
    np.testing.assert_allclose(expected_waves(found), share * KNOWN, rtol=1e-12)


def test_part_that_comes_no_nearer_to_the_traces_is_left_out():
    beside = {(): 0.0, ("delay",): 1.0}
    found = _diagnosis("unknown", {"none": 0.0, "delay": 0.0}, beside, measured=-KNOWN)
    np.testing.assert_array_equal(expected_waves(found), BASE)


def test_known_part_is_what_acts_beside_the_unknown_more_likely_than_not():
    assert _diagnosis("unknown", {}, {(): 0.1, ("delay",): 0.9}).known_part == ("delay",)
    assert _diagnosis("unknown", {}, {(): 0.6, ("delay",): 0.3}).known_part == ()
