"""Columns of wedges: where they stand, what they leave to tetrahedra, and how they are joined."""

import dataclasses
import json
import sys

import numpy as np
import pytest

from jaxfsi.anatomy import Anatomy, Centerline, Opening
from jaxfsi.faces import boundary_of, find_rows, same_sense
from jaxfsi.measures import enclosed_volume, triangle_areas
from jaxfsi.mesh import INTERFACE, OUTER_WALL, Mesh, Region, tet_volumes
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.meshing import MeshResult, build_mesh
from jaxfsi.meshing.columns.cover import NoColumns, cover
from jaxfsi.meshing.columns.outer import stitched, subdivided
from jaxfsi.meshing.columns.stack import stack, stack_sides
from jaxfsi.meshing.columns.zone import (
    LEAST_TET_DIHEDRAL_DEG,
    SurfaceGraph,
    shapely,
    tidied,
)
from jaxfsi.meshing.structured.prisms import tets_of_wedges
from jaxfsi.meshing.surface.clipping import ClippedSurface
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.sizes import grown_field


def straight_tube(*, R: float = 0.4, thickness: float = 0.1, half_length: float = 0.5) -> Anatomy:
    """A straight vessel along z [cm]."""
    up = np.array([0.0, 0.0, 1.0])
    ball, box = 1.5 * (R + thickness), np.array([R + thickness + 0.1] * 2 + [half_length + 0.2])
    z = np.linspace(-half_length, half_length, 11)
    return Anatomy(
        name="straight tube",
        lumen=lambda x: np.hypot(x[:, 0], x[:, 1]) - R,
        wall=lambda x: np.hypot(x[:, 0], x[:, 1]) - R - thickness,
        local_radius=lambda x: np.full(len(x), R),
        thickness=lambda x: np.full(len(x), thickness),
        openings=(
            Opening("inlet", -half_length * up, -up, ball),
            Opening("outlet", half_length * up, up, ball),
        ),
        bounds=np.stack([-box, box]),
        centerlines={"aorta": Centerline(z[:, None] * up, z + half_length)},
    )


@pytest.fixture(scope="module")
def result(branched_tube) -> MeshResult:
    # Openings so far from the septum that columns stand along their rims.
    return build_mesh(branched_tube(half_length=1.1), preset="coarse", wedge_layers=1)


@pytest.fixture(scope="module")
def mesh(result) -> Mesh:
    return result.mesh


def test_wall_beside_the_septum_is_wedges(result):
    wedges = result.report.quality.wedges
    assert result.report.notes == ()
    assert 0.5 < wedges.volume_share < 1.0
    assert wedges.scaled_jacobian.minimum > 0.2
    assert wedges.min_dihedral_deg.minimum > 8.0
    told = json.loads(json.dumps(result.report.to_dict()))
    assert told["quality"]["wedges"]["number"] == wedges.number
    assert told["settings"]["wedge_layers"] == 1


def test_mesh_with_wedges_passes_the_gates_of_tetrahedra(mesh, result):
    check_mesh(mesh)
    assert result.report.topology.faults == ()
    assert result.report.topology.euler == {"lumen": 2, "wall": -2, "outer": 2}
    # Tetrahedra that fill a flat wedge are the flattest.
    assert result.report.quality.min_dihedral_deg > LEAST_TET_DIHEDRAL_DEG
    septum = result.report.fidelity.septum_ratio
    assert septum is not None
    assert 0.95 < septum.median < 1.06


def test_each_wedge_stands_on_the_lumen_and_ends_outside(mesh):
    feet, ends = mesh.wedges[:, :3], mesh.wedges[:, 3:]
    for name, faces in ((INTERFACE, feet), (OUTER_WALL, ends)):
        labelled = mesh.labelled(name)
        at = find_rows(faces, labelled)
        assert np.all(at >= 0)
        assert np.all(same_sense(faces, labelled[at]))
    sides = mesh.points[mesh.wedges[:, 1:4]] - mesh.points[mesh.wedges[:, :1]]
    assert np.all(np.linalg.det(sides) > 0.0)


def test_tissue_between_the_lumens_is_tetrahedra(mesh):
    in_wedge = np.zeros(len(mesh.tets), dtype=bool)
    in_wedge[mesh.wedge_tets] = True
    centre = mesh.points[mesh.tets].mean(axis=1)
    # The septum: between the aorta (radius 1) and the branch (axis at 1.21).
    septum = (centre[:, 0] > 1.01) & (centre[:, 0] < 1.05) & (np.abs(centre[:, 1]) < 0.05)
    septum &= (np.abs(centre[:, 2] - 0.05) < 0.15) & (mesh.region == Region.SOLID)
    assert septum.any()
    assert not in_wedge[septum].any()


