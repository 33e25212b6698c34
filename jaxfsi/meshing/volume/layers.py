"""Two layers of tetrahedra everywhere: edges that run from surface to surface are split.

An edge inside a region whose ends both lie on its surface spans the region in one element. A node
at its middle splits every tetrahedron about it in two. Edges that share a tetrahedron take turns,
longest first.
"""

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.faces import boundary_of, find_rows, tet_edges, triangle_edges, unique_rows

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def split_spanning_edges(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> tuple[Float[np.ndarray, "new 3"], Int[np.ndarray, "newtets 4"]]:
    """Split all inner edges between two nodes of the surface.

    Args:
        points: nodes of one region [cm].
        tets: its tetrahedra, positively oriented.

    Returns:
        The nodes followed by those at the middle of edges, and tetrahedra of the same volume and
        the same surface.
    """
    surface = boundary_of(tets)
    on_surface = np.zeros(len(points), dtype=bool)
    on_surface[surface] = True
    kept, _ = unique_rows(np.sort(triangle_edges(surface).reshape(-1, 2), axis=1))
    while True:
        edges = tet_edges(tets[on_surface[tets].sum(axis=1) >= 2])
        edges = edges[on_surface[edges].all(axis=1)]
        edges = edges[find_rows(edges, kept) < 0]
        if len(edges) == 0:
            return points, tets
        points, tets = split_edges(points, tets, edges)
        on_surface = np.concatenate([on_surface, np.zeros(len(points) - len(on_surface), bool)])


def split_edges(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    edges: Int[np.ndarray, "edges 2"],
) -> tuple[Float[np.ndarray, "new 3"], Int[np.ndarray, "newtets 4"]]:
    """Split those of the edges that are the longest of the given ones in all their tetrahedra.

    Args:
        points: nodes [cm].
        tets: positively oriented.
        edges: what may be split, each once, its nodes in rising order.
    """
    length = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    rank = np.empty(len(edges), dtype=np.int64)
    rank[np.argsort(-length, kind="stable")] = np.arange(len(edges))
    which = find_rows(tets[:, _EDGES].reshape(-1, 2), edges).reshape(-1, 6)
    owners, sides = np.nonzero(which >= 0)
    found = which[owners, sides]
    best = np.full(len(tets), len(edges), dtype=np.int64)
    np.minimum.at(best, owners, rank[found])
    wins = np.ones(len(edges), dtype=bool)
    wins[found[rank[found] > best[owners]]] = False
    chosen = wins[found]
    owners, sides, found = owners[chosen], sides[chosen], found[chosen]
    middle = np.full(len(edges), -1, dtype=np.int64)
    middle[wins] = len(points) + np.arange(wins.sum())
    ends = _EDGES[sides]
    rows = np.arange(len(owners))
    low, high = tets[owners].copy(), tets[owners].copy()
    low[rows, ends[:, 1]] = middle[found]
    high[rows, ends[:, 0]] = middle[found]
    rest = np.ones(len(tets), dtype=bool)
    rest[owners] = False
    added = points[edges[wins]].mean(axis=1)
    return np.concatenate([points, added]), np.concatenate([tets[rest], low, high])
