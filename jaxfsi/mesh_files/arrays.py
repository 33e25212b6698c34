"""A mesh as the arrays of a mesh file and back: cells, region, label, node ids.

Tetrahedra and labelled triangles are two blocks of cells, and wedges of the wall a third
(`jaxfsi.mesh_files.wedge_cells`). The integer ``region`` is that of the tetrahedra and −1 on
triangles, ``label`` is that of the triangles and −1 on tetrahedra.
"""

import dataclasses
import pathlib
from collections.abc import Sequence

import meshio
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_files.acceptance import check_cells
from jaxfsi.mesh_files.lengths import UNITS_CM, check_extent, check_stored_unit
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_files.side_entry import SideEntry
from jaxfsi.mesh_files.wedge_cells import KIND, no_data, solid_cells, split_wedges
from jaxfsi.mesh_parts import used_nodes
from jaxfsi.meshing.labels import find_openings, label_faces
from jaxfsi.opening import Opening

NODE_ID = "GlobalNodeID"
_IGNORED = ("vertex", "line")
_KNOWN = ("tetra", "triangle")


def points_in(mesh: Mesh, unit: str, path: pathlib.Path, any_size: bool) -> np.ndarray:
    """Points of a mesh in the unit of a file, after a check of their extent."""
    points = mesh.points / UNITS_CM[unit]
    if not any_size:
        check_extent(points, unit, path)
    return points


def mesh_to_arrays(mesh: Mesh, points: Float[np.ndarray, "nodes 3"]) -> meshio.Mesh:
    """Cells and data of a mesh for a writer of meshio."""
    cells, data = solid_cells(mesh)
    data["label"] = [np.full(len(np.asarray(part)), -1, dtype=np.int64) for part in data["region"]]
    if len(mesh.faces):
        cells.append(("triangle", mesh.faces.astype(np.int64)))
        for name, values in no_data(len(mesh.faces)).items():
            if name in data:
                data[name].append(values)
        data["region"].append(np.full(len(mesh.faces), -1, dtype=np.int64))
        data["label"].append(mesh.face_label.astype(np.int64))
    return meshio.Mesh(
        points, cells, point_data={NODE_ID: mesh.ids.astype(np.int64)}, cell_data=data
    )


def cells_of(
    file: meshio.Mesh, path: pathlib.Path, *, beside: tuple[str, ...] = ()
) -> tuple[Int[np.ndarray, "tets 4"], Int[np.ndarray, "faces 3"]]:
    """Linear tetrahedra and triangles of a file.

    Args:
        file: as read.
        path: for messages.
        beside: kinds of cells that the file may hold too.

    Raises:
        MeshFileError: no tetrahedra, or cells of another kind.
    """
    kinds = {block.type for block in file.cells}
    other = sorted(kinds.difference(_KNOWN, _IGNORED, beside))
    if other or kinds.isdisjoint(("tetra", *beside)):
        held = ", ".join(other) if other else "no tetrahedra"
        raise MeshFileError(
            f"{path} holds {held}. Only linear tetrahedra with linear triangles can be read; save"
            " it as such."
        )
    none = np.zeros((0, 4), dtype=np.int64)
    tets = [none, *(block.data for block in file.cells if block.type == "tetra")]
    faces = [block.data for block in file.cells if block.type == "triangle"]
    return (
        np.concatenate(tets).astype(np.int64),
        np.concatenate([*faces, np.zeros((0, 3), dtype=np.int64)]).astype(np.int64),
    )


def cell_values(
    file: meshio.Mesh, name: str, kind: str, path: pathlib.Path
) -> Int[np.ndarray, " cells"] | None:
    """Integer data on the cells of one kind, blocks joined; None where the file has none.

    Raises:
        MeshFileError: the values are not whole numbers, one a cell.
    """
    if name not in file.cell_data:
        return None
    blocks = zip(file.cells, file.cell_data[name], strict=True)
    values = [
        whole_numbers(np.asarray(data), name, path) for block, data in blocks if block.type == kind
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *values])


def whole_numbers(values: np.ndarray, name: str, path: pathlib.Path) -> Int[np.ndarray, " values"]:
    """Values that must be integers, whatever type the file keeps them in."""
    if values.ndim != 1 or not np.all(values == np.rint(values)):
        raise MeshFileError(
            f"the data {name!r} of {path} are not one whole number each. Give integers."
        )
    return values.astype(np.int64)


