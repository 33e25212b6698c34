"""The section of the artery at a place: how far from the ostium, and what it kept."""

import types

import numpy as np
import pytest

from jaxfsi.anatomy.anatomy import Centerline
from jaxfsi.fields.lumen_sections import section_near
from jaxfsi.meshing import tube
from jaxfsi.opening import ANOMALOUS


@pytest.fixture(scope="module")
def vessel():
    """A tube of 2 cm whose axis begins at its inlet, and its mesh."""
    mesh = tube(radius=0.2, length=2.0, thickness=0.05, n_around=12, n_axial=10, n_layers=1)
    z = np.linspace(0.0, 2.0, 101)
    line = Centerline(np.stack([0.0 * z, 0.0 * z, z], axis=1), z)
    return mesh, types.SimpleNamespace(centerlines={ANOMALOUS: line})


def test_section_is_told_by_its_distance_and_the_share_of_its_area(vessel):
    mesh, anatomy = vessel
    flat = mesh.points * np.array([0.0, -0.7, 0.0])
    s, share = section_near(mesh, anatomy, np.array([0.05, 0.0, 0.83]), flat)
    # to the nearest point of the axis
    assert s == pytest.approx(0.83, abs=0.011)
    assert share == pytest.approx(0.3, rel=1e-9)


def test_place_outside_of_the_artery_has_no_section(vessel):
    mesh, anatomy = vessel
    still = np.zeros_like(mesh.points)
    for place in ([1.5, 0.0, 0.8], [0.0, 0.0, -0.4], [0.0, 0.0, 2.3]):
        assert section_near(mesh, anatomy, np.array(place), still) is None
    without = types.SimpleNamespace(centerlines={})
    assert section_near(mesh, without, np.array([0.0, 0.0, 0.8]), still) is None
