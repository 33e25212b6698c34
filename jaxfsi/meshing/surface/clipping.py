"""Surfaces cut by the planes of openings, each within a ball about the opening.

Vertices near a plane are moved onto it first, so that no cut leaves a tiny triangle; triangles
across a plane are split. What lies beyond the planes then falls off as other components.
"""

import contextlib
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxfsi.measures import triangle_areas
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.opening import Opening

# Vertices within this share of the local edge of a plane are moved onto it; less where so many
# moved that the border pinches.
_SNAPS = (0.35, 0.2, 0.1, 0.03)
_ON_PLANE = 1e-9  # [cm]


class ClippedSurface(NamedTuple):
    """The part of a surface between its openings.

    Attributes:
        surface: triangles between the openings.
        loops: vertices of the closed border at each opening, one after the other; the surface
            lies to the left of a loop seen from outside.
    """

    surface: Surface
    loops: tuple[Int[np.ndarray, " loop"], ...]


def clip(surface: Surface, openings: tuple[Opening, ...], *, what: str) -> ClippedSurface:
    """Cut a surface by the planes of its openings and keep the component with most openings.

    Args:
        surface: vessels that run on beyond their openings.
        openings: planes, each acting within a ball.
        what: name of the surface, for messages.

    Raises:
        ValueError: a plane misses the vessel, does not cut it through, or the vessels behind two
            openings do not join.
    """
    for snap in _SNAPS[:-1]:
        with contextlib.suppress(ValueError):
            return _clip(surface, openings, what, snap)
    return _clip(surface, openings, what, _SNAPS[-1])


def _clip(
    surface: Surface, openings: tuple[Opening, ...], what: str, snap: float
) -> ClippedSurface:
    points, triangles = surface
    for opening in openings:
        points, triangles = _cut(points, triangles, opening, what, snap)
    component = _components(len(points), triangles)[triangles[:, 0]]
    at_opening = [np.unique(component[_touching(points, triangles, o)]) for o in openings]
    count = np.bincount(np.concatenate(at_opening), minlength=component.max() + 1)
    area = np.bincount(component, weights=triangle_areas(points, triangles))
    main = int(np.lexsort((area, count))[-1])
    for opening, touching in zip(openings, at_opening, strict=True):
        if main not in touching:
            raise ValueError(
                f"the {what} at opening {opening.name!r} is not joined to the rest: the vessels do"
                " not touch. Let the vessel begin inside the one it leaves, or check positions and"
                " units."
            )
    kept = triangles[component == main]
    used, renumbered = np.unique(kept, return_inverse=True)
    clipped = Surface(points[used], renumbered.reshape(-1, 3))
    return ClippedSurface(clipped, find_loops(clipped, openings, what=what))


def find_loops(
    surface: Surface,
    openings: tuple[Opening, ...],
    *,
    what: str,
    tolerance: float = 1e-3,
) -> tuple[Int[np.ndarray, " loop"], ...]:
    """The closed border of a surface at each opening.

    Args:
        surface: with one border for each opening.
        openings: planes.
        what: name of the surface, for messages.
        tolerance: distance from the plane over the size of the loop that is taken as on it.

    Raises:
        ValueError: an opening has no border, or several.
    """
    loops = border_loops(surface.triangles)
    found: list[np.ndarray] = []
    for opening in openings:
        matching = []
        for loop in loops:
            from_centre = surface.points[loop] - opening.centre
            size = np.linalg.norm(np.ptp(surface.points[loop], axis=0))
            flat = np.abs(from_centre @ opening.normal).max() < tolerance * size
            if flat and np.linalg.norm(from_centre, axis=1).max() < opening.radius:
                matching.append(loop)
        if len(matching) != 1:
            raise ValueError(
                f"the plane of opening {opening.name!r} cuts the {what} in {len(matching)} closed"
                " curves instead of one. Move the opening along its vessel, or change its radius"
                " so that the ball holds this vessel and nothing else."
            )
        found.append(matching[0])
    if len(loops) != len(openings):
        raise ValueError(
            f"the {what} has {len(loops)} borders but {len(openings)} openings. Give each end of a"
            " vessel an opening, and bounds that hold the whole domain."
        )
    return tuple(found)


