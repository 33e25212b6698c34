"""The cut ends of a vessel surface: open loops, or flat caps that close it.

An open end is a loop of edges with one triangle. It is an end of a vessel where the loop is flat
and the surface arrives across its plane; where the surface arrives within the plane, the loop is a
hole in the wall, and only a small one can be closed without inventing anatomy.

A cap is a set of connected, nearly coplanar triangles. Flat places inside a wall are told from it
by four tests: most of its border is a sharp edge, it is flat compared with its size, roughly round,
and not tiny.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Float, Int

from jaxfsi.anatomy.surfaces.triangles import (
    Edges,
    Triangles,
    compacted,
    edges_of,
    neighbours,
    unit,
)
from jaxfsi.measures import enclosed_volume, triangle_normals

_COPLANAR_DEG = (2.0, 6.0, 15.0)
_SHARP_DEG = 40.0
_SHARP_SHARE = 0.9
_FLATNESS = 0.05  # root mean square distance from its plane, over its radius
_ROUNDNESS = 0.25  # 4π area / perimeter², of a slit of ellipticity 5: 0.37
_LOOP_FLATNESS = 0.1
_ACROSS = 0.6  # of the normal of the triangles at a loop along the normal of its plane
_SMALL_HOLE = 16  # edges round a hole that is closed without asking


class FlatEnd(NamedTuple):
    """Where a vessel surface ends.

    Attributes:
        loop: points round the end, in order; the surface lies to the left of each edge as seen
            from outside.
        centre: centroid of the flat face [cm].
        normal: unit normal of its plane, out of the vessel.
        radius: of the disc of the same area [cm].
    """

    loop: Int[np.ndarray, " loop"]
    centre: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]
    radius: float


def boundary_loops(surface: Triangles) -> list[Int[np.ndarray, " _"]]:
    """Closed loops of the edges that have one triangle, each in the direction of that triangle.

    Raises:
        ValueError: loops touch each other.
    """
    edges = edges_of(surface.faces)
    face, corner = np.nonzero(edges.shared_by[edges.of_face] == 1)
    start = surface.faces[face, corner]
    end = surface.faces[face, (corner + 1) % 3]
    if len(np.unique(start)) < len(start):
        raise ValueError(
            "open edges of the surface touch each other. Fill the holes in the segmentation tool."
        )
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    loops = []
    while following:
        first, current = following.popitem()
        loop = [first]
        while current != first:
            loop.append(current)
            current = following.pop(current)
        loops.append(np.array(loop))
    return loops


def flat_end(points: Float[np.ndarray, "points 3"], loop: Int[np.ndarray, " loop"]) -> FlatEnd:
    """Plane of a loop: its vector area ½ Σ p × p'; the surface runs round it clockwise."""
    ring = points[loop]
    middle = ring.mean(axis=0)
    arms = ring - middle
    cross = np.cross(arms, np.roll(arms, -1, axis=0)) / 2.0
    vector = np.sum(cross, axis=0)
    area = float(np.linalg.norm(vector))
    if area == 0.0:
        return FlatEnd(loop, middle, np.array([0.0, 0.0, 1.0]), 0.0)
    normal = -vector / area
    share = -cross @ normal / area
    centre = middle + np.sum(share[:, None] * (arms + np.roll(arms, -1, axis=0)), axis=0) / 3.0
    return FlatEnd(loop, centre, normal, float(np.sqrt(area / np.pi)))


def _filled(surface: Triangles, loops: list[Int[np.ndarray, " _"]]) -> Triangles:
    """Close loops by fans about their mean points."""
    points, faces = surface
    for loop in loops:
        centre = len(points)
        points = np.concatenate([points, points[loop].mean(axis=0)[None]])
        fan = np.stack([np.roll(loop, -1), loop, np.full(len(loop), centre)], axis=1)
        faces = np.concatenate([faces, fan])
    return Triangles(points, faces)


def outwards(surface: Triangles) -> Triangles:
    """The surface, turned inside out if the volume within its closed loops is negative."""
    closed = _filled(surface, boundary_loops(surface))
    if enclosed_volume(*closed) < 0.0:
        return Triangles(surface.points, surface.faces[:, ::-1])
    return surface


