"""Plane cross-sections of a lumen: area, perimeter and caliper widths.

A section is a set of oriented straight pieces, with the lumen on their left; where they come from
(an implicit function or a triangulated surface) does not matter::

    A = ½ Σ (p × q),    perimeter = Σ |q − p|,    width(φ) = max x·n(φ) − min x·n(φ)

Only the part of the lumen that holds the centre of the section counts.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from jaxfsi.anatomy.anatomy import Centerline

_DIRECTIONS = 720

Segments = Float[np.ndarray, "_ 2 2"]


class Section(NamedTuple):
    """Size of one cross-section.

    Attributes:
        area: [cm²].
        perimeter: [cm].
        major: largest caliper width [cm].
        minor: smallest caliper width [cm].
    """

    area: float
    perimeter: float
    major: float
    minor: float


def measured_section(segments: Segments) -> Section:
    """Size of a closed outline of oriented pieces."""
    p, q = segments[:, 0], segments[:, 1]
    area = float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])) / 2.0
    angle = np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    heights = p @ np.stack([np.cos(angle), np.sin(angle)])
    widths = heights.max(axis=0) - heights.min(axis=0)
    perimeter = float(np.linalg.norm(q - p, axis=1).sum())
    return Section(abs(area), perimeter, float(widths.max()), float(widths.min()))


def plane_axes(
    normal: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Two unit vectors that span the plane across a normal, right-handed with it."""
    unit = normal / np.linalg.norm(normal)
    helper = np.zeros(3)
    helper[np.argmin(np.abs(unit))] = 1.0
    first = np.cross(unit, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(unit, first)


def _corner_values(values: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "triangles 3"]:
    lower = np.stack([values[:-1, :-1], values[1:, :-1], values[1:, 1:]], axis=-1)
    upper = np.stack([values[:-1, :-1], values[1:, 1:], values[:-1, 1:]], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def _zero_segments(x: Float[np.ndarray, " n"], values: Float[np.ndarray, "n n"]) -> Segments:
    """Zero line of a function on a square grid, linear on two triangles to each cell."""
    corners = _corner_values(values)
    xs = _corner_values(np.broadcast_to(x[:, None], values.shape))
    ys = _corner_values(np.broadcast_to(x[None, :], values.shape))
    inside = corners < 0.0
    count = inside.sum(axis=1)
    mixed = (count == 1) | (count == 2)
    corners, inside, count = corners[mixed], inside[mixed], count[mixed]
    points = np.stack([xs[mixed], ys[mixed]], axis=2)
    # The corner that differs from the other two comes first; the triangles keep their sense.
    odd = np.argmax(inside == (count == 1)[:, None], axis=1)
    order = (odd[:, None] + np.arange(3)) % 3
    rows = np.arange(len(odd))[:, None]
    f, points = corners[rows, order], points[rows, order]
    cut = [
        points[:, 0] + (f[:, 0] / (f[:, 0] - f[:, i]))[:, None] * (points[:, i] - points[:, 0])
        for i in (1, 2)
    ]
    segments = np.stack(cut, axis=1)
    return np.where((count == 1)[:, None, None], segments, segments[:, ::-1])


# Neighbours of a grid point along the edges of the triangles.
_NEIGHBOURS = np.array([[1, 1, 0], [1, 1, 1], [0, 1, 1]])


def lumen_outline(
    lumen: Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
    *,
    half_width: float,
    n_points: int = 161,
) -> Segments:
    """Outline of an implicit lumen cut by a plane, of the part connected with its centre.

    Args:
        lumen: function that is negative in the lumen.
        centre: point of the plane inside the lumen [cm].
        normal: of the plane.
        half_width: of the square that is searched [cm]; it must hold the section.
        n_points: grid points along a side of the square; the error is of second order.

    Returns:
        Straight pieces in the plane with the lumen on their left, about the centre [cm]; the axes
        are those of `plane_axes`.

    Raises:
        ValueError: the centre lies outside the lumen, or the section leaves the square.
    """
    first, second = plane_axes(normal)
    n_points += 1 - n_points % 2
    x = np.linspace(-half_width, half_width, n_points)
    points = centre + x[:, None, None] * first + x[None, :, None] * second
    values = lumen(points.reshape(-1, 3)).reshape(n_points, n_points)
    values = np.where(values == 0.0, np.finfo(float).tiny, values)
    labels = np.empty(values.shape, dtype=int)
    scipy.ndimage.label(values < 0.0, _NEIGHBOURS, output=labels)
    own = labels[n_points // 2, n_points // 2]
    if own == 0:
        raise ValueError(
            f"the centre {np.round(centre, 3)} of the section lies outside the lumen."
            " Give a point inside."
        )
    member: Bool[np.ndarray, "n n"] = labels == own
    if member[0].any() or member[-1].any() or member[:, 0].any() or member[:, -1].any():
        raise ValueError(
            f"the section at {np.round(centre, 3)} is wider than {2.0 * half_width:g} cm."
            " Enlarge half_width, or turn the plane across the vessel."
        )
    return _zero_segments(x, np.where(member, values, np.abs(values)))


def _loop_of(
    segments: Segments, ends: Int[np.ndarray, "segments 2"]
) -> Bool[np.ndarray, " segments"]:
    """Which belong to the closed loop round the origin, nearest to it where loops are nested."""
    names, compact = np.unique(ends, return_inverse=True)
    compact = compact.reshape(ends.shape)
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(ends)), (compact[:, 0], compact[:, 1])), shape=(len(names), len(names))
    )
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    loop = label[compact[:, 0]]
    p, q = segments[:, 0], segments[:, 1]
    turn = np.arctan2(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0], np.sum(p * q, axis=1))
    winding = np.bincount(loop, turn)
    nearest = np.full(len(winding), np.inf)
    np.minimum.at(nearest, loop, np.linalg.norm(p, axis=1))
    around = np.flatnonzero(np.abs(winding) > np.pi)
    if len(around) == 0:
        raise ValueError(
            "no part of the surface closes round the centre of the section."
            " Give a point inside, and a closed surface."
        )
    return loop == around[np.argmin(nearest[around])]


