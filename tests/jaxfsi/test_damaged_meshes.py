"""Meshes in files with one thing wrong: each is refused in every format, with its place."""

import dataclasses
import pathlib
from collections.abc import Callable

import meshio
import numpy as np
import pytest

from jaxfsi.faces import face_table
from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_files import read_mesh, read_mesh_complete, write_mesh, write_mesh_complete
from jaxfsi.mesh_files.complete_folder import write_folder
from jaxfsi.meshing import check_topology, tube

N_TETS = 720
FORMATS = ("vtu", "msh", "xdmf", "folder")


@pytest.fixture(scope="module")
def walled() -> Mesh:
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=10, n_axial=4, n_layers=2)


def store(folder: pathlib.Path, mesh: Mesh, ending: str) -> pathlib.Path:
    """Write a mesh without looking at it."""
    path = folder / f"tube.{ending}"
    if ending == "folder":
        path.mkdir()
        for region, name in ((Region.FLUID, "fluid"), (Region.SOLID, "solid")):
            write_folder(path / name, mesh, region, "cm", any_size=True)
    else:
        write_mesh(path, mesh, unit="cm", any_size=True)
    return path


def load(path: pathlib.Path, *, damaged: bool = False) -> Mesh:
    if path.is_dir():
        return read_mesh_complete(path / "fluid", path / "solid", unit="cm", damaged=damaged)
    return read_mesh(path, unit="cm", damaged=damaged)


def inner_tet(mesh: Mesh, region: Region = Region.FLUID) -> int:
    """A tetrahedron without a labelled face."""
    table = face_table(mesh.tets)
    outside = (table.second < 0) | (mesh.region[table.first] != mesh.region[table.second])
    at_labels = np.zeros(len(mesh.tets), dtype=bool)
    at_labels[table.first[outside]] = True
    at_labels[table.second[outside & (table.second >= 0)]] = True
    return int(np.flatnonzero(~at_labels & (mesh.region == region))[0])


def with_tets(
    mesh: Mesh,
    tets: np.ndarray,
    region: np.ndarray | None = None,
    points: np.ndarray | None = None,
) -> Mesh:
    region = mesh.region if region is None else region
    points = mesh.points if points is None else points
    return dataclasses.replace(mesh, tets=tets, region=region, points=points)


def inverted(mesh: Mesh) -> Mesh:
    tets, i = mesh.tets.copy(), inner_tet(mesh)
    tets[i] = tets[i][[1, 0, 2, 3]]
    return with_tets(mesh, tets)


def all_inverted(mesh: Mesh) -> Mesh:
    return with_tets(mesh, mesh.tets[:, [1, 0, 2, 3]])


def flat(mesh: Mesh) -> Mesh:
    """One node of an inner tetrahedron moved into the opposite face."""
    points, tet = mesh.points.copy(), mesh.tets[inner_tet(mesh)]
    points[tet[0]] = points[tet[1:]].mean(axis=0)
    return dataclasses.replace(mesh, points=points)


def collapsed(mesh: Mesh) -> Mesh:
    """One tetrahedron names a node twice."""
    tets, i = mesh.tets.copy(), inner_tet(mesh)
    tets[i, 1] = tets[i, 0]
    return with_tets(mesh, tets)


def hollow(mesh: Mesh, region: Region = Region.FLUID) -> Mesh:
    kept = np.arange(len(mesh.tets)) != inner_tet(mesh, region)
    return with_tets(mesh, mesh.tets[kept], mesh.region[kept])


def dented(mesh: Mesh) -> Mesh:
    """A tetrahedron of the wall at its outside is missing."""
    table = face_table(mesh.tets)
    solid = table.on_boundary & (mesh.region[table.first] == Region.SOLID)
    kept = np.arange(len(mesh.tets)) != table.first[np.flatnonzero(solid)[40]]
    return with_tets(mesh, mesh.tets[kept], mesh.region[kept])


def double(mesh: Mesh) -> Mesh:
    i = inner_tet(mesh)
    tets = np.concatenate([mesh.tets, mesh.tets[i : i + 1]])
    return with_tets(mesh, tets, np.append(mesh.region, mesh.region[i]))


def crowded(mesh: Mesh) -> Mesh:
    """A third tetrahedron on an inner face."""
    tet = mesh.tets[inner_tet(mesh)]
    points = np.concatenate([mesh.points, mesh.points[tet].mean(axis=0)[None]])
    tets = np.concatenate([mesh.tets, [[*tet[:3], len(mesh.points)]]])
    return with_tets(mesh, tets, np.append(mesh.region, 0), points)


