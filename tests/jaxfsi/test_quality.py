import json

import numpy as np
import pytest

from jaxfsi.anatomy import Opening
from jaxfsi.mesh import Mesh, Region
from jaxfsi.meshing import (
    label_faces,
    mesh_quality,
    ring,
    strip,
    tet_quality,
    through_edges,
    tube,
    wall_thickness,
)
from jaxfsi.meshing.check.quality import spread_of
from jaxfsi.meshing.check.thickness import Exit
from jaxfsi.meshing.structured.prisms import PlaneMesh, extruded

REGULAR = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
CORNER = np.concatenate([np.zeros((1, 3)), np.eye(3)])


def test_a_regular_tetrahedron_is_perfect():
    shape = tet_quality(REGULAR, np.array([[0, 1, 2, 3], [0, 2, 1, 3]]))
    # Round-off of the arc cosine.
    np.testing.assert_allclose(shape.min_dihedral_deg, np.degrees(np.arccos(1.0 / 3.0)), rtol=1e-12)
    np.testing.assert_allclose(shape.max_dihedral_deg, shape.min_dihedral_deg, rtol=1e-12)
    np.testing.assert_allclose(shape.aspect_ratio, 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.sort(shape.scaled_jacobian), [-1.0, 1.0], rtol=1e-12)


def test_a_cube_corner_has_its_closed_form_quality():
    shape = tet_quality(CORNER, np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(shape.max_dihedral_deg, 90.0, rtol=1e-12)
    np.testing.assert_allclose(
        shape.min_dihedral_deg, np.degrees(np.arccos(1.0 / np.sqrt(3.0))), rtol=1e-12
    )
    # Longest edge sqrt 2, height over the slanted face 1 / sqrt 3.
    np.testing.assert_allclose(shape.aspect_ratio, np.sqrt(2.0 / 3.0) * np.sqrt(6.0), rtol=1e-12)
    # Largest edge product at the three outer corners: 1 * sqrt 2 * sqrt 2.
    np.testing.assert_allclose(shape.scaled_jacobian, np.sqrt(2.0) / 2.0, rtol=1e-12)


def test_a_flat_tetrahedron_has_no_height():
    flat = CORNER.copy()
    flat[3] = [0.3, 0.3, 0.0]
    shape = tet_quality(flat, np.array([[0, 1, 2, 3]]))
    assert shape.scaled_jacobian[0] == 0.0
    assert np.isinf(shape.aspect_ratio[0])


def test_quality_does_not_depend_on_size_or_place():
    tets = np.array([[0, 1, 2, 3]])
    for values, moved in zip(
        tet_quality(CORNER, tets), tet_quality(1e-3 * CORNER + 5.0, tets), strict=True
    ):
        # Cancellation of 5.001 - 5 leaves 12 digits.
        np.testing.assert_allclose(values, moved, rtol=1e-10)


@pytest.mark.parametrize("n_layers", [1, 2, 3])
def test_wall_of_a_tube_has_the_thickness_between_its_facets(n_layers):
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=16, n_axial=5, n_layers=n_layers)
    measured = wall_thickness(mesh)
    assert len(measured.of_wall) == len(mesh.labelled("interface"))
    # Between parallel sides of two regular polygons: the difference of their apothems.
    np.testing.assert_allclose(measured.of_wall, 0.1 * np.cos(np.pi / 16), rtol=1e-10)


def test_thickness_needs_a_wall():
    blood = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=2, n_layers=0)
    with pytest.raises(ValueError, match="no wall to measure"):
        wall_thickness(blood)


