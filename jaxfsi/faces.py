"""Faces and edges of tetrahedra: which are shared, which lie on the boundary or the interface.

Everything here follows from the node numbers alone; no coordinate enters.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from jaxfsi.mesh import Region, tet_faces

_TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_TRIANGLE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])


class FaceTable(NamedTuple):
    """Every face of a set of tetrahedra once.

    Attributes:
        nodes: nodes of each face, pointing out of its first tetrahedron.
        first: the tetrahedron that the face points out of.
        second: the tetrahedron behind the face, −1 on the boundary.
        first_side: which of the four faces of ``first`` it is.
        second_side: which of the four faces of ``second`` it is, −1 on the boundary.
    """

    nodes: Int[np.ndarray, "faces 3"]
    first: Int[np.ndarray, " faces"]
    second: Int[np.ndarray, " faces"]
    first_side: Int[np.ndarray, " faces"]
    second_side: Int[np.ndarray, " faces"]

    @property
    def on_boundary(self) -> Bool[np.ndarray, " faces"]:
        """Whether each face has nothing behind it."""
        return self.second < 0


class RegionFaces(NamedTuple):
    """The faces that bound the regions of a mesh, each with the tetrahedron it points out of.

    Attributes:
        interface: faces between fluid and solid, pointing from the fluid into the solid.
        fluid: faces of the fluid with nothing behind them, pointing out of it.
        solid: faces of the solid with nothing behind them, pointing out of it.
        interface_tets: the fluid tetrahedron of each interface face.
        fluid_tets: the tetrahedron of each fluid face.
        solid_tets: the tetrahedron of each solid face.
    """

    interface: Int[np.ndarray, "interface 3"]
    fluid: Int[np.ndarray, "fluid 3"]
    solid: Int[np.ndarray, "solid 3"]
    interface_tets: Int[np.ndarray, " interface"]
    fluid_tets: Int[np.ndarray, " fluid"]
    solid_tets: Int[np.ndarray, " solid"]


def row_order(rows: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, " rows"]:
    """Order that sorts rows lexicographically, first column first."""
    return np.lexsort(rows.T[::-1])


def unique_rows(
    rows: Int[np.ndarray, "rows columns"],
) -> tuple[Int[np.ndarray, "unique columns"], Int[np.ndarray, " rows"]]:
    """Distinct rows in lexicographic order, and which of them each row is."""
    order = row_order(rows)
    ordered = rows[order]
    new = np.ones(len(rows), dtype=bool)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    which = np.empty(len(rows), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return ordered[new], which


def face_table(tets: Int[np.ndarray, "tets 4"]) -> FaceTable:
    """Every face of the tetrahedra once, sorted by its sorted node numbers.

    Raises:
        ValueError: three or more tetrahedra share one face.
    """
    faces = tet_faces(tets).reshape(-1, 3)
    keys = np.sort(faces, axis=1)
    order = row_order(keys)
    keys = keys[order]
    same = np.all(keys[1:] == keys[:-1], axis=1)
    if np.any(same[1:] & same[:-1]):
        where = int(np.flatnonzero(same[1:] & same[:-1])[0])
        raise ValueError(
            f"three tetrahedra share the face of the nodes {keys[where].tolist()}: the mesh"
            " overlaps itself or lists a tetrahedron twice. Remove the surplus one."
        )
    new = np.ones(len(order), dtype=bool)
    new[1:] = ~same
    start = np.flatnonzero(new)
    paired = np.zeros(len(start), dtype=bool)
    paired[np.cumsum(new)[1:][same] - 1] = True
    front = order[start]
    behind = np.where(paired, order[np.minimum(start + 1, len(order) - 1)], -1)
    return FaceTable(
        nodes=faces[front],
        first=front // 4,
        second=np.where(paired, behind // 4, -1),
        first_side=front % 4,
        second_side=np.where(paired, behind % 4, -1),
    )


def crowded_faces(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "crowded 3"]:
    """Faces that three or more tetrahedra share, nodes in rising order; `face_table` needs none."""
    faces, which = unique_rows(np.sort(tet_faces(tets).reshape(-1, 3), axis=1))
    return faces[np.bincount(which, minlength=len(faces)) > 2]


def tet_neighbours(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "tets 4"]:
    """The tetrahedron behind each of the four faces of each tetrahedron, −1 for none."""
    table = face_table(tets)
    neighbours = np.full(tets.shape, -1, dtype=np.int64)
    shared = ~table.on_boundary
    first, second = table.first[shared], table.second[shared]
    neighbours[first, table.first_side[shared]] = second
    neighbours[second, table.second_side[shared]] = first
    return neighbours


def region_faces(tets: Int[np.ndarray, "tets 4"], region: Int[np.ndarray, " tets"]) -> RegionFaces:
    """The interface and the boundary of each region.

    Args:
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.

    Returns:
        Faces that point out of their region, those of the interface out of the fluid.
    """
    table = face_table(tets)
    front = region[table.first]
    shared = ~table.on_boundary
    # Index −1 of a boundary face reads some region; `shared` masks it.
    differs = shared & (front != region[table.second])
    from_fluid = differs & (front == Region.FLUID)
    from_solid = differs & (front == Region.SOLID)
    fluid = table.on_boundary & (front == Region.FLUID)
    solid = table.on_boundary & (front == Region.SOLID)
    return RegionFaces(
        interface=np.concatenate([table.nodes[from_fluid], table.nodes[from_solid][:, ::-1]]),
        fluid=table.nodes[fluid],
        solid=table.nodes[solid],
        interface_tets=np.concatenate([table.first[from_fluid], table.second[from_solid]]),
        fluid_tets=table.first[fluid],
        solid_tets=table.first[solid],
    )


def boundary_of(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "faces 3"]:
    """Outward faces of the tetrahedra that no second one shares."""
    table = face_table(tets)
    return table.nodes[table.on_boundary]


def find_rows(
    rows: Int[np.ndarray, "rows columns"], table: Int[np.ndarray, "entries columns"]
) -> Int[np.ndarray, " rows"]:
    """Index in a table of distinct node sets of each row, whatever its order; −1 where absent."""
    if len(table) == 0:
        return np.full(len(rows), -1, dtype=np.int64)
    stacked = np.concatenate([np.sort(table, axis=1), np.sort(rows, axis=1)])
    distinct, which = unique_rows(stacked)
    entry = np.full(len(distinct), -1, dtype=np.int64)
    entry[which[: len(table)]] = np.arange(len(table))
    return entry[which[len(table) :]]


def same_sense(
    faces: Int[np.ndarray, "faces 3"], others: Int[np.ndarray, "faces 3"]
) -> Bool[np.ndarray, " faces"]:
    """Whether triangles of the same three nodes run round them in the same sense."""
    turned = np.stack([np.roll(others, shift, axis=1) for shift in range(3)])
    return np.any(np.all(turned == faces[None], axis=2), axis=0)


def tet_edges(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "edges 2"]:
    """Every edge of the tetrahedra once, lower node first, in lexicographic order."""
    return unique_rows(np.sort(tets[:, _TET_EDGES].reshape(-1, 2), axis=1))[0]


def triangle_edges(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "faces 3 2"]:
    """The three directed edges of each triangle."""
    return faces[:, _TRIANGLE_EDGES]


def corner_fans(
    faces: Int[np.ndarray, "faces 3"], pair: Int[np.ndarray, "pairs 2"]
) -> Int[np.ndarray, " corners"]:
    """Fan of triangles that each corner belongs to: two triangles at an edge join at both ends.

    Args:
        faces: triangles; corner 3 f + i is node i of triangle f.
        pair: half-edges 3 f + i, from node i to node i + 1 of triangle f, that share one edge.
    """
    first, second = pair[:, 0], pair[:, 1]
    nodes = faces.reshape(-1)

    def ending(half: np.ndarray) -> np.ndarray:
        return half // 3 * 3 + (half % 3 + 1) % 3

    opposed = nodes[first] == nodes[ending(second)]
    start = np.where(opposed, ending(second), second)
    end = np.where(opposed, second, ending(second))
    rows = np.concatenate([first, ending(first)])
    columns = np.concatenate([start, end])
    graph = csr_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(nodes.size,) * 2)
    return connected_components(graph, directed=False)[1]
