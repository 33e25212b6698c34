"""Planar triangles that close a cut vessel: a disc over the blood, an annulus over the wall.

Both come from the Delaunay triangulation of their border and of points inside: a hexagonal
lattice in the disc, rings between the two borders in the annulus. Triangles outside the borders
are dropped; every border edge must be there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, KDTree

from jaxfsi.meshing.isolate import MeshingError
from jaxfsi.meshing.surface.sizes import SizeField, size_at
from jaxfsi.opening import Opening
from jaxfsi.polygons import inside_polygon

# Points of a plane; several sets of them, of any length each, meet in one signature.
Plane = Float[np.ndarray, "_ 2"]

# Lattice points nearer to the border than this share of the local size are left out.
_CLEARANCE = 0.6
_SMOOTHINGS = 5


class Cap(NamedTuple):
    """Triangles over the points of a border and new ones inside.

    Attributes:
        added: points inside the border [cm].
        triangles: of indices into the border's points followed by the added ones; their normals
            point along the opening's.
    """

    added: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]


def disc(loop: Float[np.ndarray, "loop 3"], opening: Opening, field: SizeField) -> Cap:
    """Close a loop by triangles of the local size.

    Args:
        loop: closed border, without a repeated point [cm].
        opening: plane of the loop.
        field: element size.

    Raises:
        MeshingError: the border crosses itself.
    """
    frame = _frame(opening)
    border = (loop - opening.centre) @ frame.T
    inside = _graded_lattice(border, lambda x: size_at(field, opening.centre + x @ frame))
    inner = _triangulate(border, inside, [border], opening.name)
    for _ in range(_SMOOTHINGS):
        inside = _smoothed(border, inside, inner)
        inner = _triangulate(border, inside, [border], opening.name)
    return Cap(opening.centre + inside @ frame, inner)


def annulus(
    inner: Float[np.ndarray, "inner 3"],
    outer: Float[np.ndarray, "outer 3"],
    opening: Opening,
    field: SizeField,
    *,
    layers: int,
) -> Cap:
    """Fill the wall between two loops in at least so many layers.

    Args:
        inner: border of the lumen [cm].
        outer: border of the wall, about the inner one [cm].
        opening: plane of both loops.
        field: element size.
        layers: least number of layers across.

    Raises:
        MeshingError: the borders cross.
    """
    frame = _frame(opening)
    borders = [(loop - opening.centre) @ frame.T for loop in (inner, outer)]
    if not np.all(inside_polygon(borders[0], borders[1])):
        raise MeshingError(
            f"the lumen leaves the wall at opening {opening.name!r}. Give the wall more thickness"
            " there, or move the opening."
        )
    spacing = size_at(field, np.concatenate([inner, outer])).mean()
    rings = _rings(borders[0], borders[1], spacing, layers)
    border = np.concatenate(borders)
    triangles = _triangulate(border, rings, borders, opening.name)
    return Cap(opening.centre + rings @ frame, triangles)


def _frame(opening: Opening) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors of the plane, right-handed with its normal."""
    seed = np.eye(3)[np.argmin(np.abs(opening.normal))]
    first = np.cross(opening.normal, seed)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(opening.normal, first)])


def _graded_lattice(border: Plane, size) -> Plane:
    """Hexagonal lattices of halving spacing, each where the local size asks for it.

    A point of a coarser lattice stays where the size is large, its finer neighbours elsewhere;
    points too close to kept ones are left out.
    """
    low, high = border.min(axis=0), border.max(axis=0)
    largest = float(size(0.5 * (low + high)[None])[0])
    smallest = float(np.min(size(border)))
    kept = border
    added = np.zeros((0, 2))
    clearance = size(border)
    steps = max(int(np.ceil(np.log(max(largest / smallest, 1.0)) / np.log(1.4))), 0)
    for spacing in np.maximum(largest * 1.4 ** -np.arange(steps + 1), smallest):
        points = _hexagons(low, high, float(spacing))
        points = points[inside_polygon(points, border)]
        wanted = size(points) if len(points) else np.zeros(0)
        points = points[(wanted >= 0.85 * spacing) & (wanted < 1.4 * spacing * 1.2)]
        if len(points) == 0:
            continue
        distance, index = KDTree(kept).query(points)
        reach = np.concatenate([_CLEARANCE * clearance, np.full(len(added), 0.85 * spacing)])
        points = points[distance > np.maximum(reach[index], _CLEARANCE * spacing)]
        added = np.concatenate([added, points])
        kept = np.concatenate([border, added])
    return added


