"""Axes of patients' coordinates: files that state theirs agree, and a mismatch is told."""

import json
import pathlib
import re

import numpy as np
import pytest
import trimesh

from jaxfsi.anatomy import opening_points, read_centerline, read_triangles, surface_anatomy
from jaxfsi.mesh_files import (
    MeshFileError,
    read_markups,
    stated_axes,
    turned,
    write_polylines,
    write_vtp,
)
from study import CaseError, read_case
from study.run.anatomy_source import case_anatomy
from study.store.case_inputs import input_files
from study.store.meshes import mesh_key

TURN = np.array([-1.0, -1.0, 1.0])
MIDDLE = np.array([3.0, -8.0, 100.0])
"""Where the vessel begins, off the axis [mm]."""


def vessel() -> trimesh.Trimesh:
    """An open tube of radius 2 mm and length 30 mm, in LPS."""
    n, layers = 24, 30
    theta = 2.0 * np.pi * np.arange(n) / n
    ring = np.stack([2.0 * np.cos(theta), 2.0 * np.sin(theta)], axis=1)
    z = np.linspace(0.0, 30.0, layers + 1)
    points = np.concatenate([np.column_stack([ring, np.full(n, h)]) for h in z]) + MIDDLE
    i = np.arange(n)
    low = (n * np.arange(layers)[:, None] + i).ravel()
    right = (n * np.arange(layers)[:, None] + (i + 1) % n).ravel()
    faces = np.concatenate(
        [np.stack([low, right, right + n], axis=1), np.stack([low, right + n, low + n], axis=1)]
    )
    return trimesh.Trimesh(points, faces, process=False)


def binary_stl(path: pathlib.Path, mesh: trimesh.Trimesh, header: str) -> pathlib.Path:
    data = mesh.export(file_type="stl")
    path.write_bytes(header.encode().ljust(80, b" ") + data[80:])
    return path


def markups(path: pathlib.Path, axes: str | None, **points: np.ndarray) -> pathlib.Path:
    control = [{"label": name, "position": list(map(float, p))} for name, p in points.items()]
    entry = {"type": "Fiducial", "coordinateUnits": "mm", "controlPoints": control}
    if axes is not None:
        entry["coordinateSystem"] = axes
    path.write_text(json.dumps({"markups": [entry]}))
    return path


def curve(path: pathlib.Path, points: np.ndarray, axes: str) -> pathlib.Path:
    control = [{"label": f"C-{k}", "position": p.tolist()} for k, p in enumerate(points)]
    entry = {"type": "Curve", "coordinateSystem": axes, "controlPoints": control}
    path.write_text(json.dumps({"markups": [entry]}))
    return path


ENDS = {"inlet": MIDDLE, "outlet": MIDDLE + np.array([0.0, 0.0, 30.0])}


def test_headers_of_every_format_are_read(tmp_path):
    mesh = vessel()
    assert stated_axes(binary_stl(tmp_path / "a.stl", mesh, "3D Slicer output. SPACE=LPS")) == "LPS"
    assert stated_axes(binary_stl(tmp_path / "b.stl", mesh, "made by hand")) is None
    text = mesh.export(file_type="stl_ascii").replace("solid", "solid SPACE=RAS", 1)
    (tmp_path / "c.stl").write_text(text)
    assert stated_axes(tmp_path / "c.stl") == "RAS"
    ply = mesh.export(file_type="ply").replace(b"\nelement", b"\ncomment SPACE=LPS\nelement", 1)
    (tmp_path / "d.ply").write_bytes(ply)
    assert stated_axes(tmp_path / "d.ply") == "LPS"
    np.testing.assert_allclose(read_triangles(tmp_path / "d.ply").points, mesh.vertices, atol=1e-5)
    write_vtp(tmp_path / "e.vtp", mesh.vertices, mesh.faces)
    assert stated_axes(tmp_path / "e.vtp") is None
    binary_stl(tmp_path / "f.stl", mesh, "SPACE=LAS")
    with pytest.raises(MeshFileError, match=r"'LAS', which are not known"):
        stated_axes(tmp_path / "f.stl")


def test_field_that_vtk_writes_is_read(tmp_path):
    vtk = pytest.importorskip("vtk", reason="VTK is not installed")
    mesh = vessel()
    write_vtp(tmp_path / "plain.vtp", mesh.vertices, mesh.faces)
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "plain.vtp"))
    reader.Update()
    data = reader.GetOutput()
    space = vtk.vtkStringArray()
    space.SetName("SPACE")
    space.InsertNextValue("RAS")
    data.GetFieldData().AddArray(space)
    for mode in ("SetDataModeToAscii", "SetDataModeToBinary", "SetDataModeToAppended"):
        writer = vtk.vtkXMLPolyDataWriter()
        writer.SetInputData(data)
        writer.SetFileName(str(tmp_path / "said.vtp"))
        getattr(writer, mode)()
        writer.Write()
        assert stated_axes(tmp_path / "said.vtp") == "RAS"
        np.testing.assert_array_equal(read_triangles(tmp_path / "said.vtp").faces, mesh.faces)


