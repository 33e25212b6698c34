"""Topology of triangulated surfaces: Euler characteristic, closedness, pinched nodes, volume.

A closed 2-manifold has every edge in exactly two triangles and round every node one ring of
triangles. With V nodes, E edges and F triangles its Euler characteristic is::

    χ = V − E + F = Σ over components (2 − 2 genus)

and the volume that it encloses follows from its oriented triangles by the divergence theorem::

    V = ⅙ Σ det(a, b, c)
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from jaxfsi.faces import corner_fans, triangle_edges, unique_rows
from jaxfsi.measures import enclosed_volume
from jaxfsi.mesh_parts import used_nodes


class SurfaceTopology(NamedTuple):
    """What a triangulated surface is, whatever its shape.

    Attributes:
        n_faces: triangles.
        euler: Euler characteristic.
        n_components: pieces that share no edge.
        open_edges: edges in one triangle only.
        crowded_edges: edges in three or more triangles.
        unmatched_edges: edges that two triangles run along in the same direction.
        pinched_nodes: nodes at which several fans of triangles meet.
        volume: enclosed volume [cm³]; means something only for a closed surface.
        fault_at: a place where the surface is not a closed manifold [cm]; None where it is.
        piece_at: a node of the smallest of several pieces [cm]; None where there is one piece.
    """

    n_faces: int
    euler: int
    n_components: int
    open_edges: int
    crowded_edges: int
    unmatched_edges: int
    pinched_nodes: int
    volume: float
    fault_at: tuple[float, float, float] | None
    piece_at: tuple[float, float, float] | None

    @property
    def is_closed_manifold(self) -> bool:
        """Whether the surface is closed, oriented and nowhere pinched."""
        return not (
            self.open_edges or self.crowded_edges or self.unmatched_edges or self.pinched_nodes
        )


def surface_topology(
    points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> SurfaceTopology:
    """Topology of a triangulated surface.

    Args:
        points: node positions [cm].
        faces: nodes of each triangle, all pointing to the same side.

    Returns:
        Its Euler characteristic and all that keeps it from being a closed manifold.
    """
    directed = triangle_edges(faces).reshape(-1, 2)
    edges, which = unique_rows(np.sort(directed, axis=1))
    count = np.bincount(which, minlength=len(edges))
    forward = np.bincount(which, weights=directed[:, 0] < directed[:, 1], minlength=len(edges))
    by_edge = np.argsort(which, kind="stable")
    start = np.concatenate([[0], np.cumsum(count)[:-1]])[count == 2]
    pairs = np.stack([by_edge[start], by_edge[start + 1]], axis=1)
    fan = corner_fans(faces, pairs)
    corners, _ = unique_rows(np.column_stack([fan, faces.reshape(-1)]))
    nodes, fans_of_node = np.unique(corners[:, 1], return_counts=True)
    pinched = nodes[fans_of_node > 1]
    wrong_way = (count == 2) & (forward != 1)
    bad_edges = edges[(count != 2) | wrong_way]
    at = np.concatenate([bad_edges[:, 0], pinched])
    ones = np.ones(len(pairs), dtype=np.int8)
    joined = csr_array((ones, (pairs[:, 0] // 3, pairs[:, 1] // 3)), shape=(len(faces),) * 2)
    n_components, piece = connected_components(joined, directed=False) if len(faces) else (0, faces)
    smallest = faces[piece == np.argmin(np.bincount(piece))] if n_components > 1 else faces[:0]
    return SurfaceTopology(
        n_faces=len(faces),
        euler=len(used_nodes(faces)) - len(edges) + len(faces),
        n_components=int(n_components),
        open_edges=int(np.sum(count == 1)),
        crowded_edges=int(np.sum(count > 2)),
        unmatched_edges=int(np.sum(wrong_way)),
        pinched_nodes=len(pinched),
        volume=enclosed_volume(points, faces),
        fault_at=_as_place(points[at[0]]) if len(at) else None,
        piece_at=_as_place(points[smallest[0, 0]]) if len(smallest) else None,
    )


def _as_place(point: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    return float(point[0]), float(point[1]), float(point[2])
