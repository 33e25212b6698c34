"""Shapes of the lumen on a straight tube, whose derivatives are known in closed form."""

import numpy as np
import pytest

from jaxfsi import OUTER_WALL, Region, tet_volumes
from jaxfsi.adjoint.lumen_shape import (
    density,
    lumen_spread,
    lumen_surface,
    surface_stiffness,
    thickness_field,
    vessel_nodes,
)
from jaxfsi.meshing import tube

RADIUS, LENGTH, THICKNESS = 0.5, 2.0, 0.1


@pytest.fixture(scope="module")
def mesh():
    return tube(
        radius=RADIUS, length=LENGTH, thickness=THICKNESS, n_around=24, n_axial=16, n_layers=2
    )


@pytest.fixture(scope="module")
def surface(mesh):
    return lumen_surface(mesh)


def _volume_gradient(mesh):
    """Derivative of the volume of the blood by all nodes."""
    tets, G = mesh.tets_of(Region.FLUID), np.zeros_like(mesh.points)
    a, b, c, d = (mesh.points[tets[:, i]] for i in range(4))
    parts = (np.cross(b - d, c - d), np.cross(c - d, a - d), np.cross(a - d, b - d))
    own = [-p / 6.0 for p in parts]  # det(a − d, b − d, c − d) is minus six volumes
    for i, part in enumerate([*own, -sum(own)]):
        np.add.at(G, tets[:, i], part)
    return G


def test_surface_has_the_area_and_the_normals_of_the_tube(surface):
    inside = np.abs(surface.points[:, 2] - LENGTH / 2.0) < 0.9
    radial = surface.points[:, :2] / np.linalg.norm(surface.points[:, :2], axis=1)[:, None]
    # chords of 24 sides: area (24/π) sin(π/24), 0.3 % below that of the circle
    assert surface.area.sum() == pytest.approx(2.0 * np.pi * RADIUS * LENGTH, rel=5e-3)
    np.testing.assert_allclose(surface.normal[inside, :2], radial[inside], atol=0.03)


def test_gathered_is_the_transpose_of_the_field(mesh, surface):
    rng = np.random.default_rng(0)
    spread = lumen_spread(mesh, surface)
    shift, G = rng.standard_normal((len(surface.nodes), 3)), rng.standard_normal(mesh.points.shape)
    assert np.sum(spread(shift) * G) == pytest.approx(np.sum(shift * spread.gathered(G)), rel=1e-10)


def test_openings_stay_and_the_wall_goes_along(mesh, surface):
    field = lumen_spread(mesh, surface)(0.01 * surface.normal)
    caps = np.unique(np.concatenate([mesh.labelled(n).ravel() for n in mesh.openings]))
    assert np.all(field[caps] == 0.0)
    outer = np.unique(mesh.labelled(OUTER_WALL))
    middle = outer[np.abs(mesh.points[outer, 2] - LENGTH / 2.0) < 0.3]
    # harmonic and free outside: nearly the shift of the lumen there
    moved = np.linalg.norm(field[middle], axis=1)
    assert moved.min() > 0.007
    assert np.all(tet_volumes(mesh.points + field, mesh.tets) > 0.0)


def test_density_of_the_volume_is_one(mesh, surface):
    """dV = ∫ h dA: a piece of lumen adds as much volume as it sweeps."""
    g = lumen_spread(mesh, surface).gathered(_volume_gradient(mesh))
    away = np.minimum(surface.points[:, 2], LENGTH - surface.points[:, 2]) > 0.4
    q = density(g, surface)
    np.testing.assert_allclose(q[away], 1.0, atol=0.02)  # coarse sides, ends beyond ℓ


def test_smoothing_keeps_the_total(mesh, surface):
    g = np.random.default_rng(1).standard_normal((len(surface.nodes), 3))
    raw, smooth = density(g, surface, length=0.0), density(g, surface)
    assert np.sum(raw * surface.area) == pytest.approx(np.sum(smooth * surface.area), rel=1e-10)
    assert np.std(smooth) < 0.5 * np.std(raw)
    K = surface_stiffness(surface)
    z = surface.points[:, 2]
    # ∫ |∇z|² dA of a tube is its area
    assert z @ (K @ z) == pytest.approx(surface.area.sum(), rel=1e-3)


def test_thicker_wall_leaves_the_lumen(mesh, surface):
    field = thickness_field(mesh, surface)
    assert np.all(field[surface.nodes] == 0.0)
    outer = np.unique(mesh.labelled(OUTER_WALL))
    middle = outer[np.abs(mesh.points[outer, 2] - LENGTH / 2.0) < 0.7]
    np.testing.assert_allclose(np.linalg.norm(field[middle], axis=1), THICKNESS, rtol=0.02)
    fluid = np.setdiff1d(mesh.tets_of(Region.FLUID), surface.nodes)
    assert np.all(field[fluid] == 0.0)


def test_nodes_of_another_vessel_are_left_out(surface):
    axis = np.column_stack([np.zeros(50), np.zeros(50), np.linspace(0.0, LENGTH, 50)])
    assert np.all(vessel_nodes(surface, axis, reach=0.6))
    beside = axis + np.array([RADIUS + 0.2, 0.0, 0.0])
    assert not np.any(vessel_nodes(surface, beside, reach=0.3))