def surface_outline(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> Segments:
    """Outline of a triangulated surface cut by a plane, of the loop round the centre.

    Args:
        points: nodes of the surface [cm].
        triangles: nodes of each triangle, all with the same sense.
        centre: point of the plane inside the surface [cm].
        normal: of the plane.

    Returns:
        Straight pieces in the plane about the centre [cm], in the axes of `plane_axes`.

    Raises:
        ValueError: the plane misses the surface, or no loop closes round the centre.
    """
    segments, ends = _crossed(points, triangles, centre, normal)
    return segments[_loop_of(segments, ends)]


class Ring(NamedTuple):
    """Where a plane crosses the edges of a triangulated surface, once round its centre.

    Attributes:
        low: first end of each edge.
        high: its second end.
        share: place between them, 0 at the first.
    """

    low: Int[np.ndarray, " points"]
    high: Int[np.ndarray, " points"]
    share: Float[np.ndarray, " points"]


def surface_ring(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> Ring:
    """Points of a surface on the outline of `surface_outline`, in order; the same arguments.

    Raises:
        ValueError: the plane misses the surface, no loop closes round the centre, or its outline is
            open.
    """
    segments, ends = _crossed(points, triangles, centre, normal)
    own = ends[_loop_of(segments, ends)]
    following = dict(own.tolist())
    order = [int(own[0, 0])]
    while (after := following.get(order[-1])) != order[0]:
        if after is None:
            raise ValueError(
                "the plane crosses the edge of the surface, so that its outline is open. Move the"
                " centre away from the ends of the vessel."
            )
        order.append(after)
    low, high = np.divmod(np.array(order), len(points))
    height = _heights(points - centre, normal)
    return Ring(low, high, height[low] / (height[low] - height[high]))


def _heights(
    offset: Float[np.ndarray, "nodes 3"], normal: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " nodes"]:
    height = offset @ (normal / np.linalg.norm(normal))
    return np.where(height == 0.0, np.finfo(float).tiny, height)


def _crossed(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> tuple[Segments, Int[np.ndarray, "segments 2"]]:
    """A straight piece in each crossed triangle, and the edges on which it begins and ends."""
    first, second = plane_axes(normal)
    offset = points - centre
    height = _heights(offset, normal)
    flat = np.stack([offset @ first, offset @ second], axis=1)
    above = height[triangles] > 0.0
    crossed = triangles[(above.sum(axis=1) % 3) > 0]
    above = height[crossed] > 0.0
    if len(crossed) == 0:
        raise ValueError(
            f"the plane through {np.round(centre, 3)} misses the surface. Move its centre inside."
        )
    odd = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    order = (odd[:, None] + np.arange(3)) % 3
    corners = crossed[np.arange(len(odd))[:, None], order]
    edges = np.sort(np.stack([corners[:, [0, 1]], corners[:, [0, 2]]], axis=1), axis=2)
    low, high = edges[..., 0], edges[..., 1]
    share = (height[low] / (height[low] - height[high]))[..., None]
    segments = flat[low] + share * (flat[high] - flat[low])
    flip = above[np.arange(len(odd)), odd][:, None]
    segments = np.where(flip[..., None], segments[:, ::-1], segments)
    ends = low * len(points) + high
    return segments, np.where(flip, ends[:, ::-1], ends)


def surface_section(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> Section:
    """Cross-section of a triangulated surface; arguments and errors of `surface_outline`."""
    return measured_section(surface_outline(points, triangles, centre, normal))


def centerline_point(
    line: Centerline, s: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Position [cm] and unit tangent of a centerline at arc length s [cm]."""
    tangent = np.gradient(line.points, line.s, axis=0)
    position, direction = (
        np.array([np.interp(s, line.s, values[:, i]) for i in range(3)])
        for values in (line.points, tangent)
    )
    return position, direction / np.linalg.norm(direction)