def test_few_tetrahedra_fill_what_wedges_leave(mesh):
    rest = np.sum(mesh.region == Region.SOLID) - 3 * len(mesh.wedges)
    bare = len(mesh.labelled(INTERFACE)) - len(mesh.wedges)
    # One layer makes three tetrahedra a triangle, two layers six.
    assert 0 < rest < 4 * bare


def test_wall_without_a_septum_is_all_wedges():
    mesh, report = build_mesh(straight_tube(), preset="coarse", wedge_layers=2)
    wedges = report.quality.wedges
    assert wedges is not None
    assert wedges.volume_share == pytest.approx(1.0, rel=1e-12)
    assert wedges.number == 2 * len(mesh.labelled(INTERFACE))
    # A ring of thickness t: chords lose some 2 % of the area within, and of that outside as well.
    solid = float(tet_volumes(mesh.points, mesh.tets_of(Region.SOLID)).sum())
    assert solid == pytest.approx(np.pi * (0.5**2 - 0.4**2) * 1.0, rel=0.03)
    for name in ("inlet_ring", "outlet_ring"):
        ring = mesh.labelled(name)
        assert np.ptp(mesh.points[ring][:, :, 2]) < 1e-9
        area = float(triangle_areas(mesh.points, ring).sum())
        assert area == pytest.approx(np.pi * (0.5**2 - 0.4**2), rel=0.05)


def test_wall_that_takes_no_columns_is_tetrahedra_and_says_so():
    tube = straight_tube(half_length=0.25)
    # The wall that is drawn is five times as thick as the one that is asked for.
    thicker = dataclasses.replace(tube, thickness=lambda x: np.full(len(x), 0.02))
    report = build_mesh(thicker, preset="coarse", wedge_layers=1).report
    assert report.quality.wedges is None
    (note,) = report.notes
    assert note.startswith("tetrahedra alone fill the wall: only 0% of the columns reach")
    assert note.endswith("use a thinner wall")


def test_outer_surface_that_the_columns_tear_leaves_the_wall_to_tetrahedra(monkeypatch):
    def torn(*_):
        raise ValueError("the wall has 3 borders but 2 openings. Give each end an opening.")

    monkeypatch.setattr(sys.modules[cover.__module__], "fitted", torn)
    report = build_mesh(straight_tube(half_length=0.25), preset="coarse", wedge_layers=1).report
    assert report.quality.wedges is None
    (note,) = report.notes
    assert note.startswith("tetrahedra alone fill the wall: the outer surface that takes columns")
    assert "3 borders but 2 openings" in note


def test_wall_too_thin_for_its_triangles_says_how_to_mend():
    square = grid(8)
    up = np.array([0.0, 0.0, 1.0])
    lumen = ClippedSurface(square, (np.array([0]),))
    plate = dataclasses.replace(
        straight_tube(),
        lumen=lambda x: x[:, 2],
        wall=lambda x: x[:, 2] - 0.004,
        thickness=lambda x: np.full(len(x), 0.004),
        openings=(Opening("corner", np.zeros(3), up, 0.01),),
    )
    field = grown_field(square.points, np.full(len(square.points), 1 / 8))
    with pytest.raises(NoColumns) as told:
        cover(lumen, lumen, plate, field, deviation=0.01)
    assert str(told.value) == (
        "no wedge is well shaped, it is 0.004 cm thick over triangles 0.151 cm wide; use a finer"
        " preset or a thicker wall"
    )


@pytest.mark.parametrize("layers", [-1, 5, 1.5])
def test_number_of_layers_of_wedges_is_checked(layers):
    with pytest.raises(ValueError, match=f"wedge_layers is {layers}; choose 0 to 4, a whole"):
        build_mesh(straight_tube(), preset="coarse", wedge_layers=layers)


@pytest.mark.slow
def test_same_anatomy_gives_the_same_wedges(branched_tube, mesh):
    again = build_mesh(branched_tube(half_length=1.1), preset="coarse", wedge_layers=1).mesh
    np.testing.assert_array_equal(again.points, mesh.points)
    np.testing.assert_array_equal(again.wedges, mesh.wedges)


def moved(points: np.ndarray, *by: float) -> np.ndarray:
    return points + np.array(by)


