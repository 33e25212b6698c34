"""Regions of a wall round two lumens."""

import numpy as np
import pytest

from jaxfsi.adjoint.lumen_shape import lumen_surface
from jaxfsi.fields.wall_regions import WallRegion, regions_beside
from jaxfsi.mesh import Region
from jaxfsi.meshing import ring


def test_a_wall_between_two_lumens_is_septum():
    """An annulus whose inside is called aorta and whose outside is the coronary's lumen."""
    mesh = ring(radius=0.5, length=0.4, thickness=0.1, n_around=24, n_axial=4, n_layers=2)
    surface = lumen_surface(mesh)
    # A second lumen: the same surface pushed out beyond the wall over a quarter of the circle.
    angle = np.arctan2(surface.points[:, 1], surface.points[:, 0])
    beside = np.abs(angle) < np.pi / 4.0
    outer = surface.points[beside] * np.array([1.2, 1.2, 1.0])
    number = np.cumsum(beside) - 1 + len(surface.points)
    triangles = number[surface.triangles[np.all(beside[surface.triangles], axis=1)]]
    both = surface._replace(
        points=np.concatenate([surface.points, outer]),
        triangles=np.concatenate([surface.triangles, triangles]),
    )
    of_coronary = np.arange(len(both.points)) >= len(surface.points)
    region = regions_beside(mesh, both, of_coronary, np.full(len(of_coronary), 0.1))
    middle = mesh.points[mesh.tets_of(Region.SOLID)].mean(axis=1)
    turn = np.abs(np.arctan2(middle[:, 1], middle[:, 0]))
    # The nearest of points a quarter of an edge apart stands askew for few that touch a lumen.
    assert np.mean(region[turn < np.pi / 5.0] == WallRegion.SEPTUM) > 0.95
    assert np.all(region[turn > np.pi / 3.0] == WallRegion.AORTA)
    # Walls half as thick do not meet.
    apart = regions_beside(mesh, both, of_coronary, np.full(len(of_coronary), 0.04))
    assert not np.any(apart == WallRegion.SEPTUM)
    assert {int(r) for r in apart} == {WallRegion.AORTA, WallRegion.CORONARY}


def test_one_lumen_has_no_regions():
    mesh = ring(radius=0.5, length=0.4, thickness=0.1, n_around=12, n_axial=2, n_layers=1)
    surface = lumen_surface(mesh)
    with pytest.raises(ValueError, match="two lumens"):
        regions_beside(mesh, surface, np.zeros(len(surface.nodes), bool), surface.area)
