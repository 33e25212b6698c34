"""Places where a triangulated surface cuts itself: edges that pass through triangles.

The edge a + t (b − a) meets the plane of a triangle (p, q, r) at 0 ≤ t ≤ 1 and lies inside it
where its barycentric coordinates are positive (Möller and Trumbore 1997).
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxfsi.faces import triangle_edges, unique_rows

_REACH = 2.5  # triangle sizes within which an edge of a graded surface can reach a triangle


def crossing_triangles(
    points: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Int[np.ndarray, " crossing"]:
    """Triangles that an edge of another one, with no node in common, passes through.

    Args:
        points: vertices [cm].
        triangles: of surfaces whose sizes are graded.
    """
    edges, _ = unique_rows(np.sort(triangle_edges(triangles).reshape(-1, 2), axis=1))
    corners = points[triangles]
    centre = corners.mean(axis=1)
    reach = _REACH * np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    found = KDTree(points[edges].mean(axis=1)).query_ball_point(centre, reach)
    counts = np.array([len(entry) for entry in found], dtype=np.int64)
    which = np.repeat(np.arange(len(triangles)), counts)
    edge = edges[np.concatenate([np.asarray(entry, dtype=np.int64) for entry in found])]
    apart = np.all(edge[:, :, None] != triangles[which][:, None, :], axis=(1, 2))
    which, edge = which[apart], edge[apart]
    return np.unique(which[_pass_through(points[edge], corners[which])])


def _pass_through(
    edge: Float[np.ndarray, "pairs 2 3"], triangle: Float[np.ndarray, "pairs 3 3"]
) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    along = edge[:, 1] - edge[:, 0]
    u, v = triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    across = np.cross(along, v)
    volume = np.einsum("pi,pi->p", u, across)
    flat = np.abs(volume) < 1e-14 * np.linalg.norm(along, axis=1) ** 3
    scale = 1.0 / np.where(flat, 1.0, volume)
    offset = edge[:, 0] - triangle[:, 0]
    turned = np.cross(offset, u)
    first = scale * np.einsum("pi,pi->p", offset, across)
    second = scale * np.einsum("pi,pi->p", along, turned)
    share = scale * np.einsum("pi,pi->p", v, turned)
    inside = (first >= 0.0) & (second >= 0.0) & (first + second <= 1.0)
    return inside & (share >= 0.0) & (share <= 1.0) & ~flat
