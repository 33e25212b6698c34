"""Where columns stand: triangles of the lumen whose three columns are good, in tidy patches.

A vertex is free while its column is good. A triangle of three free vertices carries a wedge. So
that tetrahedra can fill the rest, vertices are given up until no patch of wedges is narrow, small
or pinched at a vertex, and until columns stand along the whole rim of an opening or nowhere near
it.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from jaxfsi.faces import triangle_edges, unique_rows
from jaxfsi.meshing.check.tet_quality import tet_quality
from jaxfsi.meshing.check.wedge_quality import wedge_quality
from jaxfsi.meshing.structured.prisms import tets_of_wedges
from jaxfsi.meshing.surface.projection import triangle_qualities

LEAST_JACOBIAN = 0.2
LEAST_DIHEDRAL_DEG = 8.0
# Of the tetrahedra that fill a wedge; meshes are refused below 5 degrees.
LEAST_TET_DIHEDRAL_DEG = 6.0
_LEAST_TRIANGLE_QUALITY = 0.25
# Patches of fewer triangles are given up, patches without columns widened.
_SMALL_PATCH = 30
_RINGS_AT_OPENING = 2

Vertices = Bool[np.ndarray, " points"]
Triangles = Int[np.ndarray, "triangles 3"]


class SurfaceGraph:
    """Neighbours on a triangulated surface.

    Args:
        triangles: of the surface.
        count: number of its vertices.
    """

    def __init__(self, triangles: Triangles, count: int):
        self.triangles, self.count = triangles, count
        directed = triangle_edges(triangles).reshape(-1, 2)
        self.edges, self.which = unique_rows(np.sort(directed, axis=1))
        ones = np.ones(len(directed), dtype=np.int32)
        one_way = csr_array((ones, (directed[:, 0], directed[:, 1])), shape=(count, count))
        self.adjacent = csr_array(one_way + one_way.T)

    def spread(self, marked: Vertices, rings: int = 1) -> Vertices:
        """Marked vertices and their neighbours, so many times."""
        for _ in range(rings):
            marked = marked | (self.adjacent @ marked.astype(np.int32) > 0)
        return marked

    def close(self, pairs: Int[np.ndarray, "pairs 2"], steps: int) -> Bool[np.ndarray, " pairs"]:
        """Whether the vertices of each pair are at most so many edges apart."""
        if len(pairs) == 0:
            return np.zeros(0, dtype=bool)
        starts, row = np.unique(pairs[:, 0], return_inverse=True)
        ones = np.ones(len(starts), dtype=np.int32)
        shape = (len(starts), self.count)
        reached = csr_array((ones, (np.arange(len(starts)), starts)), shape=shape)
        for _ in range(steps):
            reached = csr_array(reached + reached @ self.adjacent)
            reached.data[:] = 1
        found = reached.tocoo()
        keys = found.row.astype(np.int64) * self.count + found.col
        return np.isin(row * self.count + pairs[:, 1], keys)

    def patches(self, rows: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
        """Number of the patch of each of some triangles; the triangles of one share edges."""
        _, first, second = self._inner_edges(rows)
        ones = np.ones(len(first), dtype=np.int8)
        graph = csr_array((ones, (first, second)), shape=(len(rows), len(rows)))
        return connected_components(graph, directed=False)[1]

    def pinched(self, rows: Int[np.ndarray, " rows"]) -> Vertices:
        """Vertices where some of the triangles make several fans."""
        inner, _, _ = self._inner_edges(rows)
        at = np.bincount(self.triangles[rows].ravel(), minlength=self.count)
        joints = np.bincount(self.edges[inner].ravel(), minlength=self.count)
        return at - joints > 1

    def _inner_edges(
        self, rows: Int[np.ndarray, " rows"]
    ) -> tuple[Int[np.ndarray, " inner"], Int[np.ndarray, " inner"], Int[np.ndarray, " inner"]]:
        """Edges between two of the triangles, and these two."""
        edge = self.which.reshape(-1, 3)[rows].ravel()
        order = np.argsort(edge, kind="stable")
        edge, owner = edge[order], order // 3
        twice = np.flatnonzero(edge[1:] == edge[:-1])
        return edge[twice], owner[twice], owner[twice + 1]


def shapely(
    feet: Float[np.ndarray, "points 3"], ends: Float[np.ndarray, "points 3"], triangles: Triangles
) -> Bool[np.ndarray, " triangles"]:
    """Whether the wedge on each triangle is well shaped, whole and cut into tetrahedra.

    Args:
        feet: where the columns start [cm].
        ends: where they end [cm].
        triangles: of the lumen.
    """
    points = np.concatenate([feet, ends])
    wedges = np.concatenate([triangles, triangles + len(feet)], axis=1)
    shape = wedge_quality(points, wedges)
    tets = tet_quality(points, tets_of_wedges(wedges, points)).min_dihedral_deg
    return (
        (shape.scaled_jacobian > LEAST_JACOBIAN)
        & (shape.min_dihedral_deg > LEAST_DIHEDRAL_DEG)
        & (tets.reshape(3, -1).min(axis=0) > LEAST_TET_DIHEDRAL_DEG)
        & (triangle_qualities(ends, triangles) > _LEAST_TRIANGLE_QUALITY)
    )


def without(graph: SurfaceGraph, free: Vertices, bad: Bool[np.ndarray, " triangles"]) -> Vertices:
    """Free vertices that no bad triangle uses."""
    left = free.copy()
    left[graph.triangles[bad]] = False
    return left


def tidied(
    graph: SurfaceGraph, free: Vertices, loops: tuple[Int[np.ndarray, " _"], ...]
) -> Vertices:
    """Fewer free vertices, so that the patches of wedges and the rest are sound.

    Args:
        graph: of the lumen.
        free: vertices whose columns are good.
        loops: rims of the openings.
    """
    free = free & graph.spread(~graph.spread(~free))
    rest = np.flatnonzero(~free[graph.triangles].all(axis=1))
    patch = graph.patches(rest)
    small = np.bincount(patch)[patch] < _SMALL_PATCH if len(rest) else np.zeros(0, dtype=bool)
    islands = np.zeros(graph.count, dtype=bool)
    islands[graph.triangles[rest[small]]] = True
    free = free & ~islands
    while True:
        given_up = _untidy(graph, free, loops) & free
        if not given_up.any():
            return free
        free = free & ~given_up


def _untidy(
    graph: SurfaceGraph, free: Vertices, loops: tuple[Int[np.ndarray, " _"], ...]
) -> Vertices:
    carries = free[graph.triangles].all(axis=1)
    zone = np.flatnonzero(carries)
    untidy = graph.pinched(zone)
    patch = graph.patches(zone)
    small = np.bincount(patch)[patch] < _SMALL_PATCH if len(zone) else np.zeros(0, dtype=bool)
    untidy[graph.triangles[zone[small]]] = True
    for loop in loops:
        rim = np.zeros(graph.count, dtype=bool)
        rim[loop] = True
        if np.any(~carries & rim[graph.triangles].any(axis=1)):
            untidy |= graph.spread(rim, _RINGS_AT_OPENING)
    # A free vertex without a wedge is none.
    used = np.zeros(graph.count, dtype=bool)
    used[graph.triangles[zone]] = True
    return untidy | ~used
