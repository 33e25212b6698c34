import dataclasses
import importlib.util
import json
import pathlib

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from jaxfsi.anatomy import Opening
from jaxfsi.faces import face_table, region_faces
from jaxfsi.mesh import Mesh, Region, tet_volumes
from jaxfsi.mesh_files import (
    read_mesh,
    read_mesh_complete,
    read_msh,
    read_vtu,
    write_mesh,
    write_mesh_complete,
    write_vtu,
)
from jaxfsi.mesh_files.lengths import check_unit
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_parts import reordered, scaled
from jaxfsi.meshing import check_topology, labelled_mesh, tube

FORMATS = ["vtu", "msh", "xdmf"]
FEW = settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def walled() -> Mesh:
    mesh = tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    meta: dict[str, object] = {"state": "rest", "radius_cm": 0.1 + 0.2, "counts": [12, 6]}
    return dataclasses.replace(mesh, meta=meta)


def random_tets(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, size=(int(rng.integers(8, 40)), 3)) * 10.0 ** rng.uniform(0, 1)
    tets = Delaunay(points).simplices.astype(np.int64)
    negative = tet_volumes(points, tets) < 0.0
    tets[negative] = tets[negative][:, [1, 0, 2, 3]]
    tets = tets[tet_volumes(points, tets) > 0.0]
    return points, tets, rng.integers(0, 2, size=len(tets))


def random_mesh(seed: int) -> Mesh:
    """Any regions, any labels on any faces, any node ids, names with blanks and accents."""
    rng = np.random.default_rng(seed)
    points, tets, region = random_tets(seed)
    faces = face_table(tets).nodes
    faces = faces[rng.permutation(len(faces))[: rng.integers(0, len(faces))]]
    names = ("interface", "a b", "é", "outer_wall")
    ids = rng.permutation(10**6)[: len(points)] if seed % 2 else None
    return Mesh(
        points, tets, region, faces, rng.integers(0, 4, len(faces)), names, ids, {"seed": seed}
    )


def assert_same(mesh: Mesh, other: Mesh) -> None:
    for field in dataclasses.fields(Mesh):
        one, two = getattr(mesh, field.name), getattr(other, field.name)
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, two), field.name
        else:
            assert one == two, field.name


@pytest.mark.parametrize("ending", FORMATS)
@given(seed=st.integers(0, 10**6))
@FEW
def test_any_mesh_survives_the_round_trip(tmp_path, ending, seed):
    mesh = random_mesh(seed)
    path = tmp_path / f"mesh.{ending}"
    write_mesh(path, mesh, unit="cm")
    assert_same(mesh, read_mesh(path, unit="cm", damaged=True))


