"""One ``mesh-complete`` folder: the tetrahedra of a region and its named faces.

``mesh-complete.mesh.vtu`` holds the tetrahedra, ``mesh-surfaces/NAME.vtp`` the faces of each
label. Their nodes and elements are named by ``GlobalNodeID`` and ``GlobalElementID``, counted from
one in each folder; ``ModelFaceID`` counts the labels. All three are Int32, the only integers that
svMultiPhysics takes for them. Layout: SimVascular documentation, "Mesh files".
"""

import json
import pathlib
from typing import NamedTuple

import meshio
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from jaxfsi.faces import face_table, find_rows
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.mesh_files.arrays import NODE_ID, cell_values, cells_of, points_in, whole_numbers
from jaxfsi.mesh_files.lengths import Unit, check_extent
from jaxfsi.mesh_files.refusal import MeshFileError, reading
from jaxfsi.mesh_files.side_entry import SideEntry, entry_text, parsed_entry
from jaxfsi.mesh_files.vtk_xml import check_vtk_xml
from jaxfsi.mesh_files.vtp import read_vtp, write_vtp
from jaxfsi.mesh_parts import submesh
from jaxfsi.text_files import regular_text
from lumped.whole_files import staging

ELEMENT_ID = "GlobalElementID"
FACE_ID = "ModelFaceID"
WHOLE_INDEX = "MeshIndex"  # where a node, tetrahedron or face stands in the mesh of both regions
WHOLE_NODE_ID = "MeshNodeID"
_TETS = "mesh-complete.mesh.vtu"
_EXTERIOR = "mesh-complete.exterior.vtp"
_WALLS = "walls_combined.vtp"
_SURFACES = "mesh-surfaces"
_ENTRY = "mesh-complete.json"
_LARGEST_ID = 2**31 - 1
_SAME_POINT = 1e-5  # of the extent, between a surface file and the volume file


class SurfaceFaces(NamedTuple):
    """Faces of one surface file of a folder.

    Attributes:
        faces: nodes of each triangle, counted from zero in the volume file.
        place: where each stands in the mesh of both regions; None in foreign files.
    """

    faces: Int[np.ndarray, "faces 3"]
    place: Int[np.ndarray, " faces"] | None


class CompleteFolder(NamedTuple):
    """What a folder holds.

    Attributes:
        path: the folder.
        points: node positions in the unit of the folder.
        tets: nodes of each tetrahedron.
        node_ids: ``GlobalNodeID`` of each node.
        surfaces: faces by the name of their file.
        entry: unit, names and meta; None in a foreign folder.
        node_index: where each node stands in the mesh of both regions; None if foreign.
        tet_index: the same for tetrahedra.
        whole_ids: the node's id in the mesh of both regions; None where that counts from one.
    """

    path: pathlib.Path
    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    node_ids: Int[np.ndarray, " nodes"]
    surfaces: dict[str, SurfaceFaces]
    entry: SideEntry | None
    node_index: Int[np.ndarray, " nodes"] | None
    tet_index: Int[np.ndarray, " tets"] | None
    whole_ids: Int[np.ndarray, " nodes"] | None


def read_folder(path: pathlib.Path, unit: Unit, *, any_size: bool) -> CompleteFolder:
    """Read one folder.

    Raises:
        MeshFileError: the folder or one of its files is missing or malformed, or its surfaces
            name nodes that the volume file does not have or has elsewhere.
    """
    if not path.is_dir():
        raise MeshFileError(f"there is no folder {path}. Check the name.")
    volume = path / _TETS
    with reading(volume, "a vtu mesh"):
        check_vtk_xml(volume, "UnstructuredGrid")
        file = meshio.vtu.read(str(volume))
    tets, _ = cells_of(file, volume)
    points = np.asarray(file.points, dtype=float)
    if not any_size:
        check_extent(points, unit, volume)
    if tets.size and not 0 <= tets.min() <= tets.max() < len(points):
        raise MeshFileError(
            f"nodes of tetrahedra in {volume} run from {tets.min()} to {tets.max()}, but there are"
            f" {len(points)} points. Write it again."
        )
    ids = _point_values(file, NODE_ID, volume)
    ids = np.arange(1, len(points) + 1) if ids is None else ids
    if len(np.unique(ids)) != len(points):
        raise MeshFileError(f"{volume} uses a {NODE_ID} twice. Number its nodes anew.")
    files = sorted((path / _SURFACES).glob("*.vtp"))
    if not files:
        raise MeshFileError(f"{path / _SURFACES} holds no vtp files. Save the named faces there.")
    entry = _read_entry(path)
    return CompleteFolder(
        path=path,
        points=points,
        tets=tets,
        node_ids=ids,
        surfaces={file.stem: _read_surface(file, points, ids) for file in files},
        entry=entry,
        node_index=_point_values(file, WHOLE_INDEX, volume),
        tet_index=cell_values(file, WHOLE_INDEX, "tetra", volume),
        whole_ids=_point_values(file, WHOLE_NODE_ID, volume),
    )


def _point_values(
    file: meshio.Mesh, name: str, path: pathlib.Path
) -> Int[np.ndarray, " nodes"] | None:
    if name not in file.point_data:
        return None
    return whole_numbers(np.asarray(file.point_data[name]).reshape(-1), name, path)


def _read_entry(path: pathlib.Path) -> SideEntry | None:
    if not (path / _ENTRY).is_file():
        return None
    with reading(path / _ENTRY, "JSON beside a mesh"):
        return parsed_entry(json.loads(regular_text(path / _ENTRY)))


