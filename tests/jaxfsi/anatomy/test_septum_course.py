"""Where an artery is cut beside the aorta, and what is said where it cannot be."""

import numpy as np
import pytest

from jaxfsi.anatomy import AorticAxis, curve_through
from jaxfsi.anatomy.sources.septum_course import first_clear


@pytest.fixture(scope="module")
def aorta() -> AorticAxis:
    z = np.linspace(-4.0, 4.0, 81)
    axis = curve_through(np.stack([0.0 * z, 0.0 * z, z], axis=1), 0.1)
    return AorticAxis(axis, np.full(len(axis.s), 1.0))


def artery(slope: float, length: float = 3.0):
    """A line that leaves the lumen of the aorta at s = 0 and goes up along it."""
    t = np.linspace(0.0, length, 61)
    line = np.stack([1.0 + slope * t, 0.0 * t, np.sqrt(1.0 - slope**2) * t], axis=1)
    return curve_through(line, 0.05)


def test_an_artery_is_cut_where_it_is_clear_of_the_aorta(aorta):
    # 0.6 cm of clearance at a slope of 0.5; samples are 0.05 cm apart
    assert first_clear(aorta, artery(0.5), 0.4, 0.6) == pytest.approx(1.2, abs=0.051)
    assert first_clear(aorta, artery(0.5), 2.0, 0.6) == pytest.approx(2.0, abs=0.051)


def test_an_artery_along_the_aorta_is_told_from_a_line_that_is_too_short(aorta):
    with pytest.raises(ValueError, match=r"stays within 0\.6 cm of the aortic lumen"):
        first_clear(aorta, artery(0.1), 0.4, 0.6)
    with pytest.raises(ValueError, match=r"too short: it ends 3 cm.*cut 3\.5 cm.*longer centre"):
        first_clear(aorta, artery(0.5), 3.5, 0.6)
