"""Half the local width of a lumen: the radius of the largest ball that touches its surface.

The ball touches the surface at p with its centre at c = p − r n and shrinks until no other point
of the surface lies inside. With q the surface point nearest to the centre, the ball through p and
q has the radius::

    r = |p − q|² / (2 n·(p − q))

Source: Ma, Bae, Choi 2012, "3D medial axis point approximation using nearest neighbors and the
normal field", Vis. Comput. 28:7, algorithm 1. In a slit it is half the minor axis, where curvature
would say anything.
"""

import numpy as np
import scipy.sparse
import scipy.spatial
from jaxtyping import Float, Int

from jaxfsi.anatomy.surfaces.edits import mean_of_neighbours
from jaxfsi.anatomy.surfaces.triangles import Triangles, edges_of, vertex_normals
from jaxfsi.measures import edge_lengths

_SWEEPS = 30
_EPS = 1e-2
_COARSE = 4.0  # spacing of the few points over the median edge
_SMALL = 8.0  # radius of a small ball over that spacing
_LEAST_ANGLE_DEG = 35.0  # nearer touching points are noise of the surface, not its other side
_NEIGHBOURS = 9
_SMOOTHING = 10
_LEAST_STEP = 1e-4  # keeps edges between points of one ball from being free [cm]


def medial_radius(surface: Triangles) -> Float[np.ndarray, " points"]:
    """Radius of the inscribed ball at each point of a closed surface [cm], smoothed.

    The median over nearby points of the same side removes outliers, ten mean values over joined
    points the rest.

    Args:
        surface: closed, wound outwards, with triangles smaller than the lumen is wide.
    """
    normals = vertex_normals(surface)
    tree = scipy.spatial.KDTree(surface.points)
    radius = _ball_radius(surface, normals, tree)
    near = np.array(tree.query(surface.points, k=min(_NEIGHBOURS, len(radius)))[1])
    near[:, 0] = np.arange(len(radius))
    same_side = np.einsum("nki,ni->nk", normals[near], normals) > 0.5
    same_side[:, 0] = True
    radius = np.nanmedian(np.where(same_side, radius[near], np.nan), axis=1)
    mean = mean_of_neighbours(surface)
    logarithm = np.log(radius)
    for _ in range(_SMOOTHING):
        logarithm = (logarithm + mean @ logarithm) / 2.0
    return np.exp(logarithm)


def medial_path(
    surface: Triangles,
    radius: Float[np.ndarray, " points"],
    first: Int[np.ndarray, " first"],
    last: Int[np.ndarray, " last"],
) -> tuple[Float[np.ndarray, "path 3"], Float[np.ndarray, " path"]]:
    """A way through the middle of a lumen, along the centres of the inscribed balls.

    The way over joined surface points of least ∫ ds / r², s measured between the centres of their
    balls, so that it keeps to the widest places.

    Args:
        surface: closed, wound outwards.
        radius: of the inscribed ball at each point [cm].
        first: points to start from, any of them.
        last: points to arrive at, any of them.

    Returns:
        Centres on the way [cm] and the radius there [cm].
    """
    centres = surface.points - radius[:, None] * vertex_normals(surface)
    ends = edges_of(surface.faces).ends
    span = np.linalg.norm(centres[ends[:, 1]] - centres[ends[:, 0]], axis=1)
    cost = (span + _LEAST_STEP) / (radius[ends[:, 0]] * radius[ends[:, 1]])
    n = len(centres)
    graph = scipy.sparse.csr_array((cost, (ends[:, 0], ends[:, 1])), shape=(n, n))
    reached, before, _ = scipy.sparse.csgraph.dijkstra(
        graph, directed=False, indices=first, min_only=True, return_predecessors=True
    )
    way = [int(last[np.argmin(reached[last])])]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return centres[way[::-1]], radius[way[::-1]]


def _ball_radius(
    surface: Triangles, normals: Float[np.ndarray, "points 3"], tree: scipy.spatial.KDTree
) -> Float[np.ndarray, " points"]:
    """Radii found among few of the points first; small balls then shrink among all of them.

    A coarse set of points of spacing a makes a ball of radius r too large by about a²/8r.
    """
    cell = _COARSE * float(np.median(edge_lengths(surface.points, edges_of(surface.faces).ends)))
    place = np.floor(surface.points / cell).astype(np.int64)
    _, few = np.unique(place, axis=0, return_index=True)
    start = np.full(len(normals), float(np.linalg.norm(np.ptp(surface.points, axis=0))) / 2.0)
    coarse = scipy.spatial.KDTree(surface.points[few])
    radius = _shrunk(surface.points, normals, coarse, start)
    small = np.flatnonzero(radius < _SMALL * cell)
    radius[small] = _shrunk(surface.points[small], normals[small], tree, radius[small])
    return radius


def _shrunk(
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    tree: scipy.spatial.KDTree,
    start: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " points"]:
    """Balls that touch the points shrink from ``start`` until no point of the tree is inside."""
    radius = start.copy()
    active = np.arange(len(points))
    cosine_limit = np.cos(np.radians(_LEAST_ANGLE_DEG))
    for _ in range(_SWEEPS):
        p, n, r = points[active], normals[active], radius[active]
        # eps spares a search among the many points at the distance of an empty ball.
        distance, nearest = tree.query(p - r[:, None] * n, eps=_EPS)
        q = tree.data[nearest]
        arm = p - q
        across = np.einsum("ij,ij->i", arm, n)
        shrinks = (distance < r * (1.0 - _EPS)) & (across > 0.0)
        smaller = np.einsum("ij,ij->i", arm, arm) / np.where(shrinks, 2.0 * across, 1.0)
        from_q = (p - smaller[:, None] * n - q) / np.maximum(smaller, 1e-300)[:, None]
        # cosine of the angle between p and q as seen from the centre of the new ball
        shrinks &= -np.einsum("ij,ij->i", n, from_q) < cosine_limit
        radius[active[shrinks]] = smaller[shrinks]
        active = active[shrinks]
        if len(active) == 0:
            break
    return radius
