"""What is predicted after a diagnosis."""

from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.fit import Fitted
from diagnosis.result import Diagnosis
from diagnosis.shrink import WORSE_BY, expected_waves, heeding_held_out, held_out_gap
from diagnosis.verdict import Judgement

BASE, KNOWN = np.zeros((1, 3, 4)), np.ones((1, 3, 4))


def _diagnosis(verdict, probabilities, beside, measured=KNOWN, held_out=0.0):
    blank = Fitted(**dict.fromkeys(Fitted._fields))._replace(sound=np.array(True))
    fits = {(): blank._replace(waves=BASE), ("delay",): blank._replace(waves=KNOWN)}
    fields = dict.fromkeys(Diagnosis._fields)
    record = SimpleNamespace(
        waves=measured[:, :2],
        wave_sd=np.array([[0.1, 0.1 if held_out else np.inf]]),
        wave_offset_sd=np.zeros((1, 2)),
        held_out=np.full(1, held_out),
        n_sensors=2,
    )
    judgement = Judgement(verdict, ("delay",), probabilities, {}, (), ("delay",), closed=True)
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


@pytest.mark.parametrize(
    ("verdict", "measured", "after"),
    [
        ("named", 2.0 * WORSE_BY * KNOWN, "named"),
        ("named", -2.0 * WORSE_BY * KNOWN, "unknown"),
        ("ambiguous", -2.0 * WORSE_BY * KNOWN, "ambiguous"),
        ("unknown", -2.0 * WORSE_BY * KNOWN, "unknown"),
        ("no_gap", -2.0 * WORSE_BY * KNOWN, "no_gap"),
    ],
)
def test_nothing_is_named_that_misses_what_was_held_out(verdict, measured, after):
    probabilities = {"none": 0.0, "delay": 1.0}
    found = _diagnosis(verdict, probabilities, {("delay",): 0.9}, measured, held_out=1.0)
    aorta = np.array([[[1e5], [0.0], [0.0]]])
    waves = {h: f._replace(waves=aorta + 2.0 * WORSE_BY * f.waves) for h, f in found.fits.items()}
    heeded = heeding_held_out(found._replace(fits=waves))
    assert heeded.judgement.verdict == after
    (held,) = held_out_gap(heeded)
    assert held.P_distal_rms.after <= held.P_distal_rms.before