def node_ids_of(file: meshio.Mesh, path: pathlib.Path) -> Int[np.ndarray, " nodes"] | None:
    """Node ids that a file carries; None where they count from one."""
    if NODE_ID not in file.point_data:
        return None
    ids = whole_numbers(np.squeeze(np.asarray(file.point_data[NODE_ID])), NODE_ID, path)
    return None if np.array_equal(ids, np.arange(1, len(ids) + 1)) else ids


def arrays_to_mesh(
    file: meshio.Mesh,
    path: pathlib.Path,
    *,
    unit: str,
    entry: SideEntry | None,
    openings: Sequence[Opening] | None,
    any_size: bool,
) -> Mesh:
    """The mesh in a file whose cell data are ``region`` and ``label``.

    With a side entry it is the mesh that was written, exactly. Without one the labels are made
    from the regions and the openings.

    Raises:
        MeshFileError: cells or data that are not those of a mesh, a wrong unit, no openings.
    """
    if entry is not None:
        check_stored_unit(unit, entry.unit, path)
    tets, faces = cells_of(file, path, beside=(KIND,))
    points = np.asarray(file.points, dtype=float).reshape(len(file.points), -1)
    if points.shape[1:] != (3,):
        raise MeshFileError(f"the points of {path} are not in space. Give x, y and z.")
    if not any_size:
        check_extent(points, unit, path)
    points = points * UNITS_CM[unit]
    region = cell_values(file, "region", "tetra", path)
    tets, region, wedges = split_wedges(file, points, tets, region, path)
    if region is None:
        region = np.full(len(tets), int(Region.FLUID))
    ids = node_ids_of(file, path)
    label = cell_values(file, "label", "triangle", path)
    if entry is None:
        return labelled_from_outside(points, tets, region, ids, openings, path)
    if label is None:
        if len(faces):
            raise MeshFileError(f"{path} has lost the data 'label'. Write it again.")
        label = np.zeros(0, dtype=np.int64)
    return built(
        path, points, tets, region, faces, label, entry.label_names, ids, entry.meta, wedges
    )


def labelled_from_outside(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
    ids: Int[np.ndarray, " nodes"] | None,
    openings: Sequence[Opening] | None,
    path: pathlib.Path,
) -> Mesh:
    """A mesh from tetrahedra that carry no labels; nodes without tetrahedra are left out.

    Raises:
        MeshFileError: indices out of range, damaged tetrahedra, or no openings for a mesh without
            a wall.
        ValueError: see `jaxfsi.meshing.label_faces`.
    """
    bare = built(path, points, tets, region, np.zeros((0, 3), int), np.zeros(0, int), (), ids, {})
    bare = without_unused(bare)
    check_cells(bare, path)
    if openings is None:
        if not (np.any(region == Region.SOLID) and np.any(region == Region.FLUID)):
            raise MeshFileError(
                f"{path} carries no labels, and openings can be found only where a wall surrounds"
                " the blood. Save it as msh or mesh-complete with its openings named, or give their"
                " planes to the reader."
            )
        openings = find_openings(bare.points, bare.tets, bare.region)
    mesh = label_faces(bare.points, bare.tets, bare.region, openings)
    return dataclasses.replace(mesh, node_ids=bare.node_ids)


def without_unused(mesh: Mesh) -> Mesh:
    """The same mesh without nodes that no tetrahedron uses; its node ids keep their values."""
    nodes = used_nodes(mesh.tets)
    if len(nodes) == len(mesh.points):
        return mesh
    local = np.zeros(len(mesh.points), dtype=np.int64)
    local[nodes] = np.arange(len(nodes))
    return dataclasses.replace(
        mesh,
        points=mesh.points[nodes],
        tets=local[mesh.tets],
        faces=local[mesh.faces],
        node_ids=mesh.ids[nodes],
    )


def built(
    path: pathlib.Path,
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
    faces: Int[np.ndarray, "faces 3"],
    face_label: Int[np.ndarray, " faces"],
    label_names: tuple[str, ...],
    node_ids: Int[np.ndarray, " nodes"] | None,
    meta: dict[str, object],
    wedges: ArrayLike = (),
) -> Mesh:
    """A mesh from the arrays of a file; what is wrong with them is said with the file's name.

    Raises:
        MeshFileError: the arrays do not belong together.
    """
    try:
        stacked = np.asarray(wedges, dtype=np.int64).reshape(-1, 6)
        return Mesh(points, tets, region, faces, face_label, label_names, node_ids, meta, stacked)
    except ValueError as error:
        raise MeshFileError(f"{path} cannot be used: {error}") from error
