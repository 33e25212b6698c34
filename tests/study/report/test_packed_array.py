"""Arrays inside a page: no value is off by more than half a quantum."""

import numpy as np
import pytest

from study.report.packed_array import pack, unpacked
from study.store.json_form import as_json


@pytest.mark.parametrize("quantum", [1e-6, 0.02, 3.0])
@pytest.mark.parametrize("shape", [(7,), (5, 40), (6, 11, 3)])
def test_round_trip_is_within_half_a_quantum(shape, quantum):
    rng = np.random.default_rng(3)
    values = 80.0 + 25.0 * np.cumsum(rng.normal(size=shape), axis=0)
    packed = pack(values, quantum)
    again = unpacked(as_json(packed))
    assert again.shape == shape
    # and rounding of numbers of this size
    assert np.abs(again - values).max() <= 0.5 * quantum * (1.0 + 1e-9) + 1e-12


def test_whole_numbers_return_as_they_were():
    values = np.array([[0, 70000, 3], [1, 2, 16_777_215]])
    packed = pack(values, 1.0)
    assert packed.width == 4
    assert np.array_equal(unpacked(packed), values)


def test_one_value_takes_one_byte_a_number():
    packed = pack(np.full(1000, 93.25), 0.02)
    assert packed.width == 1
    assert np.all(unpacked(packed) == 93.25)


def test_what_hardly_changes_in_time_takes_less_room():
    still = np.tile(np.random.default_rng(1).uniform(60.0, 120.0, 500), (40, 1))
    moving = still + np.random.default_rng(2).normal(size=still.shape)
    assert 10 * len(pack(still, 0.02).data) < len(pack(moving, 0.02).data)


@pytest.mark.parametrize(("values", "quantum"), [([1.0, np.nan], 0.1), ([0.0, 1e9], 1e-3)])
def test_numbers_that_cannot_be_kept_are_refused(values, quantum):
    with pytest.raises(ValueError, match=r"cannot be kept in steps of .* larger step"):
        pack(np.array(values), quantum)
