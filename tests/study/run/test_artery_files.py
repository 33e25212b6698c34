"""Files that other programs open: along the artery, and the lumen with colours."""

import csv
import io

import numpy as np
import pytest
import trimesh

from jaxfsi.fields.artery_profile import ArteryProfile
from jaxfsi.mesh import INTERFACE
from jaxfsi.mesh_files import read_polylines
from jaxfsi.meshing import tube
from study.run.artery_files import coloured_lumen, write_profile


@pytest.fixture(scope="module")
def given():
    mesh = tube(radius=0.2, length=2.0, thickness=0.05, n_around=12, n_axial=8, n_layers=1)
    s = np.linspace(0.0, 2.0, 11)
    n = np.full(11, 1.0)
    P = 90.0 - 9.0 * s
    P[4] = np.nan
    profile = ArteryProfile(
        s=s, points=np.stack([0.0 * s, 0.0 * s, s], axis=1), P=P, P_aorta=90.0, area=0.12 * n,
        least_area=0.08 * n, least_minor=0.2 * n, image_area=0.1 * n, image_minor=0.25 * n,
        moved=np.zeros_like(mesh.points), P_nodes=90.0 - 9.0 * mesh.points[:, 2],
    )  # fmt: skip
    return mesh, profile


def test_axis_and_table_hold_the_same_numbers(given, tmp_path):
    _, profile = given
    write_profile(tmp_path, profile)
    rows = list(csv.DictReader(io.StringIO((tmp_path / "pullback.csv").read_text())))
    assert rows[4]["ratio"] == ""
    assert float(rows[-1]["ratio"]) == pytest.approx(0.8)
    assert float(rows[-1]["distance_mm"]) == pytest.approx(20.0)
    assert float(rows[0]["least_area_mm2"]) == pytest.approx(8.0)
    file = read_polylines(tmp_path / "centerline.vtp")
    np.testing.assert_allclose(file.points[-1], [0.0, 0.0, 20.0])
    np.testing.assert_allclose(file.point_data["ratio"], profile.ratio)
    assert set(rows[0]) == set(file.point_data)


def test_vtk_shows_the_ratio_on_the_axis(given, tmp_path):
    vtk = pytest.importorskip("vtk", reason="VTK is not installed")
    from vtk.util.numpy_support import vtk_to_numpy

    _, profile = given
    write_profile(tmp_path, profile)
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "centerline.vtp"))
    reader.Update()
    data = reader.GetOutput()
    assert (data.GetNumberOfLines(), data.GetNumberOfPoints()) == (1, 11)
    ratio = vtk_to_numpy(data.GetPointData().GetArray("ratio"))
    np.testing.assert_array_equal(ratio, profile.ratio)
    area = vtk_to_numpy(data.GetPointData().GetArray("least_minor_axis_mm"))
    np.testing.assert_allclose(area, 2.0)


def test_lumen_is_coloured_by_the_ratio_in_metres(given):
    mesh, profile = given
    scene = trimesh.load(io.BytesIO(coloured_lumen(mesh, profile)), file_type="glb")
    (surface,) = scene.geometry.values()
    assert len(surface.faces) == len(mesh.labelled(INTERFACE))
    np.testing.assert_allclose(np.ptp(surface.vertices[:, 2]), 0.02, rtol=1e-6)
    colours = np.asarray(surface.visual.vertex_colors, float)
    start = colours[surface.vertices[:, 2] < 1e-9]
    end = colours[surface.vertices[:, 2] > 0.02 - 1e-9]
    np.testing.assert_array_equal(start[:, :3], np.tile([33, 102, 172], (len(start), 1)))
    assert np.all(end[:, 0] > end[:, 2])  # red where the pressure is least