def _cut(
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    opening: Opening,
    what: str,
    share_snapped: float,
) -> tuple[Float[np.ndarray, "new 3"], Int[np.ndarray, "newtriangles 3"]]:
    inside = np.linalg.norm(points - opening.centre, axis=1) < opening.radius
    height = (points - opening.centre) @ opening.normal
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    local = np.full(len(points), np.inf)
    np.minimum.at(local, edges.ravel(), np.repeat(length, 2))
    snap = inside & (np.abs(height) < share_snapped * local)
    points = points - np.where(snap, height, 0.0)[:, None] * opening.normal
    height = np.where(snap, 0.0, height)
    low, high = edges.T
    crossed = inside[low] & inside[high] & (height[low] * height[high] < 0.0)
    if not crossed.any() and not snap.any():
        raise ValueError(
            f"the plane of opening {opening.name!r} misses the {what}. Put its centre inside the"
            " vessel and its radius (in cm) beyond the vessel's wall."
        )
    share = height[low[crossed]] / (height[low[crossed]] - height[high[crossed]])
    added = points[low[crossed]] + share[:, None] * (points[high[crossed]] - points[low[crossed]])
    keys = edges[crossed] @ np.array([len(points), 1])
    triangles = _split(triangles, keys, len(points))
    points = np.concatenate([points, added])
    height = np.concatenate([height, np.zeros(len(added))])
    inside = np.concatenate([inside, np.ones(len(added), dtype=bool)])
    outer = np.all(inside[triangles] & (height[triangles] >= -_ON_PLANE), axis=1)
    # Triangles in the plane itself are no part of the wall either.
    return points, triangles[~outer]


def _split(
    triangles: Int[np.ndarray, "triangles 3"], keys: Int[np.ndarray, " cut"], count: int
) -> Int[np.ndarray, "new 3"]:
    """Split triangles at cut edges; the new vertex of ``keys[i]`` is ``count + i``."""

    def added(a: Int[np.ndarray, " n"], b: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        if len(keys) == 0:
            return np.full(len(a), -1)
        key = np.minimum(a, b) * count + np.maximum(a, b)
        place = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
        return np.where(keys[place] == key, count + place, -1)

    a, b, c = triangles.T
    cuts = np.stack([added(a, b), added(b, c), added(c, a)], axis=1)
    number = (cuts >= 0).sum(axis=1)
    pieces = [triangles[number == 0]]
    for turn in range(3):
        a, b, c = np.roll(triangles, -turn, axis=1).T
        ab, bc, _ = np.roll(cuts, -turn, axis=1).T
        one = (number == 1) & (ab >= 0)
        pieces += [np.stack([a, ab, c], axis=1)[one], np.stack([ab, b, c], axis=1)[one]]
        two = (number == 2) & (ab >= 0) & (bc >= 0)
        pieces += [
            np.stack([ab, b, bc], axis=1)[two],
            np.stack([a, ab, bc], axis=1)[two],
            np.stack([a, bc, c], axis=1)[two],
        ]
    return np.concatenate(pieces)


def _touching(
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    opening: Opening,
) -> Bool[np.ndarray, " triangles"]:
    """Triangles with a vertex in the plane of an opening and in its ball."""
    height = (points - opening.centre) @ opening.normal
    ball = np.linalg.norm(points - opening.centre, axis=1) < opening.radius
    return (ball & (np.abs(height) < _ON_PLANE))[triangles].any(axis=1)


def _components(
    count: int, triangles: Int[np.ndarray, "triangles 3"]
) -> Int[np.ndarray, " points"]:
    edges = triangles[:, [[0, 1], [1, 2]]].reshape(-1, 2)
    ones = np.ones(len(edges), dtype=np.int8)
    graph = coo_array((ones, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _border_edges(triangles: Int[np.ndarray, "triangles 3"]) -> Int[np.ndarray, "edges 2"]:
    """Directed edges that belong to one triangle only, in its sense of rotation."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, back, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[count[back.ravel()] == 1]


def border_loops(triangles: Int[np.ndarray, "triangles 3"]) -> list[Int[np.ndarray, " _"]]:
    """Closed borders of triangles, each in their sense of rotation, by their lowest vertex."""
    edges = _border_edges(triangles)
    following = dict(edges.tolist())
    loops = []
    while following:
        start, node = following.popitem()
        loop = [start]
        while node != start:
            loop.append(node)
            if node not in following:
                break
            node = following.pop(node)
        loops.append(np.array(loop))
    return sorted(loops, key=lambda loop: int(loop.min()))


def on_planes(
    clipped: ClippedSurface, openings: tuple[Opening, ...]
) -> Float[np.ndarray, "points 3"]:
    """Normals of the planes that vertices of loops have to stay in, zero elsewhere."""
    normals = np.zeros_like(clipped.surface.points)
    for loop, opening in zip(clipped.loops, openings, strict=True):
        normals[loop] = opening.normal
    return normals


def flatten_loops(clipped: ClippedSurface, openings: tuple[Opening, ...]) -> ClippedSurface:
    """Move the loops exactly into the planes of their openings."""
    points = clipped.surface.points.copy()
    for loop, opening in zip(clipped.loops, openings, strict=True):
        height = (points[loop] - opening.centre) @ opening.normal
        points[loop] -= height[:, None] * opening.normal
    return ClippedSurface(Surface(points, clipped.surface.triangles), clipped.loops)