def grid(n: int) -> Surface:
    """A unit square of 2 n² triangles in the plane z = 0."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n + 1), np.linspace(0.0, 1.0, n + 1), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    b, c, d = a + n + 1, a + n + 2, a + 1
    return Surface(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def test_stack_fills_the_space_between_two_surfaces_in_layers():
    square = grid(3)
    n = len(square.points)
    both = np.concatenate([square.points, moved(square.points, 0.0, 0.0, 0.6)])
    made = stack(np.arange(n), n + np.arange(n), square.triangles, both, layers=3)
    points = np.concatenate([both, made.levels])
    tets = tets_of_wedges(made.wedges, points)
    assert tet_volumes(points, tets).sum() == pytest.approx(0.6)
    assert np.allclose(tet_volumes(points, tets), 0.6 / len(tets))
    sides = stack_sides(made, points)
    assert triangle_areas(points, sides).sum() == pytest.approx(4 * 0.6)
    assert enclosed_volume(points, boundary_of(tets)) == pytest.approx(0.6)


def test_flat_leaning_and_folded_wedges_are_refused():
    square = grid(4)
    upright = moved(square.points, 0.0, 0.0, 0.25)
    assert shapely(square.points, upright, square.triangles).all()
    assert not shapely(square.points, moved(square.points, 0, 0, 0.02), square.triangles).any()
    assert not shapely(square.points, moved(square.points, 2.0, 0, 0.25), square.triangles).any()
    crossed = upright.copy()
    crossed[12, 0] += 0.5  # the middle vertex, over its neighbours
    good = shapely(square.points, crossed, square.triangles)
    assert not good[(square.triangles == 12).any(axis=1)].all()
    assert good[~(square.triangles == 12).any(axis=1)].all()


def test_narrow_small_and_pinched_patches_are_given_up():
    square = grid(20)
    graph = SurfaceGraph(square.triangles, len(square.points))
    x, y = square.points[:, 0], square.points[:, 1]
    wide, narrow = x < 0.475, (np.abs(y - 0.5) < 0.03) & (x > 0.4)
    free = tidied(graph, wide | narrow, ())
    assert np.array_equal(free, wide)
    assert not tidied(graph, (x < 0.12) & (y < 0.12), ()).any()
    # Two patches that meet in one vertex.
    pinched = ((x < 0.51) & (y < 0.51)) | ((x > 0.49) & (y > 0.49))
    zone = np.flatnonzero(tidied(graph, pinched, ())[square.triangles].all(axis=1))
    assert len(zone) > 300
    assert not graph.pinched(zone).any()


def test_rim_of_an_opening_has_columns_all_round_or_none_nearby():
    square = grid(20)
    graph = SurfaceGraph(square.triangles, len(square.points))
    x, y = square.points[:, 0], square.points[:, 1]
    edge = np.flatnonzero(x < 1e-9)
    hurt = ~((x < 0.01) & (np.abs(y - 0.5) < 0.01))
    free = tidied(graph, hurt, (edge,))
    assert not free[x < 0.12].any()
    assert free[x > 0.26].all()
    whole = tidied(graph, np.ones(len(x), dtype=bool), (edge,))
    assert whole.all()


def test_ends_of_columns_replace_the_surface_that_they_cover():
    wall = grid(16)
    middle = wall.points[wall.triangles].mean(axis=1)
    chosen = np.max(np.abs(middle[:, :2] - 0.5), axis=1) < 0.25
    used, renumbered = np.unique(wall.triangles[chosen], return_inverse=True)
    ends = Surface(moved(wall.points[used], 0.011, 0.007, 0.0), renumbered.reshape(-1, 3))
    field = grown_field(wall.points, np.full(len(wall.points), 1 / 16))
    made = stitched(
        wall, ends, np.zeros(len(used), dtype=bool), lambda x: x[:, 2], field, deviation=0.01
    )
    assert not made.failed.any()
    points, triangles = made.surface
    np.testing.assert_array_equal(points[: len(used)], ends.points)
    assert np.all(find_rows(ends.triangles, triangles) >= 0)
    assert triangle_areas(points, triangles).sum() == pytest.approx(1.0, rel=1e-9)
    graph = SurfaceGraph(triangles, len(points))
    assert len(np.unique(graph.patches(np.arange(len(triangles))))) == 1


def test_subdividing_keeps_area_and_sense():
    square = grid(2)
    fine = subdivided(square, 2)
    assert len(fine.triangles) == 16 * len(square.triangles)
    corners = fine.points[fine.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(normal[:, 2], 0.25 / 4**2 / 1.0, rtol=1e-12)
