import dataclasses
import json

import numpy as np
import pytest

from jaxfsi.anatomy import adult_anatomy, paediatric_anatomy, sample_anatomies, synthetic_anatomy
from jaxfsi.faces import boundary_of
from jaxfsi.measures import enclosed_volume
from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.meshing import (
    PRESETS,
    MeshingError,
    MeshResult,
    build,
    build_mesh,
    elements_across,
)
from jaxfsi.meshing.check.section_areas import section_areas
from tests.jaxfsi.meshing.shared_interface import assert_interface_is_shared
from tests.jaxfsi.meshing.solid_angles import solid_angles


@pytest.fixture(scope="module")
def anatomy(branched_tube):
    return branched_tube()


@pytest.fixture(scope="module")
def result(anatomy) -> MeshResult:
    return build_mesh(anatomy, preset="coarse")


@pytest.fixture(scope="module")
def mesh(result) -> Mesh:
    return result.mesh


def test_mesh_is_labelled_and_consistent(mesh, anatomy):
    check_mesh(mesh)
    assert mesh.openings == tuple(opening.name for opening in anatomy.openings)
    assert mesh.meta["septum_cm"] == 0.06


def test_topology_is_that_of_vessels_in_a_wall(result):
    topology = result.report.topology
    assert topology.faults == ()
    assert topology.euler == {"lumen": 2, "wall": -2, "outer": 2}


def test_interface_is_the_same_set_of_triangles_in_blood_and_wall(mesh):
    assert_interface_is_shared(mesh)


def test_volumes_of_tetrahedra_and_of_closed_surfaces_agree(mesh, result):
    volume = result.report.topology.volume
    # The same volume in two ways: round-off of some 1e4 terms.
    lumen = enclosed_volume(mesh.points, boundary_of(mesh.tets_of(Region.FLUID)))
    assert lumen == pytest.approx(volume["fluid"], rel=1e-10)
    whole = enclosed_volume(mesh.points, boundary_of(mesh.tets))
    assert whole == pytest.approx(sum(volume.values()), rel=1e-10)


def test_no_node_of_the_wall_lies_inside_the_lumen(mesh):
    surface = boundary_of(mesh.tets_of(Region.FLUID))
    nodes = np.setdiff1d(mesh.tets_of(Region.SOLID), surface)
    turns = solid_angles(mesh.points[nodes], mesh.points[surface]) / (4.0 * np.pi)
    # A winding number is a whole number: 0 outside, 1 inside.
    np.testing.assert_allclose(turns, 0.0, atol=1e-8)
    inside = mesh.points[mesh.tets_of(Region.FLUID)[::50]].mean(axis=1)
    turns = solid_angles(inside, mesh.points[surface]) / (4.0 * np.pi)
    np.testing.assert_allclose(turns, 1.0, atol=1e-8)


def test_lumen_areas_are_those_asked_for_and_left_open_where_vessels_join(mesh, anatomy):
    branch = section_areas(mesh, anatomy, vessel="branch")
    known = np.isfinite(branch.error)
    assert 4 <= np.sum(known) < len(known)
    # About five elements go round a lumen in a coarse mesh.
    assert branch.largest_error < 0.05
    assert abs(np.mean(branch.error[known])) < 0.03
    aorta = section_areas(mesh, anatomy, vessel="aorta")
    known = np.isfinite(aorta.error)
    assert np.sum(known) > 0.2 * len(known)
    # A second vessel in the plane would add far more.
    assert aorta.largest_error < 0.05
    with pytest.raises(ValueError, match="has no centerline 'vein'"):
        section_areas(mesh, anatomy, vessel="vein")


def test_elements_are_well_shaped_and_as_many_as_asked(result):
    quality = result.report.quality
    assert quality.min_dihedral_deg > 8.0
    # The prediction of the count is an estimate for vessels in general.
    assert 15_000 < sum(quality.n_tets.values()) < 45_000


def test_wall_and_septum_have_two_layers(result):
    through = result.report.quality.through_edges
    assert (through.wall, through.septum, through.single_layer_tets) == (0, 0, 0)


