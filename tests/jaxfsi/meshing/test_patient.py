"""The real patient: what is meshed is what was measured, in all four states.

`test_build.py` checks the same of a small anatomy, which is quick.
"""

import pathlib
from typing import NamedTuple

import numpy as np
import pytest

from jaxfsi.anatomy import (
    Anatomy,
    centerline_point,
    ivus_anatomy,
    read_sized_line,
    surface_outline,
)
from jaxfsi.faces import boundary_of
from jaxfsi.measures import enclosed_volume
from jaxfsi.mesh import INTERFACE, Region
from jaxfsi.meshing import MeshResult, build_mesh
from jaxfsi.meshing.check.section_areas import section_areas
from study import demo_case_path, read_case
from study.run.anatomy_source import case_anatomy
from tests.jaxfsi.meshing.shared_interface import assert_interface_is_shared
from tests.jaxfsi.meshing.solid_angles import solid_angles

BUNDLED = demo_case_path().parent


class Meshed(NamedTuple):
    anatomy: Anatomy
    result: MeshResult


@pytest.fixture(scope="module")
def patient() -> Meshed:
    """The bundled state, coarse."""
    anatomy = ivus_anatomy(
        BUNDLED / "rest_diastole_contours.csv",
        BUNDLED / "centerline.csv",
        frame_table=BUNDLED / "rest_frames.csv",
        reference=BUNDLED / "rest_diastole_reference.csv",
    )
    return Meshed(anatomy, build_mesh(anatomy, preset="coarse"))


@pytest.mark.slow
def test_interface_is_the_same_set_of_triangles_in_blood_and_wall(patient):
    assert_interface_is_shared(patient.result.mesh)


@pytest.mark.slow
def test_euler_characteristics_and_volumes_are_those_of_three_openings(patient):
    topology = patient.result.report.topology
    assert topology.faults == ()
    assert topology.euler == {"lumen": 2, "wall": -2, "outer": 2}
    mesh = patient.result.mesh
    # The same volume from tetrahedra and from the closed surface: round-off of some 1e4 terms.
    lumen = enclosed_volume(mesh.points, boundary_of(mesh.tets_of(Region.FLUID)))
    assert lumen == pytest.approx(topology.volume["fluid"], rel=1e-10)
    assert enclosed_volume(mesh.points, boundary_of(mesh.tets)) == pytest.approx(
        sum(topology.volume.values()), rel=1e-10
    )
    # The aorta is a cylinder of 14 mm, the coronary adds 2 %; coarse chords balance to 0.5 %.
    length = float(np.ptp(patient.anatomy.centerlines["aorta"].s))
    assert 1.0 < lumen / (np.pi * 1.4**2 * length) < 1.04


@pytest.mark.slow
def test_no_node_of_the_wall_lies_inside_the_lumen(patient):
    mesh = patient.result.mesh
    surface = boundary_of(mesh.tets_of(Region.FLUID))
    nodes = np.setdiff1d(mesh.tets_of(Region.SOLID), surface)
    turns = solid_angles(mesh.points[nodes], mesh.points[surface]) / (4.0 * np.pi)
    # A winding number is a whole number: 0 outside, 1 inside.
    np.testing.assert_allclose(turns, 0.0, atol=1e-8)
    inside = mesh.points[mesh.tets_of(Region.FLUID)[::50]].mean(axis=1)
    turns = solid_angles(inside, mesh.points[surface]) / (4.0 * np.pi)
    np.testing.assert_allclose(turns, 1.0, atol=1e-8)


@pytest.mark.slow
def test_tissue_between_the_lumens_is_as_thick_as_measured(patient):
    septum = patient.result.report.fidelity.septum_ratio
    assert septum is not None
    assert 0.9 < septum.p1 < septum.p99 < 1.1
    through = patient.result.report.quality.through_edges
    assert (through.wall, through.septum) == (0, 0)


@pytest.mark.slow
def test_coarse_lumen_areas_are_the_measured_ones(patient):
    areas = section_areas(patient.result.mesh, patient.anatomy)
    assert len(areas.s) == 20
    assert np.all(np.isfinite(areas.error))
    # About five elements go round a slit's end in a coarse mesh; medium is held to 3 %.
    assert areas.largest_error < 0.05
    # Chords alone would lose 3 % on average.
    assert abs(np.mean(areas.error)) < 0.01