def _hexagons(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], spacing: float) -> Plane:
    height = 0.5 * np.sqrt(3.0) * spacing
    rows = np.arange(int(np.ceil((high[1] - low[1]) / height)) + 1)
    columns = np.arange(int(np.ceil((high[0] - low[0]) / spacing)) + 2)
    x = low[0] + spacing * (columns[None] - 0.5 * (rows[:, None] % 2))
    y = low[1] + height * np.broadcast_to(rows[:, None], x.shape)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _rings(inner: Plane, outer: Plane, spacing: float, layers: int) -> Plane:
    """Rings of points between two loops at equal shares of the way."""
    distance, _ = KDTree(outer).query(inner)
    thickness = float(np.median(distance))
    count = max(layers, round(thickness / spacing))
    # The way from a fine point of the inner loop to the outer one along the mean direction.
    dense = _resampled(inner, spacing=0.25 * min(spacing, thickness))
    away = _foot(dense, outer)
    rings = []
    for layer in range(1, count):
        ring = dense + (layer / count) * (away - dense)
        wanted = max(min(spacing, 1.5 * thickness / count), 0.7 * thickness / count)
        ring = _resampled(ring, spacing=wanted, phase=0.5 * (layer % 2))
        rings.append(ring)
    return np.concatenate(rings) if rings else np.zeros((0, 2))


def _foot(points: Plane, loop: Plane) -> Plane:
    """Nearest points on a closed polygon."""
    near = np.asarray(KDTree(loop).query(points, k=min(4, len(loop)))[1])
    best = np.full(len(points), np.inf)
    foot = np.zeros_like(points)
    for column in near.T:
        for turn in (0, -1):
            a, b = loop[(column + turn) % len(loop)], loop[(column + turn + 1) % len(loop)]
            side = b - a
            share = np.einsum("pk,pk->p", points - a, side) / np.einsum("pk,pk->p", side, side)
            x = a + np.clip(share, 0.0, 1.0)[:, None] * side
            distance = np.linalg.norm(points - x, axis=1)
            closer = distance < best
            best[closer], foot[closer] = distance[closer], x[closer]
    return foot


def _resampled(loop: Plane, *, spacing: float, phase: float = 0.0) -> Plane:
    """Points at equal distances along a closed polygon."""
    closed = np.concatenate([loop, loop[:1]])
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(round(s[-1] / spacing), 6)
    at = (np.arange(count) + phase) * s[-1] / count
    return np.stack([np.interp(at, s, closed[:, i]) for i in range(2)], axis=1)


def _triangulate(
    border: Plane, inside: Plane, loops: list[Plane], name: str
) -> Int[np.ndarray, "triangles 3"]:
    points = np.concatenate([border, inside])
    triangles = Delaunay(points).simplices.astype(np.int64)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles = np.where((area < 0.0)[:, None], triangles[:, ::-1], triangles)
    centre = (a + b + c) / 3.0
    within = np.zeros(len(triangles), dtype=bool)
    for loop in loops:
        within ^= inside_polygon(centre, loop)
    triangles = triangles[within]
    _check_border(triangles, loops, name)
    return triangles


def _check_border(triangles: Int[np.ndarray, "triangles 3"], loops: list[Plane], name: str) -> None:
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    rim = edges[count == 1]
    starts = np.concatenate([[0], np.cumsum([len(loop) for loop in loops])])
    wanted = np.concatenate(
        [
            np.stack([np.arange(n), np.roll(np.arange(n), -1)], axis=1) + start
            for n, start in zip(np.diff(starts), starts, strict=False)
        ]
    )
    wanted = np.unique(np.sort(wanted, axis=1), axis=0)
    if not np.array_equal(rim, wanted):
        raise MeshingError(
            f"the cap of opening {name!r} does not fill its border. Use a finer preset, or move"
            " the opening to a rounder part of the vessel."
        )


def _smoothed(border: Plane, inside: Plane, triangles: Int[np.ndarray, "triangles 3"]) -> Plane:
    """Move inner points to the mean of their neighbours."""
    points = np.concatenate([border, inside])
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    total = np.zeros_like(points)
    count = np.zeros(len(points))
    for a, b in (edges.T, edges.T[::-1]):
        np.add.at(total, a, points[b])
        np.add.at(count, a, 1.0)
    mean = total / np.maximum(count, 1.0)[:, None]
    return mean[len(border) :]