def test_septum_is_as_thick_as_asked_within_a_tenth(result):
    septum = result.report.fidelity.septum_ratio
    assert septum is not None
    # Triangles of a coarse mesh lie inside the curved surfaces: a few per cent.
    assert 0.95 < septum.median < 1.06
    assert septum.p99 < 1.1
    thickness = result.report.quality.septum_thickness_cm
    assert thickness is not None
    assert thickness.p1 == pytest.approx(0.06, rel=0.1)


def test_triangles_lie_on_the_implicit_surfaces_on_average(mesh, anatomy):
    for name, f, radius in (("interface", anatomy.lumen, 1.0), ("outer_wall", anatomy.wall, 1.1)):
        corners = mesh.points[mesh.labelled(name)]
        middle = 0.5 * (corners + corners[:, [1, 2, 0]])
        longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max()
        # Corners and middles of triangles h on radius R differ by h²/8R; corners lie outside by
        # as much as middles lie inside, so neither is off by more.
        gap = longest**2 / (8.0 * radius)
        assert np.percentile(np.abs(f(mesh.points[np.unique(mesh.labelled(name))])), 99) < gap
        value = f(middle.reshape(-1, 3)).reshape(-1, 3).mean(axis=1)
        area = 0.5 * np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        # What one step of balancing leaves of it, a tenth.
        assert abs(np.average(value, weights=area)) < 0.1 * gap


def test_volume_and_areas_approach_the_shapes(result, anatomy):
    quality = result.report.quality
    # Flat triangles h on radius R lose a share of about (h/2R)²: 2 % for h = 0.28 on R = 1.
    assert quality.area_cm2["aorta_inlet"] == pytest.approx(np.pi, rel=0.02)
    assert quality.area_cm2["anomalous_outlet"] == pytest.approx(np.pi * 0.15**2, rel=0.06)
    lumen = np.pi * 1.4 + np.pi * 0.15**2
    assert quality.volume_cm3["fluid"] == pytest.approx(lumen, rel=0.03)


def test_report_is_plain_and_complete(result):
    told = json.loads(json.dumps(result.report.to_dict()))
    assert told["settings"]["preset"] == "coarse"
    assert set(told["wall_time_s"]) == {
        "sampling",
        "sizes",
        "remeshing",
        "closing",
        "filling",
        "checking",
    }


def test_failed_attempts_are_repeated_and_told(anatomy, monkeypatch):
    told, reasons = [], iter(["the septum broke", "an element is flat"])

    def failing(*_):
        raise MeshingError(next(reasons))

    monkeypatch.setattr(build, "ATTEMPTS", build.ATTEMPTS[:2])
    monkeypatch.setattr(build, "_surfaces", failing)
    with pytest.raises(MeshingError, match=r"not meshed in 2 attempts.*an element is flat"):
        build_mesh(anatomy, preset="coarse", progress=lambda *x: told.append(x))


def with_opening(anatomy, index: int, **changes):
    openings = list(anatomy.openings)
    openings[index] = openings[index]._replace(**changes)
    return dataclasses.replace(anatomy, openings=tuple(openings))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"centre": np.array([5.0, 0.0, 0.0])}, "plane misses the vessel"),
        ({"normal": np.array([0.0, 0.0, -2.0])}, "no unit vector"),
        ({"name": "interface"}, "name of a wall label"),
        ({"name": "aorta_outlet"}, "each its own name"),
        ({"radius": -1.0}, "has radius -1.0"),
    ],
)
def test_bad_openings_are_refused(anatomy, changes, message):
    with pytest.raises(ValueError, match=message):
        build_mesh(with_opening(anatomy, 0, **changes))


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        ({"preset": "huge"}, "no preset 'huge'.*coarse, medium, fine"),
        ({"elements_across": 1}, "elements_across is 1"),
        ({"wall_layers": 0}, "wall_layers is 0"),
        ({"wedge_layers": 5}, "wedge_layers is 5; choose 0 to 4"),
        ({"backend": "cgal"}, "no meshing backend 'cgal'"),
    ],
)
def test_bad_requests_are_refused(anatomy, request_, message):
    with pytest.raises(ValueError, match=message):
        build_mesh(anatomy, **request_)