def test_surface_in_lps_and_centre_line_in_ras_agree_after_conversion(tmp_path):
    mesh = vessel()
    surface = binary_stl(tmp_path / "lumen.stl", mesh, "SPACE=LPS")
    z = np.linspace(0.0, 30.0, 13)
    line = MIDDLE + np.stack([np.sin(z / 8.0), 0.0 * z, z], axis=1)
    path = curve(tmp_path / "line.mrk.json", line * TURN, "RAS")
    points = read_centerline(path, axes="LPS")
    np.testing.assert_allclose(points[[0, -1]], 0.1 * line[[0, -1]], atol=1e-9)
    corners = 0.1 * read_triangles(surface).points
    distance = np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1)
    assert np.all(distance < 0.31)  # within a lumen of radius 2 mm, 1 mm beside its axis
    astray = np.linalg.norm(read_centerline(path)[:, None] - corners, axis=2).min(axis=1)
    assert np.all(astray > 1.0)  # as it stands the line lies 17 mm away
    # the curve runs through its control points, half a millimetre a step
    s = np.linspace(0.0, 30.0, 301)
    known = 0.1 * (MIDDLE + np.stack([np.sin(s / 8.0), 0.0 * s, s], axis=1))
    off = np.linalg.norm(points[:, None] - known, axis=2).min(axis=1)
    assert off.max() < 0.006
    assert 0.03 < np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.06


def test_surface_that_states_other_axes_is_turned_and_that_is_told(tmp_path):
    mesh = vessel()
    lps = binary_stl(tmp_path / "lps.stl", mesh, "SPACE=LPS")
    names = {name: point * TURN for name, point in ENDS.items()}
    made = surface_anatomy(lps, unit="mm", names=names, axes="RAS")
    assert "was turned to RAS" in made.meta["notes"][0]
    for opening in made.openings:
        np.testing.assert_allclose(opening.centre, 0.1 * ENDS[opening.name] * TURN, atol=0.01)
    same = surface_anatomy(lps, unit="mm", names=ENDS, axes="LPS")
    assert "notes" not in same.meta
    plain = binary_stl(tmp_path / "plain.stl", mesh, "")
    with pytest.raises(ValueError, match=r"signs of x and y.*LPS.*RAS"):
        surface_anatomy(plain, unit="mm", names=names)


def case_of(folder: pathlib.Path, table: str) -> pathlib.Path:
    path = folder / "case.toml"
    path.write_text(f'[patient]\nid = "p"\n[anatomy]\nkind = "surface"\nunit = "mm"\n{table}')
    return path


def test_points_of_slicer_name_the_openings_of_a_case(tmp_path):
    binary_stl(tmp_path / "lumen.stl", vessel(), "SPACE=LPS")
    ras = {name: point * TURN for name, point in ENDS.items()}
    markups(tmp_path / "ends.mrk.json", "RAS", **ras)
    table = 'surface = "lumen.stl"\nopenings_file = "ends.mrk.json"\n'
    case = read_case(case_of(tmp_path, table))
    assert tmp_path / "ends.mrk.json" in input_files(case)
    anatomy = case_anatomy(case)
    for opening in anatomy.openings:
        np.testing.assert_allclose(opening.centre, 0.1 * ENDS[opening.name], atol=0.01)
    before = mesh_key(case, "surface")
    markups(tmp_path / "ends.mrk.json", "LPS", **ENDS)
    assert mesh_key(case, "surface") != before
    other = read_case(case_of(tmp_path, f'{table}axes = "RAS"\n'))
    assert mesh_key(other, "surface") != mesh_key(case, "surface")


def test_points_without_axes_of_the_surface_are_refused(tmp_path):
    binary_stl(tmp_path / "lumen.stl", vessel(), "")
    markups(tmp_path / "ends.mrk.json", "RAS", **ENDS)
    table = 'surface = "lumen.stl"\nopenings_file = "ends.mrk.json"\n'
    with pytest.raises(CaseError, match=r"nothing says the axes(.|\n)*axes = .RAS."):
        case_anatomy(read_case(case_of(tmp_path, table)))
    both = f"{table}[anatomy.openings]\ninlet = [3.0, -8.0, 100.0]\n"
    with pytest.raises(CaseError, match="given as well"):
        read_case(case_of(tmp_path, both))
    with pytest.raises(CaseError, match="LPS"):
        read_case(case_of(tmp_path, f'{table}axes = "LAS"\n'))


def test_faulty_markups_are_refused(tmp_path):
    path = tmp_path / "x.mrk.json"
    markups(path, None, **ENDS)
    with pytest.raises(MeshFileError, match="neither LPS nor RAS"):
        read_markups(path)
    markups(path, "LPS")
    with pytest.raises(MeshFileError, match="holds no points"):
        read_markups(path)
    for text in ("", "{", "[]", '{"markups": [3]}', '{"markups": 3}'):
        path.write_text(text)
        with pytest.raises(MeshFileError, match=re.escape(path.name)):
            read_markups(path)
    markups(path, "LPS", **{"my end": MIDDLE})
    with pytest.raises(ValueError, match="cannot name an end"):
        opening_points(path, unit="mm", axes="LPS")


def test_centre_line_that_states_its_axes_is_turned(tmp_path):
    line = MIDDLE + np.stack([np.zeros(60), np.zeros(60), np.linspace(0.0, 30.0, 60)], axis=1)
    write_polylines(tmp_path / "x.vtp", line, [np.arange(60)])
    np.testing.assert_array_equal(
        read_centerline(tmp_path / "x.vtp", axes="RAS"), read_centerline(tmp_path / "x.vtp")
    )
    np.testing.assert_array_equal(turned(line, "LPS", "RAS"), line * TURN)
    np.testing.assert_array_equal(turned(turned(line, "LPS", "RAS"), "RAS", "LPS"), line)
