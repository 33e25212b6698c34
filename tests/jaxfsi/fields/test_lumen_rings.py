"""Rings of a lumen: area and minor axis of an ellipse, moved, turned and differentiated."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.fields.lumen_rings import lumen_rings
from jaxfsi.fields.lumen_sections import Planes, lumen_at
from jaxfsi.meshing import ring

A, B = 0.3, 0.1
N = 24


@pytest.fixture(scope="module")
def mesh():
    return ring(
        radius=1.0, length=1.0, thickness=0.2, n_around=N, n_axial=4, n_layers=1,
        mapping=lambda x: x * np.array([A, B, 1.0]),
    )  # fmt: skip


def _planes(s, tilt=0.0):
    normal = np.array([0.0, np.sin(tilt), np.cos(tilt)])
    return Planes(s, np.outer(s, [0.0, 0.0, 1.0]), np.tile(normal, (len(s), 1)))


PLANES = _planes(np.array([0.3, 0.62]))


def test_ring_has_the_area_and_minor_axis_of_its_ellipse(mesh):
    size = lumen_rings(mesh, PLANES).size(jnp.asarray(mesh.points.T))
    # An inscribed polygon of 24 sides has 1.1 % less area; points between layers lie on chords.
    polygon = np.sin(2.0 * np.pi / N) / (2.0 * np.pi / N)
    assert np.asarray(size.area) == pytest.approx(np.pi * A * B * polygon, rel=0.02)
    assert np.asarray(size.minor) == pytest.approx(2.0 * B, rel=0.02)


def test_ring_agrees_with_the_plane_cut_of_a_moved_lumen(mesh):
    rings = lumen_rings(mesh, PLANES)
    x = mesh.points
    moved = np.stack([0.05 * x[:, 0] * x[:, 2], -0.2 * x[:, 1], 0.02 * x[:, 0]], axis=1)
    area, minor = lumen_at(mesh, PLANES, moved)
    size = rings.size(jnp.asarray((x + moved).T))
    # Points leave their plane by an angle of 0.02: second order in it.
    assert np.asarray(size.area) == pytest.approx(area, rel=2e-3)
    assert np.asarray(size.minor) == pytest.approx(minor, rel=2e-3)


def test_size_does_not_depend_on_where_the_vessel_is(mesh):
    rings = lumen_rings(mesh, PLANES)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )
    here = rings.size(jnp.asarray(mesh.points.T))
    there = rings.size(jnp.asarray(turn @ mesh.points.T + np.array([[3.0], [-1.0], [2.0]])))
    assert np.asarray(there.area) == pytest.approx(np.asarray(here.area), rel=1e-10)
    assert np.asarray(there.minor) == pytest.approx(np.asarray(here.minor), rel=1e-10)


def test_size_has_the_derivative_of_central_differences(mesh):
    rings = lumen_rings(mesh, PLANES)
    draw = np.random.default_rng(3)
    # Away from the ellipse, whose smallest width has several directions and so a kink.
    x = jnp.asarray(mesh.points.T + 0.01 * draw.standard_normal((3, len(mesh.points))))
    way = jnp.asarray(draw.standard_normal(x.shape)) * 0.01

    def both(t):
        size = rings.size(x + t * way)
        return jnp.concatenate([size.area, size.minor])

    slope = jax.jvp(both, (0.0,), (1.0,))[1]
    central = (both(1e-5) - both(-1e-5)) / 2e-5
    # Round-off of the differences is 1e-11 of the sizes over steps of 1e-5.
    assert np.asarray(slope) == pytest.approx(np.asarray(central), rel=1e-5, abs=1e-8)


def test_planes_beside_the_vessel_are_left_out(mesh):
    rings = lumen_rings(mesh, _planes(np.array([0.3, 5.0])))
    assert np.asarray(rings.s) == pytest.approx([0.3])
    with pytest.raises(ValueError, match="no plane"):
        lumen_rings(mesh, _planes(np.array([5.0])))
