"""Meshes of verification problems fill the shapes that they stand for."""

import numpy as np
import pytest

from jaxfsi.mesh import INTERFACE, tet_volumes
from jaxfsi.verification import channel_cylinder, nozzle


@pytest.mark.parametrize("n", [2, 3])
def test_nozzle_has_the_volume_of_tubes_cone_and_throat(n):
    mesh = nozzle.nozzle_mesh(n)
    volume = tet_volumes(mesh.points, mesh.tets)
    assert np.all(volume > 0.0)
    wide, narrow = nozzle.WIDE, nozzle.NARROW
    tubes = (nozzle.CONE - nozzle.INLET + nozzle.OUTLET) * wide**2 - nozzle.THROAT * narrow**2
    cone = (nozzle.THROAT - nozzle.CONE) * (wide**2 + wide * narrow + narrow**2) / 3.0
    # The polygons have the circles' areas.
    assert np.sum(volume) == pytest.approx(np.pi * (tubes + cone), rel=1e-9)


def test_channel_goes_round_the_cylinder():
    n = 3
    mesh = channel_cylinder.channel_mesh(n)
    volume = tet_volumes(mesh.points, mesh.tets)
    assert np.all(volume > 0.0)
    height, radius = channel_cylinder.HEIGHT, 0.5 * channel_cylinder.DIAMETER
    polygon = 4 * n * np.sin(2.0 * np.pi / (8 * n)) * radius**2
    exact = height * (channel_cylinder.LENGTH * height - polygon)
    assert np.sum(volume) == pytest.approx(exact, rel=1e-9)
    wall = mesh.points[np.unique(mesh.labelled(INTERFACE))]
    away = np.hypot(*(wall[:, :2] - channel_cylinder.CENTRE).T)
    assert np.min(away) == pytest.approx(radius)