def folded(mesh: Mesh) -> Mesh:
    """A boundary tetrahedron copied onto its neighbour's side of a face."""
    table = face_table(mesh.tets)
    at = int(np.flatnonzero(table.on_boundary & (mesh.region[table.first] == Region.FLUID))[0])
    face = table.nodes[at]
    inside = mesh.points[mesh.tets[table.first[at]]].mean(axis=0)
    points = np.concatenate([mesh.points, inside[None]])
    tets = np.concatenate([mesh.tets, [[*face[::-1], len(mesh.points)]]])
    return with_tets(mesh, tets, np.append(mesh.region, 0), points)


def in_pieces(mesh: Mesh, chosen: Region | None = None) -> Mesh:
    """All of the mesh, or one region of it, a second time beside itself."""
    kept = np.ones(len(mesh.tets), dtype=bool) if chosen is None else mesh.region == chosen
    n = len(mesh.points)
    return dataclasses.replace(
        mesh,
        points=np.concatenate([mesh.points, mesh.points + np.array([3.0, 0.0, 0.0])]),
        tets=np.concatenate([mesh.tets, n + mesh.tets[kept]]),
        region=np.concatenate([mesh.region, mesh.region[kept]]),
        faces=np.concatenate([mesh.faces, n + mesh.faces]),
        face_label=np.concatenate([mesh.face_label, mesh.face_label]),
    )


def torn(mesh: Mesh) -> Mesh:
    """An inner node is there twice; some of its tetrahedra use the copy."""
    tets = mesh.tets.copy()
    node = int(np.argmin(np.linalg.norm(mesh.points - np.array([0.0, 0.0, 1.0]), axis=1)))
    mine = np.flatnonzero(np.any(tets == node, axis=1))[::2]
    tets[mine] = np.where(tets[mine] == node, len(mesh.points), tets[mine])
    points = np.concatenate([mesh.points, mesh.points[node : node + 1]])
    return with_tets(mesh, tets, points=points)


def unlabelled(mesh: Mesh) -> Mesh:
    return dataclasses.replace(mesh, faces=mesh.faces[1:], face_label=mesh.face_label[1:])


def label_inside(mesh: Mesh) -> Mesh:
    inner = mesh.tets[inner_tet(mesh)][None, :3]
    return dataclasses.replace(
        mesh,
        faces=np.concatenate([mesh.faces, inner]),
        face_label=np.append(mesh.face_label, 0),
    )


def label_unused(mesh: Mesh) -> Mesh:
    return dataclasses.replace(mesh, label_names=(*mesh.label_names, "branch"))


def loose_node(mesh: Mesh) -> Mesh:
    return dataclasses.replace(mesh, points=np.concatenate([mesh.points, [[0.1, 0.0, 0.3]]]))


DAMAGE: dict[str, tuple[Callable[[Mesh], Mesh], str]] = {
    "inverted": (inverted, r"1 tetrahedra are inverted or flat, the first.* at \("),
    "all inverted": (all_inverted, f"{N_TETS} tetrahedra are inverted or flat"),
    "flat": (flat, r"tetrahedra are inverted or flat, the first.* at \("),
    "collapsed": (collapsed, "1 tetrahedra are inverted or flat"),
    "hole in the blood": (hollow, r"4 faces of the boundary .* have no label, the first at \("),
    "hole in the wall": (dented, "faces of the boundary or the interface have no label"),
    "cell twice": (double, r"1 tetrahedra are there twice, the first.* at \("),
    "three at a face": (crowded, r"faces are shared by three or more tetrahedra.* at \("),
    "folded": (folded, "both their tetrahedra on the same side"),
    "two parts": (in_pieces, "fluid: it falls into 2 pieces"),
    "torn": (torn, r"1 nodes lie where another one lies, the first, .* at \("),
    "face without label": (unlabelled, r"1 faces of the boundary .* have no label.* at \("),
    "face inside": (label_inside, r"1 labelled faces bound no region.* at \("),
    "unused label": (label_unused, "1 labels have no faces: branch"),
    "loose node": (loose_node, r"1 nodes belong to no tetrahedron.* at \("),
}
# What a folder cannot say: its labels are its files, its nodes those of its tetrahedra, and the
# faces of its files have owners.
NOT_IN_FOLDERS = {
    "folded",
    "collapsed",
    "hole in the wall",
    "cell twice",
    "three at a face",
    "face inside",
    "loose node",
}