def test_wrong_unit_and_empty_bounds_are_refused(anatomy):
    for bounds, message in (
        (1e3 * anatomy.bounds, "multiply lengths in mm by 0.1"),
        (anatomy.bounds[::-1], "hold nothing"),
    ):
        with pytest.raises(ValueError, match=message):
            build_mesh(dataclasses.replace(anatomy, bounds=bounds))


def test_wall_inside_the_lumen_is_refused(anatomy):
    inverted = dataclasses.replace(anatomy, wall=lambda x: anatomy.lumen(x) + 0.05)
    with pytest.raises(ValueError, match="W < L"):
        build_mesh(inverted)


def test_lumen_too_thin_for_the_lattice_is_refused(branched_tube):
    with pytest.raises(ValueError, match=r"'branch' is 0\.012 cm wide.*thinner than"):
        build_mesh(branched_tube(r=0.006, branch_wall=0.05), preset="coarse")


def test_vessels_that_do_not_touch_are_refused(branched_tube):
    with pytest.raises(ValueError, match="'anomalous_outlet' is not joined"):
        build_mesh(branched_tube(joined=False, septum=0.3), preset="coarse")


@pytest.mark.slow
def test_medium_preset_says_how_many_elements_cross_the_lumen(anatomy):
    mesh, report = build_mesh(anatomy, preset="medium")
    across = PRESETS["medium"].across
    assert report.settings["elements_across"] == across == 6
    # single tetrahedra scatter about the size asked for, nineteen of twenty within a tenth
    assert np.percentile(elements_across(mesh, anatomy), 5) > 0.9 * 6


@pytest.mark.slow
def test_same_anatomy_gives_the_same_mesh(anatomy, mesh):
    again = build_mesh(anatomy, preset="coarse").mesh
    np.testing.assert_array_equal(again.points, mesh.points)
    np.testing.assert_array_equal(again.tets, mesh.tets)


@pytest.mark.slow
@pytest.mark.parametrize("septum", [0.035, 0.13])
def test_thin_and_thick_septa(branched_tube, septum):
    report = build_mesh(branched_tube(septum=septum), preset="medium").report
    assert report.quality.min_dihedral_deg > 8.0
    ratio = report.fidelity.septum_ratio
    assert ratio is not None
    assert 0.9 < ratio.p1 < ratio.p99 < 1.1


@pytest.mark.slow
def test_elements_across_are_reached_on_request(anatomy):
    mesh = build_mesh(anatomy, preset="coarse", elements_across=8).mesh
    across = elements_across(mesh, anatomy)
    # Single tetrahedra scatter about the size asked for, nineteen of twenty within a tenth.
    assert np.percentile(across, 5) > 0.9 * 8


@pytest.mark.slow
def test_more_layers_through_the_wall(anatomy):
    mesh = build_mesh(anatomy, preset="coarse", wall_layers=4).mesh
    solid = mesh.points[mesh.tets_of(Region.SOLID)]
    edges = np.linalg.norm(solid[:, [0, 0, 0, 1, 1, 2]] - solid[:, [1, 2, 3, 2, 3, 3]], axis=2)
    # Four layers of 0.06 are 0.015 each; elements are up to twice as wide as high.
    assert np.percentile(edges, 5) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("case", ["right", "left", "sampled"])
def test_synthetic_anatomies_pass_all_gates(case):
    parameters = {
        "right": adult_anatomy("right"),
        "left": paediatric_anatomy("left"),
        "sampled": sample_anatomies(3, 1, side="right", age="paediatric")[0],
    }[case]
    report = build_mesh(synthetic_anatomy(parameters), preset="coarse").report
    assert report.topology.euler == {"lumen": 2, "wall": -4, "outer": 2}
    assert report.quality.min_dihedral_deg > 5.0
    assert report.retries == ()
