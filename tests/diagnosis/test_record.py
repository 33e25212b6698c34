import numpy as np
import pytest

from diagnosis import noise_of
from diagnosis.record import TRANSDUCER_SD
from lumped import MMHG
from tests.diagnosis.records import synthetic


def test_noise_is_estimated_from_the_scatter_of_beats():
    noise = noise_of(synthetic({}, beats=12, sd=0.5))
    assert noise.origin == "estimated"
    # the beats' own means count as offset and take 4 % of the sd with them
    assert noise.pressure_sd == pytest.approx(np.hypot(0.5 * MMHG, TRANSDUCER_SD), rel=0.1)
    assert 0.4 < noise.white_share < 0.65