@given(seed=st.integers(0, 10**6))
@FEW
def test_any_labelled_mesh_survives_as_folders(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("complete")
    points, tets, region = random_tets(seed)
    region[:2] = [0, 1]
    bounds = region_faces(tets, region)
    labels = {"cap 1": bounds.fluid[::2], "cap 2": bounds.fluid[1::2]}
    labels |= {"interface": bounds.interface, "outer_wall": bounds.solid}
    used = np.unique(tets)
    assume(len(used) == len(points))
    mesh = labelled_mesh(points, tets, region, labels)
    if seed % 2:
        mesh = reordered(dataclasses.replace(mesh, meta={"seed": seed}))
    write_mesh_complete(folder / "fluid", folder / "solid", mesh, unit="cm")
    folders = folder / "fluid", folder / "solid"
    assert_same(mesh, read_mesh_complete(*folders, unit="cm", damaged=True))


@pytest.mark.parametrize("ending", FORMATS)
def test_a_vessel_survives_the_round_trip(tmp_path, walled, ending):
    path = tmp_path / f"tube.{ending}"
    for mesh in (walled, reordered(walled)):
        write_mesh(path, mesh, unit="cm")
        assert_same(mesh, read_mesh(path, unit="cm"))
        write_mesh(tmp_path / f"mm.{ending}", mesh, unit="mm")
        again = read_mesh(tmp_path / f"mm.{ending}", unit="mm")
        # One division and one multiplication by 0.1.
        np.testing.assert_allclose(again.points, mesh.points, rtol=4e-16, atol=0.0)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("ending", FORMATS)
def test_the_unit_of_a_file_must_be_declared_right(tmp_path, walled, ending):
    path = tmp_path / f"tube.{ending}"
    write_mesh(path, walled, unit="mm")
    with pytest.raises(ValueError, match=r"lengths are in mm.*Declare unit='mm'"):
        read_mesh(path, unit="cm")
    with pytest.raises(ValueError, match="unit='cm' or unit='mm'"):
        check_unit("inch")


def test_a_wrong_unit_names_both_readings(tmp_path, walled):
    long = scaled(walled, 5.0)
    write_vtu(tmp_path / "tube.vtu", long, unit="mm")
    (tmp_path / "tube.json").unlink()
    with pytest.raises(ValueError, match="100 cm if in cm, 10 cm if in mm"):
        read_vtu(tmp_path / "tube.vtu", unit="cm")
    assert read_vtu(tmp_path / "tube.vtu", unit="mm").openings == ("opening_1", "opening_2")
    small = scaled(walled, 0.1)
    with pytest.raises(ValueError, match=r"0\.3 to 40 cm"):
        write_vtu(tmp_path / "small.vtu", small, unit="cm")
    write_vtu(tmp_path / "small.vtu", small, unit="cm", any_size=True)
    assert_same(small, read_vtu(tmp_path / "small.vtu", unit="cm", any_size=True))


@pytest.mark.parametrize("ending", FORMATS)
def test_a_file_cut_off_anywhere_is_refused(tmp_path, walled, ending):
    path = tmp_path / f"tube.{ending}"
    write_mesh(path, walled, unit="cm")
    whole = path.read_bytes()
    # The last line of an xdmf or vtu file closes its root; of an msh file, its elements.
    for size in np.linspace(0, len(whole) - 15, 40).astype(int):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"tube\."):
            read_mesh(path, unit="cm")


@pytest.mark.parametrize("ending", FORMATS)
def test_other_files_are_refused(tmp_path, ending):
    path = tmp_path / f"other.{ending}"
    for content in (
        b"",
        b"solid\n",
        b"\x00" * 500,
        b"<VTKFile/>",
        b"$MeshFormat\n$EndMeshFormat\n",
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"other\."):
            read_mesh(path, unit="cm")
    path.unlink()
    with pytest.raises(ValueError, match="there is no file"):
        read_mesh(path, unit="cm")
    with pytest.raises(ValueError, match="ends in none of"):
        read_mesh(tmp_path / "mesh.stl", unit="cm")


@pytest.mark.parametrize("ending", FORMATS)
def test_labels_of_any_file_can_be_renamed(tmp_path, walled, ending):
    path = tmp_path / f"tube.{ending}"
    write_mesh(path, walled, unit="cm")
    mesh = read_mesh(path, unit="cm", labels={"inlet": "aorta_inlet"})
    names = [name.replace("inlet", "aorta_inlet") for name in walled.label_names]
    assert "aorta_inlet_ring" in names
    assert_same(mesh, dataclasses.replace(walled, label_names=tuple(names)))
    joined = read_mesh(path, unit="cm", labels={"inlet": "port", "outlet": "port"})
    assert joined.openings == ("port",)
    assert len(joined.labelled("port")) == sum(len(walled.labelled(n)) for n in walled.openings)
    with pytest.raises(ValueError, match=r"no label 'nope'; there are inlet, outlet, interface"):
        read_mesh(path, unit="cm", labels={"nope": "aorta_inlet"})
    for old, new in (("interface", "inlet"), ("inlet", "interface")):
        with pytest.raises(ValueError, match=f"{old!r} cannot become {new!r}"):
            read_mesh(path, unit="cm", labels={old: new})


def test_openings_of_a_file_without_labels_can_be_named(tmp_path, walled):
    path = tmp_path / "tube.vtu"
    write_vtu(path, walled, unit="cm")
    path.with_suffix(".json").unlink()
    mesh = read_mesh(path, unit="cm", labels={"opening_1": "a", "opening_2": "b"})
    assert set(mesh.label_names) == {"a", "b", "interface", "outer_wall", "a_ring", "b_ring"}


@pytest.mark.parametrize("ending", FORMATS)
def test_coordinates_that_are_no_numbers_are_counted(tmp_path, walled, ending):
    mesh = dataclasses.replace(walled, points=walled.points.copy())
    # after the mesh was checked
    mesh.points[3, 1], mesh.points[4, 0] = np.nan, np.inf
    path = tmp_path / f"tube.{ending}"
    write_mesh(path, mesh, unit="cm", any_size=True)
    with pytest.raises(
        ValueError, match=rf"tube\.{ending} has coordinates .* 2 of {mesh.points.size}\."
    ):
        read_mesh(path, unit="cm")


