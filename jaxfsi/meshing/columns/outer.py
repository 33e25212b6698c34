"""The outer surface of the wall with the ends of the columns in it.

The triangles over which columns stand replace the part of the outer surface that they cover. Where
the holes between them are wide, islands of the outer surface are left in them; the least
triangulation (`jaxfsi.meshing.columns.hole`) closes them from border to border. mmgs then brings
all that is no end of a column to the size asked for.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from jaxfsi.anatomy.anatomy import PointFunction
from jaxfsi.faces import triangle_edges, unique_rows
from jaxfsi.measures import triangle_normals
from jaxfsi.meshing.columns.hole import joined, least_triangulation
from jaxfsi.meshing.columns.zone import SurfaceGraph
from jaxfsi.meshing.surface.clipping import border_loops
from jaxfsi.meshing.surface.flips import flipped
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import gradients, triangle_qualities
from jaxfsi.meshing.surface.remesh import remesh_surfaces
from jaxfsi.meshing.surface.sizes import SizeField, size_at

# Distance of an island from the ends of columns over the element size.
_GAP = 0.8
_CUTS = 1
# Cosine between the normal of a triangle over a hole and that of the surface.
_LEAST_COSINE = 0.3
# Quality of a triangle over a hole.
_LEAST_QUALITY = 0.05
# Quality of a triangle beside the ends below which its longest edge may be turned.
_FLIPPED_QUALITY = 0.4
_SAME_POINT = 1e-9
_STEP = 1e-3  # of the differences for normals [cm]


class Stitched(NamedTuple):
    """An outer surface, or why there is none.

    Attributes:
        surface: its first vertices are those of the columns, in their order.
        failed: ends of columns beside which a hole cannot be closed; the surface counts only
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
    islands, failed = _islands(wall, left, ends, borders)
    if failed.any():
        return Stitched(ends, failed)
    shift = len(ends.points)
    points = np.concatenate([ends.points, left.points])
    islands = [island + shift for island in islands]
    slope = gradients(f, points, step=_STEP)
    normals = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    taken = triangle_edges(np.concatenate([ends.triangles, left.triangles + shift]))
    patch = [left.triangles + shift]
    for hole in _holes(points, borders, islands):
        polygon = joined(points, [border[::-1] for border in hole])
        triangles = least_triangulation(polygon, points, normals, f, taken.reshape(-1, 2))
        poor = triangles[_poor(points, triangles, normals)]
        failed[poor[poor < shift]] = True
        patch.append(triangles)
    if failed.any():
        return Stitched(ends, failed)
    return _remeshed(points, np.concatenate(patch), ends, np.concatenate(borders), field, deviation)


def _islands(
    wall: Surface, left: Surface, ends: Surface, borders: list[Int[np.ndarray, " _"]]
) -> tuple[list[Int[np.ndarray, " _"]], Bool[np.ndarray, " ends"]]:
    """Borders of what is left that are no rim of an opening, and ends too near to such a rim."""
    loops, islands = border_loops(left.triangles), []
    failed = np.zeros(len(ends.points), dtype=bool)
    rims = [wall.points[rim] for rim in border_loops(wall.triangles)]
    used = np.concatenate(borders)
    tree = KDTree(ends.points[used])
    for loop in loops:
        there = KDTree(left.points[loop])
        shared = [np.asarray(there.query(rim)[0]) < _SAME_POINT for rim in rims]
        if not any(share.any() for share in shared):
            islands.append(loop)
        for rim, share in zip(rims, shared, strict=True):
            if share.any() and not share.all():
                failed[used[tree.query(rim[~share])[1]]] = True
    return islands, failed


def _holes(
    points: Float[np.ndarray, "points 3"],
    borders: list[Int[np.ndarray, " _"]],
    islands: list[Int[np.ndarray, " _"]],
) -> list[list[Int[np.ndarray, " _"]]]:
    """Borders of ends and of what is left, hole by hole.

    An island lies in the hole of every border that is next to it.
    """
    count = len(borders)
    used = np.concatenate(borders)
    owner = np.repeat(np.arange(count), [len(border) for border in borders])
    tree = KDTree(points[used])
    rows = [owner[tree.query(points[island])[1]] for island in islands]
    columns = [np.full(len(row), count + number) for number, row in enumerate(rows)]
    total = count + len(islands)
    link = (np.concatenate([*rows, [0]]), np.concatenate([*columns, [0]]))
    graph = csr_array((np.ones(len(link[0])), link), shape=(total, total))
    group = connected_components(graph, directed=False)[1]
    loops = [*borders, *islands]
    return [
        [loops[number] for number in np.flatnonzero(group == hole)] for hole in np.unique(group)
    ]


def _poor(
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    normals: Float[np.ndarray, "points 3"],
) -> Bool[np.ndarray, " triangles"]:
    """Whether triangles are folded or slivers."""
    normal = triangle_normals(points, triangles)
    outwards = normals[triangles].sum(axis=1)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(outwards, axis=1)
    folded = np.einsum("tk,tk->t", normal, outwards) < _LEAST_COSINE * size
    return folded | (triangle_qualities(points, triangles) < _LEAST_QUALITY)


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


def _remeshed(
    points: Float[np.ndarray, "points 3"],
    patch: Int[np.ndarray, "triangles 3"],
    ends: Surface,
    border: Int[np.ndarray, " border"],
    field: SizeField,
    deviation: float,
) -> Stitched:
    """The columns' ends and a patch beside them, brought to the size asked for.

    Edges between two ends stay, also across a hole, so that as few triangles as can be close it;
    those of slivers are turned afterwards.
    """
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
    surface = _compact_after(
        np.concatenate([ends.points, new.points]),
        np.concatenate([ends.triangles, node[new.triangles]]),
        len(ends.points),
    )
    if failed.any():
        return Stitched(surface, failed)
    first = len(ends.triangles)
    return Stitched(flipped(surface, first=first, least_quality=_FLIPPED_QUALITY), failed)


def _compact_after(
    points: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"], first: int
) -> Surface:
    """Leave out points that no triangle uses, but none of the first."""
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    used[:first] = True
    number = np.cumsum(used) - 1
    return Surface(points[used], number[triangles])
