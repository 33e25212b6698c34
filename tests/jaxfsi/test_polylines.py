"""Centre lines with radii and branches: read, written, and used as the course of a vessel."""

import pathlib

import numpy as np
import pytest

from jaxfsi.anatomy import ivus_anatomy, longest_line, read_centerline
from jaxfsi.mesh_files import (
    MeshFileError,
    PolylineFile,
    read_polylines,
    write_polylines,
    write_vtp,
)
from study.case.demo import demo_case_path

RADIUS = "MaximumInscribedSphereRadius"
BUNDLED = demo_case_path().parent
LINES = {"ao": (1, 152), "rca": (4, 2652), "lca": (5, 2815)}


def branched() -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """A line along an aorta of radius 14 mm, then two branches of radius 2 mm; in mm."""
    z = np.linspace(0.0, 40.0, 81)
    trunk = np.stack([0.0 * z, 0.0 * z, 40.0 - z], axis=1)
    x = np.linspace(0.5, 90.0, 180)
    first = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
    second = np.stack([x[:60], 0.4 * x[:60], 0.0 * x[:60]], axis=1)
    points = np.concatenate([trunk, first, second])
    radius = np.concatenate([np.full(81, 14.0), np.maximum(14.0 - x, 2.0), np.full(60, 2.0)])
    lines = [np.r_[0:81, 261:321], np.r_[0:81, 81:261]]
    return points, lines, radius


def test_branches_radii_and_further_data_survive_the_round_trip(tmp_path):
    points, lines, radius = branched()
    path = tmp_path / "lines.vtp"
    write_polylines(
        path, points, lines, point_data={RADIUS: radius}, cell_data={"GroupIds": np.array([3, 4])}
    )
    found = read_polylines(path)
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_array_equal(found.radius, radius)
    np.testing.assert_array_equal(found.cell_data["GroupIds"], [3, 4])
    assert [line.tolist() for line in found.lines] == [line.tolist() for line in lines]


@pytest.mark.parametrize("name", LINES)
def test_centre_lines_of_a_patient_survive_the_round_trip(shared_data, tmp_path, name):
    path = shared_data / "aaoca_ct" / f"{name}_cl.vtp"
    if not path.is_file():
        pytest.skip("centre lines of the bundled patient (aaoca_ct) are not here")
    found = read_polylines(path)
    assert (len(found.lines), len(found.points)) == LINES[name]
    write_polylines(tmp_path / "again.vtp", found.points, found.lines, point_data=found.point_data)
    again = read_polylines(tmp_path / "again.vtp")
    np.testing.assert_allclose(again.points, found.points, atol=1e-6)
    np.testing.assert_allclose(again.radius, found.radius, atol=1e-6)
    for one, other in zip(again.lines, found.lines, strict=True):
        np.testing.assert_array_equal(one, other)


def test_vtk_reads_the_lines_that_are_written_and_is_read_back(tmp_path):
    vtk = pytest.importorskip("vtk", reason="VTK is not installed")
    from vtk.util.numpy_support import vtk_to_numpy

    points, lines, radius = branched()
    write_polylines(tmp_path / "ours.vtp", points, lines, point_data={RADIUS: radius})
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "ours.vtp"))
    reader.Update()
    data = reader.GetOutput()
    assert (data.GetNumberOfPoints(), data.GetNumberOfLines()) == (len(points), 2)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), points)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetArray(RADIUS)), radius)
    cell = data.GetCell(1)
    assert [cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())] == lines[1].tolist()
    for mode in ("SetDataModeToAscii", "SetDataModeToBinary", "SetDataModeToAppended"):
        writer = vtk.vtkXMLPolyDataWriter()
        writer.SetInputData(data)
        writer.SetFileName(str(tmp_path / "theirs.vtp"))
        getattr(writer, mode)()
        writer.Write()
        found = read_polylines(tmp_path / "theirs.vtp")
        np.testing.assert_allclose(found.points, points, atol=1e-6)
        np.testing.assert_allclose(found.radius, radius, atol=1e-6)
        assert [line.tolist() for line in found.lines] == [line.tolist() for line in lines]


def test_longest_branch_begins_where_it_leaves_the_aorta():
    points, lines, radius = branched()
    file = PolylineFile(points, tuple(lines), {RADIUS: radius}, {})
    found = longest_line(file)
    np.testing.assert_allclose(found[0], [14.0, 0.0, 0.0], atol=0.5)
    np.testing.assert_array_equal(found[-1], [90.0, 0.0, 0.0])
    backwards = PolylineFile(points, tuple(line[::-1] for line in lines), {RADIUS: radius}, {})
    np.testing.assert_array_equal(longest_line(backwards), found[::-1])
    bare = PolylineFile(points, tuple(lines), {}, {})
    np.testing.assert_array_equal(longest_line(bare)[0], points[0])
    narrow = PolylineFile(points[81:261], (np.arange(180),), {RADIUS: np.full(180, 2.0)}, {})
    np.testing.assert_array_equal(longest_line(narrow)[0], points[81])


def test_vtp_of_the_bundled_patient_is_the_line_that_is_bundled(shared_data):
    path = shared_data / "aaoca_ct" / "rca_cl.vtp"
    if not path.is_file():
        pytest.skip("centre lines of the bundled patient (aaoca_ct) are not here")
    found, known = read_centerline(path), read_centerline(BUNDLED / "centerline.csv")
    distance = np.linalg.norm(known[:, None] - found, axis=2).min(axis=1)
    assert np.median(distance) < 0.02  # 0.2 mm: two extractions of one CT
    # (12.9, -201.0, 1751.6) mm: where the coronary leaves the spheres of the aorta's own line
    np.testing.assert_allclose(found[0], [1.29, -20.10, 175.16], atol=0.02)


def test_anatomy_takes_a_vtp_in_place_of_a_csv(tmp_path):
    line = read_centerline(BUNDLED / "centerline.csv")
    path = tmp_path / "line.vtp"
    write_polylines(path, 10.0 * line, [np.arange(len(line))])

    def made(centerline: pathlib.Path):
        return ivus_anatomy(
            BUNDLED / "rest_diastole_contours.csv",
            centerline,
            frame_table=BUNDLED / "rest_frames.csv",
            reference=BUNDLED / "rest_diastole_reference.csv",
            aorta_radius=1.4,
        )

    one, other = made(BUNDLED / "centerline.csv"), made(path)
    np.testing.assert_allclose(
        one.centerlines["anomalous"].points, other.centerlines["anomalous"].points, atol=1e-7
    )


def test_files_that_are_no_centre_lines_are_refused(tmp_path):
    points, lines, _ = branched()
    path = tmp_path / "x.vtp"
    write_vtp(path, points, np.array([[0, 1, 90]]))
    with pytest.raises(MeshFileError, match=r"holds no lines.*surface"):
        read_centerline(path)
    write_polylines(path, points, lines)
    text = path.read_bytes()
    path.write_bytes(text[: len(text) // 2])
    with pytest.raises(MeshFileError, match="cannot be read"):
        read_centerline(path)
    with pytest.raises(MeshFileError, match="do not have one value"):
        write_polylines(path, points, lines, point_data={"r": np.ones(3)})
    with pytest.raises(MeshFileError, match="points that are not there"):
        write_polylines(path, points[:5], lines)
    write_polylines(path, 0.1 * points, lines)  # in cm
    with pytest.raises(ValueError, match=r"expected .*in mm"):
        read_centerline(path)