def test_xdmf_without_its_package_or_arrays_says_so(tmp_path, walled, monkeypatch):
    path = tmp_path / "tube.xdmf"
    write_mesh(path, walled, unit="cm")
    (tmp_path / "tube.h5").write_bytes(b"")
    with pytest.raises(ValueError, match=r"tube\.xdmf cannot be read"):
        read_mesh(path, unit="cm")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="need the package h5py"):
        read_mesh(path, unit="cm")


@pytest.mark.parametrize("name", ["region", "label"])
def test_data_of_several_numbers_a_cell_are_refused(tmp_path, walled, name):
    path = tmp_path / "tube.vtu"
    write_vtu(path, walled, unit="cm")
    file = meshio.read(path)
    file.cell_data[name] = [np.stack([values] * 3, axis=1) for values in file.cell_data[name]]
    file.write(path)
    with pytest.raises(MeshFileError, match=rf"'{name}' of .*tube\.vtu.* one whole number each"):
        read_vtu(path, unit="cm")


def test_another_programs_json_is_not_overwritten(tmp_path, walled):
    other = tmp_path / "tube.json"
    other.write_text('{"name": "c10k"}', encoding="utf-8")
    with pytest.raises(ValueError, match="in the way"):
        write_vtu(tmp_path / "tube.vtu", walled, unit="cm")
    assert json.loads(other.read_text(encoding="utf-8")) == {"name": "c10k"}
    assert [path.name for path in tmp_path.iterdir()] == ["tube.json"]


def test_a_spoilt_side_entry_is_refused(tmp_path, walled):
    write_vtu(tmp_path / "tube.vtu", walled, unit="cm")
    entry = tmp_path / "tube.json"
    table = json.loads(entry.read_text(encoding="utf-8"))
    for spoilt in ("{", json.dumps(table | {"tube.vtu": {"unit": "cm"}}), ""):
        entry.write_text(spoilt, encoding="utf-8")
        with pytest.raises(ValueError, match=r"tube\.json"):
            read_vtu(tmp_path / "tube.vtu", unit="cm")
    table["tube.vtu"]["label_names"] = ["inlet"]
    entry.write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(ValueError, match="there are 1 label names"):
        read_vtu(tmp_path / "tube.vtu", unit="cm")


def test_meta_that_json_cannot_hold_are_refused(tmp_path, walled):
    for value in (np.nan, object()):
        mesh = dataclasses.replace(walled, meta={"x": value})
        with pytest.raises(ValueError, match="meta of the mesh cannot be written"):
            write_vtu(tmp_path / "tube.vtu", mesh, unit="cm")
    assert not list(tmp_path.iterdir())


def test_blood_without_labels_needs_openings(tmp_path):
    blood = tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=0)
    path = tmp_path / "blood.vtu"
    write_vtu(path, blood, unit="cm")
    (tmp_path / "blood.json").unlink()
    with pytest.raises(ValueError, match="give their planes to the reader"):
        read_vtu(path, unit="cm")
    openings = (Opening("inlet", 0.0 * UP, -UP, 0.6), Opening("outlet", 2.0 * UP, UP, 0.6))
    mesh = read_vtu(path, unit="cm", openings=openings)
    assert mesh.label_names == ("inlet", "outlet", "interface")


def test_stored_meshes_are_read(shared_data):
    openings = (Opening("inlet", 0.0 * UP, -UP, 0.6), Opening("outlet", 5.0 * UP, UP, 0.6))
    mesh = read_vtu(shared_data / "rigid_rcr" / "rigid_r10k.vtu", unit="cm", openings=openings)
    stated = json.loads((shared_data / "rigid_rcr" / "rigid_r10k.json").read_text())
    report = check_topology(mesh)
    assert report.faults == ()
    # Round-off of a sum over 1e4 tetrahedra.
    assert report.volume["fluid"] == pytest.approx(stated["vol"], rel=1e-12)
    assert len(mesh.labelled("inlet")) == stated["faces"]["start"]
    wave = np.load(shared_data / "tube_wave" / "wave_c10k.npz")
    tube_wave = read_vtu(shared_data / "tube_wave" / "tube_c10k.vtu", unit="cm")
    assert np.array_equal(tube_wave.points, wave["points"])
    assert np.array_equal(tube_wave.tets, wave["tets"])
    assert np.array_equal(tube_wave.region, wave["region"])


