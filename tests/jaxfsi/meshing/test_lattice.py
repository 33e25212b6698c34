import dataclasses

import numpy as np
import pytest

from jaxfsi.anatomy import Anatomy
from jaxfsi.meshing.surface.isosurface import extract_surface
from jaxfsi.meshing.surface.topology import surface_topology
from jaxfsi.meshing.volume.lattice import LatticeSettings, sample_lattice


def balls(*centres: float, radius: float, wall: float = 0.1, box: float = 1.5) -> Anatomy:
    """Spheres on the x axis, each in a wall of the given thickness."""
    places = [np.array([x, 0.0, 0.0]) for x in centres]

    def lumen(x):
        return np.min([np.linalg.norm(x - c, axis=1) for c in places], axis=0) - radius

    return Anatomy(
        name="balls",
        lumen=lumen,
        wall=lambda x: lumen(x) - wall,
        local_radius=lambda x: np.full(len(x), radius),
        thickness=lambda x: np.full(len(x), wall),
        openings=(),
        bounds=np.array([[-box] * 3, [box] * 3]),
        centerlines={},
    )


def lumen_surface(anatomy, settings):
    lattice = sample_lattice(anatomy, settings)
    return extract_surface(lattice.points, lattice.tets, lattice.lumen, anatomy.lumen)


def edges_meet_in_faces(tets) -> bool:
    """No node of the lattice may hang on an edge: every inner face belongs to two tetrahedra."""
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    return bool(np.unique(faces, axis=0, return_counts=True)[1].max() <= 2)


def test_sphere_is_closed_and_its_volume_converges_with_second_order():
    error = []
    for largest in (0.3, 0.15, 0.075):
        anatomy = balls(0.0, radius=0.7)
        surface = lumen_surface(anatomy, LatticeSettings(10.0, 0.01, largest))
        topology = surface_topology(*surface)
        assert topology.is_closed_manifold
        assert topology.euler == 2
        error.append(4.0 / 3.0 * np.pi * 0.7**3 - topology.volume)
    assert min(error) > 0.0  # flat triangles lie inside a sphere, and normals point outwards
    rates = np.log2(np.array(error[:-1]) / np.array(error[1:]))
    # Second order with a remainder of the irregular lattice below 15 %.
    np.testing.assert_allclose(rates, 2.0, atol=0.3)


def test_vertices_lie_on_the_surface_far_within_a_cell():
    anatomy = balls(0.0, radius=0.7)
    surface = lumen_surface(anatomy, LatticeSettings(10.0, 0.01, 0.15))
    # Linear interpolation on an edge h errs by h²/8R = 4e-3; regula falsi squares the share.
    # A fiftieth of an edge (3e-3) is the margin that vertices keep from nodes.
    assert np.abs(anatomy.lumen(surface.points)).max() < 3.5e-3


@pytest.mark.parametrize("septum", [0.06, 0.03])
def test_thin_septum_between_lumens_stays_whole(septum):
    # The coarse lattice (0.3) knows nothing of the septum; ridges of the distance lead to it.
    apart = 0.5 + 0.5 * septum
    surface = lumen_surface(balls(-apart, apart, radius=0.5), LatticeSettings(10.0, 0.012, 0.3))
    topology = surface_topology(*surface)
    assert topology.n_components == 2
    assert topology.euler == 4


def test_lattice_conforms_and_surfaces_nest():
    anatomy = balls(0.0, radius=0.7, wall=0.05)
    lattice = sample_lattice(anatomy, LatticeSettings(10.0, 0.01, 0.3))
    assert edges_meet_in_faces(lattice.tets)
    assert np.all(lattice.wall < lattice.lumen)


def test_same_anatomy_gives_the_same_lattice():
    anatomy = balls(0.0, radius=0.7)
    first, second = (sample_lattice(anatomy, LatticeSettings(10.0, 0.02, 0.3)) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_array_equal(first.tets, second.tets)


def test_finer_settings_shrink_all_lengths():
    finer = LatticeSettings(0.5, 0.02, 0.3).finer()
    np.testing.assert_allclose(finer, (0.35, 0.014, 0.21), rtol=1e-12)  # round-off


def test_negative_values_give_the_same_surface_turned():
    anatomy = balls(0.0, radius=0.7)
    inside_out = dataclasses.replace(anatomy, lumen=lambda x: -anatomy.lumen(x))
    settings = LatticeSettings(10.0, 0.01, 0.3)
    volume = [surface_topology(*lumen_surface(a, settings)).volume for a in (anatomy, inside_out)]
    np.testing.assert_allclose(volume[0], -volume[1], rtol=1e-9)  # same points, round-off
