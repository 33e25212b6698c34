"""Directions in the wall: exact in a straight tube, along the arc of a bent one, in a slit."""

import dataclasses
import sys

import numpy as np
import pytest

from jaxfsi.fields import wall_frame
from jaxfsi.mesh import Region
from jaxfsi.mesh_parts import submesh
from jaxfsi.meshing import bent, ring, tube


def _tube(**options):
    return ring(
        radius=0.2, length=1.0, thickness=0.05, n_around=24, n_axial=16, n_layers=1, **options
    )


@pytest.mark.parametrize("columns", [True, False])
def test_straight_tube_has_its_own_axis_exactly(columns):
    mesh = _tube(columns=columns)
    frame = wall_frame(mesh)
    np.testing.assert_allclose(np.abs(frame.axis[2]), 1.0, atol=1e-12)
    np.testing.assert_allclose(frame.circumference[2], 0.0, atol=1e-12)
    centre = mesh.points[mesh.tets].mean(axis=1)[:, :2]
    out = centre / np.linalg.norm(centre, axis=1)[:, None]
    # Half of a facet of 15° and where in it a tetrahedron lies.
    assert np.min(np.abs(np.sum(frame.normal[:2].T * out, axis=1))) > np.cos(np.radians(15.0))


def test_slit_has_the_axis_of_its_tube():
    mesh = _tube(columns=True)
    mesh = dataclasses.replace(mesh, points=mesh.points * np.array([1.0, 0.25, 1.0]))
    np.testing.assert_allclose(np.abs(wall_frame(mesh).axis[2]), 1.0, atol=1e-12)


def test_axis_follows_a_bent_tube():
    bend = bent(bend_radius=1.0)
    straight, mesh = _tube(columns=True), _tube(columns=True, mapping=bend)
    centre = straight.points[straight.tets].mean(axis=1)
    step = np.array([0.0, 0.0, 1e-5])
    tangent = bend(centre + step) - bend(centre - step)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    cosine = np.abs(np.sum(wall_frame(mesh).axis.T * tangent, axis=1))
    # A patch spans a third of the arc's radius, 20°, and lies on one side of its triangle at the
    # tube's ends.
    assert np.min(cosine) > np.cos(np.radians(12.0))
    assert np.mean(cosine) > np.cos(np.radians(4.0))


def test_triangles_are_looked_at_in_parts_whose_memory_is_bounded(monkeypatch):
    mesh = _tube(columns=True, mapping=bent(bend_radius=1.0))
    whole = wall_frame(mesh)
    module, most = sys.modules[wall_frame.__module__], 20_000
    monkeypatch.setattr(module, "_MOST", most)
    sizes, eigh = [], np.linalg.eigh

    def seen(matrices):
        sizes.append(len(matrices))
        return eigh(matrices)

    monkeypatch.setattr(np.linalg, "eigh", seen)
    for one, other in zip(wall_frame(mesh), whole, strict=True):
        np.testing.assert_array_equal(one, other)
    # a part has nine numbers of at least 16 neighbours a triangle
    assert len(sizes) > 5
    assert max(sizes) * 9 * 16 <= most


def test_tets_of_a_wedge_share_directions():
    mesh = _tube(columns=True)
    frame = wall_frame(mesh)
    for field in frame:
        of_wedges = field[:, mesh.wedge_tets]
        np.testing.assert_array_equal(
            of_wedges, np.broadcast_to(of_wedges[:, :, :1], of_wedges.shape)
        )


def test_mesh_without_wall_has_no_directions():
    whole = tube(radius=0.2, length=0.4, thickness=0.05, n_around=12, n_axial=4)
    with pytest.raises(ValueError, match="directions need a wall round a lumen"):
        wall_frame(submesh(whole, Region.FLUID).mesh)