GMSH_41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
2 7 "inflow"
3 1 "blood"
3 2 "tissue"
$EndPhysicalNames
$Entities
0 0 2 2
1 0 0 0 1 1 1 1 7 0
2 0 0 0 1 1 1 0 0
1 0 0 0 1 1 1 1 1 0
2 0 0 0 1 1 1 1 2 0
$EndEntities
$Nodes
1 6 2 20
3 1 0 6
2
4
6
8
10
20
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
9 9 9
$EndNodes
$Elements
3 3 1 3
2 1 2 1
1 2 4 6
3 1 4 1
2 2 4 6 8
3 2 4 1
3 4 6 8 10
$EndElements
"""


def test_gmsh_41_files_are_read_through_their_groups(tmp_path):
    path = tmp_path / "two.msh"
    path.write_text(GMSH_41, encoding="ascii")
    with pytest.raises(ValueError, match=r"volume groups .* are blood, tissue"):
        read_msh(path, unit="cm")
    regions = {"blood": Region.FLUID, "tissue": Region.SOLID}
    with pytest.raises(ValueError, match="Name every opening"):
        read_msh(path, unit="cm", regions=regions)
    # With every outer face of the blood in the group.
    faces = "2 1 2 3\n1 2 4 6\n2 2 6 8\n3 2 4 8\n"
    whole = GMSH_41.replace("2 1 2 1\n1 2 4 6\n", faces).replace("3 3 1 3\n", "3 5 1 5\n")
    path.write_text(whole, encoding="ascii")
    mesh = read_msh(path, unit="cm", regions=regions, labels={"inflow": "inlet"})
    assert mesh.label_names == ("inlet", "interface", "outer_wall")
    assert [len(mesh.labelled(name)) for name in mesh.label_names] == [3, 1, 3]
    # The node far out belongs to no tetrahedron.
    assert len(mesh.points) == 5
    with pytest.raises(ValueError, match="no surface group 'exit'"):
        read_msh(path, unit="cm", regions=regions, labels={"exit": "outlet"})


def test_msh_of_others_needs_groups_and_linear_tetrahedra(tmp_path, walled):
    path = tmp_path / "two.msh"
    bare = GMSH_41.replace("1 0 0 0 1 1 1 1 1 0", "1 0 0 0 1 1 1 0 0")
    bare = bare.replace("2 0 0 0 1 1 1 1 2 0", "2 0 0 0 1 1 1 0 0")
    path.write_text(bare.replace("1 0 0 0 1 1 1 1 7 0", "1 0 0 0 1 1 1 0 0"), encoding="ascii")
    with pytest.raises(ValueError, match=r"physical groups|volume groups"):
        read_msh(path, unit="cm")
    clash = dataclasses.replace(walled, label_names=("fluid", *walled.label_names[1:]))
    with pytest.raises(ValueError, match="name of a region"):
        write_mesh(path, clash, unit="cm")


def test_gmsh_opens_what_is_written(tmp_path, walled):
    gmsh = pytest.importorskip("gmsh")
    write_mesh(tmp_path / "tube.msh", walled, unit="cm")
    gmsh.initialize()
    try:
        gmsh.open(str(tmp_path / "tube.msh"))
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
    finally:
        gmsh.finalize()
    assert names >= {"fluid", "solid", *walled.label_names}


def test_an_interrupted_write_leaves_the_old_file(tmp_path, walled, monkeypatch):
    path = tmp_path / "tube.vtu"
    write_vtu(path, walled, unit="cm")
    before = path.read_bytes()

    def full_disk(*args: object) -> None:
        pathlib.Path(str(args[0])).write_bytes(b"half")
        raise OSError("no space left")

    monkeypatch.setattr("meshio.vtu.write", full_disk)
    with pytest.raises(OSError, match="no space left"):
        write_vtu(path, reordered(walled), unit="cm")
    assert path.read_bytes() == before
    assert {entry.name for entry in tmp_path.iterdir()} == {"tube.vtu", "tube.json"}