def two_lumens(septum: float, n_through: int) -> Mesh:
    """Two square channels along z in one block of solid, a septum between them.

    They join below z = 0.2, so that the lumen is one.
    """
    across = np.concatenate(
        [
            [0.0, 0.1],
            np.linspace(0.4, 0.4 + septum, n_through + 1),
            [0.7 + septum, 0.8 + septum],
        ]
    )
    along = np.array([0.0, 0.1, 0.4, 0.5])
    x, y = np.meshgrid(across, along, indexing="ij")
    node = np.arange(x.size).reshape(x.shape)
    a, b = node[:-1, :-1].reshape(-1), node[1:, :-1].reshape(-1)
    c, d = node[1:, 1:].reshape(-1), node[:-1, 1:].reshape(-1)
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    section = PlaneMesh(
        np.stack([x.reshape(-1), y.reshape(-1)], 1), triangles, np.zeros(len(triangles), int)
    )
    points, tets, region = extruded(section, np.linspace(0.0, 1.0, 6))
    mx, my, mz = points[tets].mean(axis=1).T
    in_band = (my > 0.1) & (my < 0.4) & (mx > 0.1) & (mx < 0.7 + septum)
    in_septum = (mx > 0.4) & (mx < 0.4 + septum) & (mz > 0.2)
    region = np.where(in_band & ~in_septum & (mz > 0.2), int(Region.FLUID), int(Region.SOLID))
    region = np.where(in_band & (mz < 0.2), int(Region.FLUID), region)
    up = np.array([0.0, 0.0, 1.0])
    middle = (0.8 + septum) / 2.0
    openings = (
        Opening("inlet", np.array([middle, 0.25, 0.0]), -up, 1.0),
        Opening("left", np.array([0.25, 0.25, 1.0]), up, 0.45),
        Opening("right", np.array([0.55 + septum, 0.25, 1.0]), up, 0.45),
    )
    return label_faces(points, tets, region, openings)


@pytest.mark.parametrize("septum", [0.05, 0.1])
def test_septum_is_measured_from_lumen_to_lumen(septum):
    measured = wall_thickness(two_lumens(septum, 2))
    assert len(measured.of_septum) > 0
    # Plane-parallel by construction; rays start inside faces of a lattice.
    np.testing.assert_allclose(measured.of_septum, septum, rtol=1e-10)
    assert set(np.unique(measured.exit)) >= {Exit.OUTER_WALL, Exit.LUMEN}


def test_single_layers_are_counted_in_wall_and_septum():
    one, two = through_edges(two_lumens(0.1, 1)), through_edges(two_lumens(0.1, 2))
    # At the tip of the septum the interface turns a corner, which one edge in each of the three
    # rows cuts off whatever the layers.
    assert two.septum == 3
    assert one.septum > 20
    thin = tube(radius=0.5, length=1.0, thickness=0.1, n_around=12, n_axial=4, n_layers=1)
    n_axial, n_around = 4, 12
    # One layer: radial edges inside, one diagonal on each side wall of a prism and one on each
    # inner level; all tetrahedra have only boundary nodes.
    counted = through_edges(thin)
    assert counted.single_layer_tets == 6 * n_axial * n_around
    radial, diagonal = (n_axial - 1) * n_around, (n_axial - 1) * n_around
    assert counted.wall >= radial + diagonal
    thick = tube(radius=0.5, length=1.0, thickness=0.1, n_around=12, n_axial=4, n_layers=2)
    assert through_edges(thick) == (0, 0, 0, 0)


def test_summary_can_be_written_and_shown():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=12, n_axial=4)
    quality = mesh_quality(mesh)
    plain = json.loads(json.dumps(quality.to_dict()))
    assert plain["n_tets"] == {
        "fluid": int(np.sum(mesh.region == 0)),
        "solid": int(np.sum(mesh.region == 1)),
    }
    assert plain["septum_thickness_cm"] is None
    assert quality.min_dihedral_deg > 5.0
    assert "fluid aspect_ratio" in quality.table()
    # Lateral area of the inscribed prism.
    assert quality.area_cm2["interface"] == pytest.approx(12 * np.sin(np.pi / 12), rel=1e-12)


def test_walls_alone_are_measured_too():
    wall = ring(radius=0.5, length=0.2, thickness=0.2, n_around=16, n_axial=2, n_layers=3)
    quality = mesh_quality(wall)
    assert quality.wall_thickness_cm is not None
    # As for the tube: difference of two apothems.
    assert quality.wall_thickness_cm.median == pytest.approx(0.2 * np.cos(np.pi / 16), rel=1e-10)
    box = mesh_quality(
        strip(length=1.0, width=0.2, thickness=0.1, n_length=5, n_width=1, n_layers=1)
    )
    assert box.wall_thickness_cm is None


def test_nothing_to_summarise_is_refused():
    with pytest.raises(ValueError, match="no values"):
        spread_of(np.zeros(0))
