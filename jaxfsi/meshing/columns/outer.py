"""The outer surface of the wall with the ends of the columns in it.

The triangles over which columns stand replace the part of the outer surface that they cover. What
is left of it, cut into small triangles, ends a little off their border; a strip of triangles
closes the gap. mmgs then brings all that is no end of a column to the size asked for.

The strip between two closed borders is the one whose squared edges across have the least sum
(dynamic programming; Fuchs, Kedem & Uselton 1977, Comm. ACM 20, 693-702).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxfsi.anatomy.anatomy import PointFunction
from jaxfsi.faces import triangle_edges, unique_rows
from jaxfsi.measures import triangle_normals
from jaxfsi.meshing.columns.zone import SurfaceGraph
from jaxfsi.meshing.surface.clipping import border_loops
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import gradients
from jaxfsi.meshing.surface.remesh import remesh_surfaces
from jaxfsi.meshing.surface.sizes import SizeField, size_at

# Width of the gap over the element size.
_GAP = 0.4
# Longest edge across the gap over the element size.
_LONGEST = 1.6
_CUTS = 2
# Cosine between the normal of a triangle in the gap and that of the surface.
_LEAST_COSINE = 0.3
_SAME_POINT = 1e-9
_STEP = 1e-3  # of the differences for normals [cm]


class Stitched(NamedTuple):
    """An outer surface, or why there is none.

    Attributes:
        surface: its first vertices are those of the columns, in their order.
        failed: ends of columns at whose border no strip was found; the surface counts only
            where there are none.
    """

    surface: Surface
    failed: Bool[np.ndarray, " ends"]


def stitched(
    wall: Surface,
    ends: Surface,
    rims: Bool[np.ndarray, " ends"],
    f: PointFunction,
    field: SizeField,
    *,
    deviation: float,
) -> Stitched:
    """Put the ends of columns into the outer surface.

    Args:
        wall: the outer surface, cut at the openings.
        ends: the triangles over which columns stand.
        rims: ends of columns at the rims of openings.
        f: approximate distance from the outer surface [cm].
        field: element size.
        deviation: of the remeshed part [cm].
    """
    failed = np.zeros(len(ends.points), dtype=bool)
    borders = [loop for loop in border_loops(ends.triangles) if not rims[loop].all()]
    if not borders:
        return Stitched(ends, failed)
    left = _uncovered(wall, ends, field)
    partners, failed = _partners(left, ends, borders)
    if failed.any():
        return Stitched(ends, failed)
    left, partners = _only_with(left, partners)
    shift = len(ends.points)
    points = np.concatenate([ends.points, left.points])
    strips = []
    for border, partner in zip(borders, partners, strict=True):
        strip = _strip(points, border, partner[::-1] + shift)
        failed[border] |= _poor(points, strip, border, f, field)
        strips.append(strip)
    if failed.any():
        return Stitched(ends, failed)
    patch = np.concatenate([left.triangles + shift, *strips])
    return _remeshed(points, patch, ends, np.concatenate(borders), field, deviation)


def subdivided(surface: Surface, times: int) -> Surface:
    """Every triangle cut into four, so many times."""
    points, triangles = surface
    for _ in range(times):
        edges, which = unique_rows(np.sort(triangle_edges(triangles).reshape(-1, 2), axis=1))
        ab, bc, ca = (len(points) + which.reshape(-1, 3)).T
        a, b, c = triangles.T
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        points = np.concatenate([points, points[edges].mean(axis=1)])
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    return Surface(points, triangles)


def _uncovered(wall: Surface, ends: Surface, field: SizeField) -> Surface:
    """The part of the outer surface that lies off the ends of columns, in small triangles."""
    fine = subdivided(wall, _CUTS)
    distance, _ = KDTree(subdivided(ends, _CUTS).points).query(fine.points)
    away = np.asarray(distance) > _GAP * size_at(field, fine.points)
    triangles = fine.triangles[away[fine.triangles].all(axis=1)]
    while True:
        graph = SurfaceGraph(triangles, len(fine.points))
        pinched = graph.pinched(np.arange(len(triangles)))
        if not pinched.any():
            return _compact(fine.points, triangles)
        triangles = triangles[~pinched[triangles].any(axis=1)]


def _compact(points: Float[np.ndarray, "points 3"], triangles: np.ndarray) -> Surface:
    used, renumbered = np.unique(triangles, return_inverse=True)
    return Surface(points[used], renumbered.reshape(-1, 3))


def _partners(
    left: Surface, ends: Surface, borders: list[Int[np.ndarray, " _"]]
) -> tuple[list[Int[np.ndarray, " _"]], Bool[np.ndarray, " ends"]]:
    """The border of the rest along each border of the columns, and ends that find none."""
    failed = np.zeros(len(ends.points), dtype=bool)
    loops = border_loops(left.triangles)
    if not loops:
        failed[np.concatenate(borders)] = True
        return [], failed
    nearest = []
    for border in borders:
        # The border of the rest must run along all of this one.
        ways = [KDTree(left.points[loop]).query(ends.points[border])[0].max() for loop in loops]
        nearest.append(int(np.argmin(ways)))
    for border, which in zip(borders, nearest, strict=True):
        failed[border] |= nearest.count(which) > 1
    return [loops[which] for which in nearest], failed


def _only_with(
    left: Surface, partners: list[Int[np.ndarray, " _"]]
) -> tuple[Surface, list[Int[np.ndarray, " _"]]]:
    """The patches of the rest that have a partner, and the partners in their numbering."""
    graph = SurfaceGraph(left.triangles, len(left.points))
    patch = graph.patches(np.arange(len(left.triangles)))
    of_point = np.zeros(len(left.points), dtype=np.int64)
    of_point[left.triangles] = patch[:, None]
    kept = np.isin(patch, of_point[np.concatenate(partners)])
    number = np.full(len(left.points), -1, dtype=np.int64)
    used = np.unique(left.triangles[kept])
    number[used] = np.arange(len(used))
    surface = Surface(left.points[used], number[left.triangles[kept]])
    return surface, [number[partner] for partner in partners]


def _strip(
    points: Float[np.ndarray, "points 3"], a: Int[np.ndarray, " a"], b: Int[np.ndarray, " b"]
) -> Int[np.ndarray, "triangles 3"]:
    """Triangles between two closed borders that run side by side; a has its patch to the left."""
    distance, near = (np.asarray(part) for part in KDTree(points[b]).query(points[a]))
    start = int(np.argmin(distance))
    a, b = np.roll(a, -start), np.roll(b, -int(near[start]))
    a, b = np.append(a, a[0]), np.append(b, b[0])
    across = np.sum((points[a][:, None] - points[b][None]) ** 2, axis=2)
    # Least sum from the first pair: best[i, j] = across[i, j] + min(best[i-1, j], best[i, j-1]).
    best = np.cumsum(across, axis=1)
    for i in range(1, len(a)):
        along = np.cumsum(across[i])
        best[i] = along + np.minimum.accumulate(best[i - 1] - along + across[i])
    triangles = []
    i, j = len(a) - 1, len(b) - 1
    while i or j:
        if j == 0 or (i and best[i - 1, j] <= best[i, j - 1]):
            triangles.append((a[i], a[i - 1], b[j]))
            i -= 1
        else:
            triangles.append((b[j - 1], b[j], a[i]))
            j -= 1
    return np.array(triangles)


def _poor(
    points: Float[np.ndarray, "points 3"],
    strip: Int[np.ndarray, "triangles 3"],
    border: Int[np.ndarray, " border"],
    f: PointFunction,
    field: SizeField,
) -> Bool[np.ndarray, " border"]:
    """Vertices of the border at which the strip is folded or too wide."""
    corners = points[strip]
    centre = corners.mean(axis=1)
    normals = triangle_normals(points, strip)
    slope = gradients(f, centre, step=_STEP)
    size = np.linalg.norm(normals, axis=1) * np.linalg.norm(slope, axis=1)
    folded = np.einsum("tk,tk->t", normals, slope) < _LEAST_COSINE * size
    across = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    bad = strip[folded | (across > _LONGEST * size_at(field, centre))]
    return np.isin(border, bad)


def _remeshed(
    points: Float[np.ndarray, "points 3"],
    patch: Int[np.ndarray, "triangles 3"],
    ends: Surface,
    border: Int[np.ndarray, " border"],
    field: SizeField,
    deviation: float,
) -> Stitched:
    """The columns' ends and a patch beside them, brought to the size asked for."""
    fixed = np.zeros(len(points), dtype=bool)
    fixed[border] = True
    edges = triangle_edges(patch).reshape(-1, 2)
    edges = edges[fixed[edges].all(axis=1)]
    used, renumbered = np.unique(patch, return_inverse=True)
    place = np.full(len(points), -1, dtype=np.int64)
    place[used] = np.arange(len(used))
    (new,) = remesh_surfaces(
        [Surface(points[used], renumbered.reshape(-1, 3))],
        field,
        deviation=deviation,
        kept=unique_rows(np.sort(place[edges], axis=1))[0],
    )
    distance, found = KDTree(new.points).query(ends.points[border])
    failed = np.zeros(len(ends.points), dtype=bool)
    failed[border] = np.asarray(distance) > _SAME_POINT
    node = len(ends.points) + np.arange(len(new.points))
    node[found] = border
    return Stitched(
        _compact_after(
            np.concatenate([ends.points, new.points]),
            np.concatenate([ends.triangles, node[new.triangles]]),
            len(ends.points),
        ),
        failed,
    )


def _compact_after(
    points: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"], first: int
) -> Surface:
    """Leave out points that no triangle uses, but none of the first."""
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    used[:first] = True
    number = np.cumsum(used) - 1
    return Surface(points[used], number[triangles])