WHERE = [
    (name, ending)
    for name in DAMAGE
    for ending in FORMATS
    if ending != "folder" or name not in NOT_IN_FOLDERS
]


@pytest.mark.parametrize(("name", "ending"), WHERE)
def test_a_damaged_mesh_is_refused_and_named(tmp_path, walled, name, ending):
    spoil, says = DAMAGE[name]
    path = store(tmp_path, spoil(walled), ending)
    with pytest.raises(ValueError, match=rf"tube\.{ending}.*damaged mesh.*{says}"):
        load(path)
    if ending == "vtu":
        assert check_topology(load(path, damaged=True)).faults


@pytest.mark.parametrize("ending", FORMATS)
def test_sound_meshes_of_any_kind_are_read(tmp_path, walled, ending):
    assert load(store(tmp_path, walled, ending)).openings == ("inlet", "outlet")


def foreign(folder: pathlib.Path, mesh: Mesh, ending: str) -> pathlib.Path:
    """The mesh as another program would write it."""
    path = store(folder, mesh, ending)
    if ending == "msh":
        raw = path.read_bytes()
        path.write_bytes(raw[raw.index(b"$MeshFormat") :])
    elif ending == "folder":
        for part in ("fluid", "solid"):
            (path / part / "mesh-complete.json").unlink()
    else:
        path.with_suffix(".json").unlink()
    return path


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("name", ["inverted", "all inverted", "hole in the blood", "two parts"])
def test_files_of_others_are_examined_before_they_are_labelled(tmp_path, walled, name, ending):
    spoil, _ = DAMAGE[name]
    says = {
        "inverted": "1 tetrahedra are inverted",
        "all inverted": f"{N_TETS} tetrahedra are inverted",
        "hole in the blood": r"boundary of the lumen at \(.*no closed manifold",
        "two parts": "it falls into 2 pieces",
    }[name]
    path = foreign(tmp_path, spoil(walled), ending)
    with pytest.raises(ValueError, match=rf"damaged mesh: .*{says}"):
        load(path)


def test_a_hole_in_blood_without_a_wall_is_no_vessel_wall(tmp_path):
    """Where unnamed faces become the vessel wall, those of a hole would."""
    blood = tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=0)
    path = foreign(tmp_path, hollow(blood), "msh")
    with pytest.raises(ValueError, match=r"no closed manifold|it has 2 pieces"):
        read_mesh(path, unit="cm")


@pytest.mark.parametrize("index", [-1, 10**6])
@pytest.mark.parametrize("ending", ["vtu", "xdmf", "folder"])
def test_indices_of_no_node_are_refused(tmp_path, walled, ending, index):
    path = store(tmp_path, walled, ending)
    volume = path / "fluid" / "mesh-complete.mesh.vtu" if path.is_dir() else path
    file = meshio.read(volume)
    file.cells[0].data[5, 2] = index
    file.write(volume)
    with pytest.raises(ValueError, match=rf"{volume.stem}.*run from|{volume.stem}.*indices"):
        load(path)


def test_elements_of_msh_files_name_nodes_that_are_there(tmp_path, walled):
    text = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 1 "fluid"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
5 0 0 1
$EndNodes
$Elements
1
1 4 2 1 1 1 2 3 {}
$EndElements
"""
    path = tmp_path / "one.msh"
    for node in (4, 77, -1):
        path.write_text(text.format(node))
        with pytest.raises(ValueError, match=r"one\.msh cannot be"):
            read_mesh(path, unit="cm")


def test_places_of_folders_beyond_their_mesh_take_no_memory(tmp_path, walled):
    folders = tmp_path / "fluid", tmp_path / "solid"
    write_mesh_complete(*folders, walled, unit="cm")
    for name, spoilt in (("MeshIndex", 2**40), ("MeshIndex", -7)):
        volume = folders[0] / "mesh-complete.mesh.vtu"
        file = meshio.read(volume)
        file.point_data[name][3] = spoilt
        file.write(volume)
        if spoilt < 0:
            with pytest.raises(ValueError, match="negative place"):
                read_mesh_complete(*folders, unit="cm")
        else:
            # Without places the two are joined like folders of others.
            assert len(read_mesh_complete(*folders, unit="cm").points) == len(walled.points)