def _read_surface(
    path: pathlib.Path,
    points: Float[np.ndarray, "nodes 3"],
    node_ids: Int[np.ndarray, " nodes"],
) -> SurfaceFaces:
    surface = read_vtp(path)
    if NODE_ID not in surface.point_data:
        raise MeshFileError(f"{path} has no {NODE_ID}. Save it from the volume mesh.")
    ids = whole_numbers(surface.point_data[NODE_ID].reshape(-1), NODE_ID, path)
    order = np.argsort(node_ids)
    found = np.minimum(np.searchsorted(node_ids[order], ids), len(order) - 1)
    nodes = order[found]
    if np.any(node_ids[nodes] != ids):
        wrong = int(ids[np.argmax(node_ids[nodes] != ids)])
        raise MeshFileError(
            f"{path} names the node {wrong}, which {_TETS} does not have. Save both from one mesh."
        )
    apart = np.max(np.linalg.norm(points[nodes] - surface.points, axis=1), initial=0.0)
    if apart > _SAME_POINT * np.max(np.ptp(points, axis=0)):
        raise MeshFileError(
            f"nodes of {path} lie up to {apart:.3g} from those of the same id in {_TETS}. Save both"
            " from one mesh."
        )
    index = surface.cell_data.get(WHOLE_INDEX)
    return SurfaceFaces(
        nodes[surface.triangles],
        None if index is None else whole_numbers(index, WHOLE_INDEX, path),
    )


def check_target(path: pathlib.Path) -> None:
    """Refuse to write where something is already.

    Raises:
        MeshFileError: the folder exists and is not empty, or its parent does not exist.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise MeshFileError(f"{path} exists already. Remove it, or choose another name.")
    if not path.parent.is_dir():
        raise MeshFileError(f"there is no folder {path.parent}. Make it first.")


def id_array(values: Int[np.ndarray, " ids"], name: str) -> Int[np.ndarray, " ids"]:
    """Ids as Int32.

    Raises:
        MeshFileError: an id does not fit.
    """
    if np.max(values, initial=0) > _LARGEST_ID:
        raise MeshFileError(
            f"{name} would reach {np.max(values)}, but a mesh-complete folder counts to"
            f" {_LARGEST_ID}. Write a coarser mesh, or a vtu file."
        )
    return values.astype(np.int32)


def write_folder(
    path: pathlib.Path, mesh: Mesh, region: Region, unit: Unit, *, any_size: bool
) -> None:
    """Write one region of a mesh as a folder; it appears under its name when it is complete.

    Args:
        path: the folder; it must not exist, or be empty.
        mesh: mesh of one or both regions.
        region: the region to write.
        unit: length unit of the files.
        any_size: write meshes too that are too large or too small for a vessel.
    """
    check_target(path)
    points = points_in(mesh, unit, path, any_size)
    part = submesh(mesh, region)
    with staging(path.parent) as stage:
        new = stage / path.name
        (new / _SURFACES).mkdir(parents=True)
        point_data: dict[str, ArrayLike] = {
            NODE_ID: id_array(np.arange(1, len(part.nodes) + 1), NODE_ID),
            WHOLE_INDEX: part.nodes,
        }
        if mesh.node_ids is not None:
            point_data[WHOLE_NODE_ID] = mesh.ids[part.nodes].astype(np.int64)
        tets = part.mesh.tets.astype(np.int64)
        cell_data = {
            ELEMENT_ID: [id_array(np.arange(1, len(tets) + 1), ELEMENT_ID)],
            "ModelRegionID": [np.ones(len(tets), dtype=np.int32)],
            WHOLE_INDEX: [part.tets],
        }
        local = points[part.nodes]
        meshio.vtu.write(
            str(new / _TETS),
            meshio.Mesh(local, [("tetra", tets)], point_data=point_data, cell_data=cell_data),
        )
        _write_surfaces(new, mesh, part.mesh, local, part.nodes)
        (new / _ENTRY).write_text(entry_text(mesh, unit, wedges=True) + "\n", encoding="utf-8")
        new.rename(path)


def _write_surfaces(
    folder: pathlib.Path,
    mesh: Mesh,
    part: Mesh,
    points: Float[np.ndarray, "nodes 3"],
    nodes: Int[np.ndarray, " nodes"],
) -> None:
    """Write the faces of each label, all of the boundary, and the wall."""
    table = face_table(part.tets)
    owner = table.first[find_rows(part.faces, table.nodes)] + 1
    whole = find_rows(nodes[part.faces], mesh.faces)
    face_id = np.array([mesh.label_names.index(name) + 1 for name in part.label_names])
    model_face = face_id[part.face_label]

    def write(path: pathlib.Path, chosen: np.ndarray) -> None:
        used, local = np.unique(part.faces[chosen], return_inverse=True)
        write_vtp(
            path,
            points[used],
            local.reshape(-1, 3),
            point_data={NODE_ID: id_array(used + 1, NODE_ID)},
            cell_data={
                ELEMENT_ID: id_array(owner[chosen], ELEMENT_ID),
                FACE_ID: id_array(model_face[chosen], FACE_ID),
                WHOLE_INDEX: whole[chosen],
            },
        )

    for i, name in enumerate(part.label_names):
        write(folder / _SURFACES / f"{name}.vtp", np.flatnonzero(part.face_label == i))
    write(folder / _EXTERIOR, np.arange(len(part.faces)))
    if INTERFACE in part.label_names:
        of_wall = part.face_label == part.label_names.index(INTERFACE)
        write(folder / _WALLS, np.flatnonzero(of_wall))