def open_ends(surface: Triangles) -> tuple[Triangles, list[FlatEnd]]:
    """The ends of a surface that was delivered open; small holes are closed.

    Args:
        surface: consistently wound outwards.

    Raises:
        ValueError: a loop is neither a flat end of a vessel nor a small hole.
    """
    normals = unit(triangle_normals(*surface))
    ends, holes, faults = [], [], []
    for loop in boundary_loops(surface):
        end = flat_end(surface.points, loop)
        offset = (surface.points[loop] - end.centre) @ end.normal
        flatness = float(np.sqrt(np.mean(offset**2))) / max(end.radius, 1e-12)
        at_loop = np.isin(surface.faces, loop).sum(axis=1) >= 2
        arriving = float(np.mean(np.abs(normals[at_loop] @ end.normal)))
        if flatness <= _LOOP_FLATNESS and arriving <= _ACROSS:
            ends.append(end)
        elif len(loop) <= _SMALL_HOLE:
            holes.append(loop)
        else:
            where = ", ".join(f"{x:.3g}" for x in end.centre)
            reason = "a hole in the wall" if flatness <= _LOOP_FLATNESS else "a ragged edge"
            faults.append(f"{reason} of radius {end.radius:.2g} cm near ({where}) cm")
    if faults:
        raise ValueError(
            f"the surface is open and cannot be capped: {'; '.join(faults)}. Fill the holes and"
            " cut the vessel ends flat in the segmentation tool."
        )
    return _filled(surface, holes), ends


def without_caps(surface: Triangles) -> tuple[Triangles, list[FlatEnd]]:
    """Take the flat caps off a closed surface.

    Args:
        surface: closed, wound outwards.

    Returns:
        The surface without its caps, and its ends in order of their size, largest first.
    """
    edges = edges_of(surface.faces)
    taken = np.zeros(len(surface.faces), dtype=bool)
    for angle in _COPLANAR_DEG:
        region = _coplanar_regions(surface, edges, angle, ~taken)
        taken |= _is_cap(surface, edges, region)
    if np.all(taken):
        return surface, []
    kept = compacted(Triangles(surface.points, surface.faces[~taken]))
    return kept, ends_of(kept)


def ends_of(surface: Triangles) -> list[FlatEnd]:
    """All open loops as ends of a vessel, largest first."""
    ends = [flat_end(surface.points, loop) for loop in boundary_loops(surface)]
    return sorted(ends, key=lambda end: -end.radius)


def _coplanar_regions(
    surface: Triangles, edges: Edges, angle_deg: float, free: Bool[np.ndarray, " faces"]
) -> Int[np.ndarray, " faces"]:
    normals = unit(triangle_normals(*surface))
    pairs, _ = neighbours(edges)
    cosine = np.sum(normals[pairs[:, 0]] * normals[pairs[:, 1]], axis=1)
    joined = (cosine > np.cos(np.radians(angle_deg))) & free[pairs[:, 0]] & free[pairs[:, 1]]
    links = pairs[joined]
    n = len(normals)
    graph = scipy.sparse.coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(n, n))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def _is_cap(
    surface: Triangles, edges: Edges, region: Int[np.ndarray, " faces"]
) -> Bool[np.ndarray, " faces"]:
    """Triangles of the regions that pass the tests of a cap."""
    doubled = triangle_normals(*surface)
    size = np.linalg.norm(doubled, axis=1) / 2.0
    n = int(region.max()) + 1
    area = np.bincount(region, size, n)
    vector = np.stack([np.bincount(region, doubled[:, i] / 2.0, n) for i in range(3)], axis=1)
    normal = unit(vector)
    middle = surface.points[surface.faces].mean(axis=1)
    centre = np.stack([np.bincount(region, size * middle[:, i], n) for i in range(3)], axis=1)
    centre /= np.maximum(area, 1e-300)[:, None]
    corners = surface.points[surface.faces] - centre[region][:, None]
    height = np.einsum("fij,fj->fi", corners, normal[region])
    mean_square = np.bincount(region, size * np.mean(height**2, axis=1), n) / np.maximum(
        area, 1e-300
    )
    pairs, corner = neighbours(edges)
    ends = surface.points[surface.faces[pairs[:, 0], (corner[:, 0] + 1) % 3]]
    length = np.linalg.norm(ends - surface.points[surface.faces[pairs[:, 0], corner[:, 0]]], axis=1)
    unit_normals = unit(doubled)
    cosine = np.sum(unit_normals[pairs[:, 0]] * unit_normals[pairs[:, 1]], axis=1)
    border = region[pairs[:, 0]] != region[pairs[:, 1]]
    sharp = border & (cosine < np.cos(np.radians(_SHARP_DEG)))
    perimeter, sharp_length = (
        sum(np.bincount(region[pairs[:, i]], length * chosen, n) for i in (0, 1))
        for chosen in (border, sharp)
    )
    radius = np.sqrt(area / np.pi)
    cap = (
        (sharp_length > _SHARP_SHARE * perimeter)
        & (np.sqrt(mean_square) < _FLATNESS * radius)
        & (4.0 * np.pi * area > _ROUNDNESS * perimeter**2)
        & (np.linalg.norm(vector, axis=1) > 0.9 * area)
    )
    # Flat faces that meet in a sharp edge belong to a machine part, not to a vessel.
    clash = border & cap[region[pairs[:, 0]]] & cap[region[pairs[:, 1]]]
    cap[np.unique(region[pairs[clash]])] = False
    return cap[region] & (radius > 3.0 * np.sqrt(np.median(size)))[region]
