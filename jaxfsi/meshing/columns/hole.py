"""Triangles over a narrow hole in the outer surface, between the ends of columns about it.

The hole is a polygon in space. Of its triangulations without inner vertices the one with the
least sum over the inner edges of

    |a − b|² + (κ W(½ (a + b)))²,

is taken, W being the distance from the outer surface (dynamic programming; Barequet & Sharir 1995,
Comput. Aided Geom. Des. 12, 207-229). Triangles that face the wrong way come last. Several borders
of one hole are joined by their shortest bridges to one polygon.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxfsi.anatomy.anatomy import PointFunction

_DISTANCE_WEIGHT = 4.0
_LEAST_COSINE = 0.3
# Of a triangle that faces the wrong way, over the longest edge squared.
_TURNED = 1e3


def joined(
    points: Float[np.ndarray, "points 3"], borders: list[Int[np.ndarray, " _"]]
) -> Int[np.ndarray, " polygon"]:
    """One polygon of all borders of a hole, each bridge passed once in either direction.

    Args:
        points: vertices [cm].
        borders: closed, the hole to their left.
    """
    polygon, left = borders[0], list(borders[1:])
    while left:
        tree = KDTree(points[polygon])
        ways = [np.asarray(tree.query(points[border])[0]) for border in left]
        which = int(np.argmin([way.min() for way in ways]))
        border = np.roll(left.pop(which), -int(np.argmin(ways[which])))
        here = int(np.ravel(tree.query(points[border[0]])[1])[0])
        polygon = np.concatenate(
            [polygon[: here + 1], border, border[:1], polygon[here : here + 1], polygon[here + 1 :]]
        )
    return polygon


def least_triangulation(
    polygon: Int[np.ndarray, " polygon"],
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    f: PointFunction,
    taken: Int[np.ndarray, "edges 2"],
) -> Int[np.ndarray, "triangles 3"]:
    """The triangulation of a polygon in space with the least cost.

    Args:
        polygon: vertices in order, the hole to the left.
        points: vertices [cm].
        normals: of the outer surface at the vertices, unit.
        f: distance from the outer surface [cm].
        taken: edges that may not be used again.
    """
    n, x = len(polygon), points[polygon]
    chord = _chords(polygon, points, f, taken)
    turned = _TURNED * float(np.max(np.sum((x - x.mean(axis=0)) ** 2, axis=1)))
    across = np.cross(x[:, None], x[None])
    best = np.zeros((n, n))
    apex = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        i = np.arange(n - span)[:, None]
        j, k = i + span, i + np.arange(1, span)[None]
        wrong = _faces_away(across, normals[polygon], i, k, j)
        cost = best[i, k] + best[k, j] + turned * wrong
        least = np.argmin(cost, axis=1)
        rows = np.arange(n - span)
        best[rows, rows + span] = cost[rows, least] + chord[rows, rows + span]
        apex[rows, rows + span] = rows + 1 + least
    triangles, open_ = [], [(0, n - 1)]
    while open_:
        i, j = open_.pop()
        if j - i < 2:
            continue
        k = int(apex[i, j])
        triangles.append((i, k, j))
        open_ += [(i, k), (k, j)]
    return polygon[np.array(triangles, dtype=np.int64).reshape(-1, 3)]


def _chords(
    polygon: Int[np.ndarray, " polygon"],
    points: Float[np.ndarray, "points 3"],
    f: PointFunction,
    taken: Int[np.ndarray, "edges 2"],
) -> Float[np.ndarray, "polygon polygon"]:
    """Cost of the edge between any two vertices."""
    n, x = len(polygon), points[polygon]
    low, high = np.triu_indices(n, 2)
    length = np.sum((x[low] - x[high]) ** 2, axis=1)
    away = np.asarray(f(0.5 * (x[low] + x[high])))
    count = len(points)
    key = np.minimum(polygon[low], polygon[high]) * count + np.maximum(polygon[low], polygon[high])
    barred = np.isin(key, np.min(taken, axis=1) * count + np.max(taken, axis=1))
    barred |= polygon[low] == polygon[high]
    # The last closes the polygon.
    barred &= ~((low == 0) & (high == n - 1))
    cost = np.zeros((n, n))
    cost[low, high] = length + (_DISTANCE_WEIGHT * away) ** 2
    cost[low[barred], high[barred]] = 10.0 * _TURNED * float(length.max())
    cost[0, n - 1] = 0.0
    return cost


def _faces_away(
    across: Float[np.ndarray, "polygon polygon 3"],
    normals: Float[np.ndarray, "polygon 3"],
    i: Int[np.ndarray, "rows 1"],
    k: Int[np.ndarray, "rows apices"],
    j: Int[np.ndarray, "rows 1"],
) -> Bool[np.ndarray, "rows apices"]:
    """Whether triangles are turned from the surface about them, by products xᵢ × xⱼ."""
    normal = across[i, k] + across[k, j] + across[j, i]
    outwards = normals[i] + normals[k] + normals[j]
    along = np.einsum("rak,rak->ra", normal, outwards)
    size = np.einsum("rak,rak->ra", normal, normal) * np.einsum("rak,rak->ra", outwards, outwards)
    return along < _LEAST_COSINE * np.sqrt(size)
