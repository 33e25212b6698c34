"""Wedges of the wall as cells of a file, in place of the tetrahedra that fill them.

A wedge is one cell (type 13 of VTK) whose first triangle points away from the second, so that
viewers show the wall as it is computed. ``tets`` on the cells is the place of each tetrahedron in
the mesh, three for a wedge; ``filling`` its corners as digits that count through the wedge's
nodes. Where they are missing wedges are cut anew.
"""

import pathlib
from typing import NamedTuple

import meshio
import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.meshing.structured.prisms import tets_of_wedges

KIND = "wedge"
_ORDER = [0, 2, 1, 3, 5, 4]  # its own inverse
_DIGITS = np.array([1000, 100, 10, 1])
_PLACES, _FILLING = "tets", "filling"

Cells = list[tuple[str, ArrayLike] | meshio.CellBlock]


class Split(NamedTuple):
    """Tetrahedra of a file, those of its wedges among them.

    Attributes:
        tets: in the order of the mesh that was written, or those of wedges last.
        region: of each; None where the file has none.
        wedges: three nodes on one side, then those above them.
    """

    tets: Int[np.ndarray, "tets 4"]
    region: Int[np.ndarray, " tets"] | None
    wedges: Int[np.ndarray, "wedges 6"]


def solid_cells(mesh: Mesh) -> tuple[Cells, dict[str, list[ArrayLike]]]:
    """Blocks of tetrahedra and wedges, and the data that put them together again."""
    if len(mesh.wedges) == 0:
        return [("tetra", mesh.tets.astype(np.int64))], {"region": [mesh.region.astype(np.int64)]}
    inside = np.zeros(len(mesh.tets), dtype=bool)
    filling = mesh.wedge_tets
    inside[filling] = True
    cells: Cells = [
        ("tetra", mesh.tets[~inside].astype(np.int64)),
        (KIND, mesh.wedges[:, _ORDER].astype(np.int64)),
    ]
    of_wedges = np.full(len(mesh.wedges), int(Region.SOLID), dtype=np.int64)
    region: list[ArrayLike] = [mesh.region[~inside].astype(np.int64), of_wedges]
    corners = mesh.tets[filling]
    digit = np.argmax(corners[..., None] == mesh.wedges[:, None, None, :], axis=3)
    alone = np.flatnonzero(~inside)
    places = np.stack([alone, 0 * alone - 1, 0 * alone - 1], axis=1)
    data: dict[str, list[ArrayLike]] = {
        _PLACES: [places, filling.astype(np.int64)],
        _FILLING: [0 * places - 1, (digit @ _DIGITS).astype(np.int64)],
    }
    return cells, {"region": region, **data}


def no_data(count: int) -> dict[str, ArrayLike]:
    """What the triangles of a file with wedges have for data of its tetrahedra and wedges."""
    none = np.full((count, 3), -1, dtype=np.int64)
    return {_PLACES: none, _FILLING: none}


def split_wedges(
    file: meshio.Mesh,
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"] | None,
    path: pathlib.Path,
) -> Split:
    """Join the tetrahedra that fill the wedges of a file to its others.

    Args:
        file: as read.
        points: its nodes.
        tets: its cells that are tetrahedra.
        region: of these; None where the file has none.
        path: for messages.

    Raises:
        MeshFileError: nodes of wedges are out of range, or the places of tetrahedra wrong.
    """
    blocks = [block.data for block in file.cells if block.type == KIND and len(block.data)]
    if not blocks:
        return Split(tets, region, np.zeros((0, 6), dtype=np.int64))
    wedges = np.concatenate(blocks).astype(np.int64)[:, _ORDER]
    if wedges.min() < 0 or wedges.max() >= len(points):
        raise MeshFileError(
            f"{path} has wedges of nodes {wedges.min()} to {wedges.max()}, but {len(points)} nodes."
            " Write it again."
        )
    if region is not None:
        region = np.concatenate([region, np.repeat(_of_kind(file, "region", KIND), 3)])
    if not {_PLACES, _FILLING} <= set(file.cell_data):
        cut = tets_of_wedges(wedges, points).reshape(3, -1, 4).transpose(1, 0, 2).reshape(-1, 4)
        return Split(np.concatenate([tets, cut]), region, wedges)
    places = np.concatenate(
        [_of_kind(file, _PLACES, "tetra")[:, 0], _of_kind(file, _PLACES, KIND).reshape(-1)]
    )
    digit = (_of_kind(file, _FILLING, KIND)[..., None] // _DIGITS) % 10
    total = len(tets) + 3 * len(wedges)
    if not np.array_equal(np.sort(places), np.arange(total)) or digit.max() > 5:
        raise MeshFileError(
            f"the data {_PLACES!r} or {_FILLING!r} of {path} do not give each tetrahedron a place"
            " of its own. Write it again."
        )
    cut = np.take_along_axis(wedges, digit.reshape(len(wedges), -1), axis=1).reshape(-1, 4)
    order = np.argsort(places)
    tets = np.concatenate([tets, cut])[order]
    return Split(tets, None if region is None else region[order], wedges)


def _of_kind(file: meshio.Mesh, name: str, kind: str) -> Int[np.ndarray, "..."]:
    """Data on the cells of one kind."""
    blocks = zip(file.cells, file.cell_data[name], strict=True)
    found = [np.asarray(data) for block, data in blocks if block.type == kind]
    if not found:
        return np.zeros((0, 3), dtype=np.int64)
    return np.concatenate(found).astype(np.int64)