@pytest.mark.slow
def test_sections_where_vessels_join_are_left_open_but_frames_never(patient):
    mesh, anatomy = patient.result.mesh, patient.anatomy
    aorta = section_areas(mesh, anatomy, vessel="aorta")
    known = np.isfinite(aorta.error)
    assert 0.5 * len(known) < np.sum(known)
    # The same bound as for the coronary; a second vessel in the plane would add far more.
    assert aorta.largest_error < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["coarse", "medium"])
def test_mesh_of_the_bundled_case_has_the_aorta_and_the_stem_of_its_ct(preset):
    anatomy = case_anatomy(read_case(demo_case_path()))
    mesh, report = build_mesh(anatomy, preset=preset)
    assert report.topology.faults == ()
    assert report.topology.euler == {"lumen": 2, "wall": -4, "outer": 2}
    assert (report.quality.through_edges.wall, report.quality.through_edges.septum) == (0, 0)
    for vessel in ("aorta", "anomalous", "normal"):
        assert section_areas(mesh, anatomy, vessel=vessel).largest_error < 0.05
    ct = read_sized_line(BUNDLED / "aorta_centerline.csv")
    axes, origin = (np.array(anatomy.meta[f"aortic_{x}_in_ct"]) for x in ("axes", "origin"))
    points = (ct.points - origin) @ axes.T
    surface = boundary_of(mesh.tets_of(Region.FLUID))
    line = anatomy.centerlines["aorta"]
    for s in (0.3, 0.6, 3.2, 3.7):  # away from the ostia, which lie about s = 2
        centre, normal = centerline_point(line, s)
        outline = surface_outline(mesh.points, surface, centre, normal)
        p, q = outline[:, 0], outline[:, 1]
        piece = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2.0
        middle = np.sum(piece[:, None] * (p + q), axis=0) / (3.0 * piece.sum())
        nearest = int(np.argmin(np.linalg.norm(points - centre, axis=1)))
        # axis: smoothing over 3 mm and steps of 5 mm in the file; radius: the same, and chords
        assert np.linalg.norm(middle) < 0.02
        away = points[nearest] - centre
        assert np.linalg.norm(away - (away @ normal) * normal) < 0.03
        radius = np.sqrt(abs(piece.sum()) / np.pi)
        assert radius == pytest.approx(np.interp(s, *_ct_radius(points, ct.radius, line)), abs=0.05)


def _ct_radius(points: np.ndarray, radius: np.ndarray, line) -> tuple[np.ndarray, np.ndarray]:
    """Radius of CT by arc length on the axis of the model."""
    nearest = np.linalg.norm(points[:, None] - line.points, axis=2).argmin(axis=1)
    inner = (nearest > 0) & (nearest < len(line.s) - 1)
    order = np.argsort(line.s[nearest[inner]])
    return line.s[nearest[inner]][order], radius[inner][order]


STATES = [(drug, phase) for drug in ("rest", "stress") for phase in ("diastolic", "systolic")]


@pytest.mark.slow
@pytest.mark.parametrize(("drug", "phase"), STATES)
def test_every_frame_of_every_state_has_its_area(shared_data: pathlib.Path, drug, phase):
    folder = shared_data / "ivus_aaoca"
    pullback = folder / f"ivus_{drug}"
    anatomy = ivus_anatomy(
        pullback / f"{phase}_contours.csv",
        folder / "centerline_raw.csv",
        frame_table=pullback / "combined_sorted_manual.csv",
        reference=pullback / f"{phase}_reference_points.csv",
    )
    mesh, report = build_mesh(anatomy, preset="medium")
    areas = section_areas(mesh, anatomy)
    assert np.all(np.isfinite(areas.error))
    assert areas.largest_error < 0.03
    septum = report.fidelity.septum_ratio
    assert septum is not None
    assert 0.9 < septum.p1 < septum.p99 < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["coarse", "medium", "fine"])
def test_wall_stands_in_columns_on_every_preset(preset):
    result = build_mesh(
        case_anatomy(read_case(demo_case_path()), "rest_diastole"), preset=preset, wedge_layers=1
    )
    mesh, report = result.mesh, result.report
    assert report.notes == ()
    # Where tissue lies between two lumens no column can stand.
    assert len(mesh.wedges) > 0.7 * len(mesh.labelled(INTERFACE))
