"""Which triangles of the lumen carry columns, and the outer surface with the columns' ends in it.

Columns are given up until the outer surface takes them all: where two patches of them face each
other across a groove too narrow for tetrahedra, where no triangles close the hole between them,
and where fitting to the outer surface spoils a wedge or a triangle beside it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import KDTree

from jaxfsi.anatomy import Anatomy
from jaxfsi.faces import triangle_edges
from jaxfsi.measures import edge_lengths, triangle_normals
from jaxfsi.meshing.columns.corners import at_sharp_corners
from jaxfsi.meshing.columns.march import Columns, march
from jaxfsi.meshing.columns.outer import stitched
from jaxfsi.meshing.columns.stack import Stack, stack, stack_sides
from jaxfsi.meshing.columns.zone import SurfaceGraph, shapely, tidied, without
from jaxfsi.meshing.surface.clipping import ClippedSurface, border_loops
from jaxfsi.meshing.surface.fitted import fitted
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import gradients, triangle_qualities
from jaxfsi.meshing.surface.sizes import SizeField, size_at

_ROUNDS = 12
_LEAST_TRIANGLE_QUALITY = 0.25
# Cosine between the normal of an outer triangle and that of the surface.
_LEAST_COSINE = 0.5
# Distance of an outer edge from the lumen over the thickness.
_LEAST_ROOM = 0.5
# Angle between two triangles of the surface of the rest.
_SHARP_DEG = 30.0
_STEP = 1e-3  # of the differences for normals [cm]
# Width of a groove between two patches of columns over the element size.
_GROOVE = 0.6
# Ends of columns fewer steps apart than this are no groove.
_STEPS_ROUND = 4


class NoColumns(Exception):
    """No column fits the wall; the message says why, in a clause."""


class Cover(NamedTuple):
    """Columns and the outer surface that they end in.

    Attributes:
        outer: the outer surface; its first vertices are the ends of the columns.
        feet: vertex of the lumen of each column, in rising order.
        triangles: of the lumen that carry wedges, as indices into ``feet``.
    """

    outer: ClippedSurface
    feet: Int[np.ndarray, " columns"]
    triangles: Int[np.ndarray, "triangles 3"]

    def stack(self, lumen: ClippedSurface, *, layers: int) -> Stack:
        """Wedges between the points of the lumen followed by those of the outer surface."""
        ends = len(lumen.surface.points) + np.arange(len(self.feet))
        points = np.concatenate([lumen.surface.points, self.outer.surface.points])
        return stack(self.feet, ends, self.triangles, points, layers=layers)


def cover(
    lumen: ClippedSurface,
    wall: ClippedSurface,
    anatomy: Anatomy,
    field: SizeField,
    *,
    deviation: float,
) -> Cover:
    """Cover as much of the lumen by columns as can be.

    Args:
        lumen: surface of the blood, fitted.
        wall: outer surface of the wall, fitted.
        anatomy: lumen and wall as functions.
        field: element size.
        deviation: of remeshed parts of the outer surface [cm].

    Raises:
        NoColumns: no column fits, or no outer surface takes them.
    """
    points, triangles = lumen.surface
    graph = SurfaceGraph(triangles, len(points))
    columns = march(lumen, anatomy)
    standing = columns.sound[triangles].all(axis=1)
    free = without(graph, columns.sound, standing & ~shapely(points, columns.ends, triangles))
    rim = np.zeros(len(points), dtype=bool)
    rim[np.concatenate(lumen.loops)] = True
    for _ in range(_ROUNDS):
        free = tidied(graph, free, lumen.loops)
        zone = free[triangles].all(axis=1)
        if not zone.any():
            raise NoColumns(_reason(lumen.surface, columns, anatomy))
        crowded = _facing(graph, columns.ends, triangles[zone], rim, field)
        if crowded.any():
            free &= ~crowded
            continue
        feet, renumbered = np.unique(triangles[zone], return_inverse=True)
        ends = Surface(columns.ends[feet], renumbered.reshape(-1, 3))
        made = stitched(wall.surface, ends, rim[feet], anatomy.wall, field, deviation=deviation)
        failed = np.zeros(len(points), dtype=bool)
        failed[feet] = made.failed
        if failed.any():
            free &= ~graph.spread(failed)
            continue
        try:
            outer = fitted(made.surface, anatomy, 1)
        except ValueError as error:
            raise NoColumns(f"the outer surface that takes columns is torn: {error}") from error
        good = shapely(points[feet], outer.surface.points[: len(feet)], ends.triangles)
        found = Cover(outer, feet, ends.triangles)
        spoilt = np.concatenate([ends.triangles[~good].ravel(), _at_poor(found, lumen, anatomy)])
        if len(spoilt) == 0:
            return found
        free[feet[spoilt]] = False
    raise NoColumns(f"in {_ROUNDS} rounds no outer surface took the columns; use another preset")


def _at_poor(found: Cover, lumen: ClippedSurface, anatomy: Anatomy) -> Int[np.ndarray, " spoilt"]:
    """Columns beside triangles that leave no room for good tetrahedra.

    These are slivers, triangles turned from the surface or near the lumen, and neighbours at a
    sharp angle.
    """
    outer, count = found.outer.surface, len(found.feet)
    normals = triangle_normals(*outer)
    slope = gradients(anatomy.wall, outer.points[outer.triangles].mean(axis=1), step=_STEP)
    size = np.linalg.norm(normals, axis=1) * np.linalg.norm(slope, axis=1)
    turned = np.einsum("tk,tk->t", normals, slope) < _LEAST_COSINE * size
    corners = outer.points[outer.triangles]
    middle = 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)
    room = anatomy.lumen(middle) / anatomy.thickness(middle)
    near = room.reshape(-1, 3).min(axis=1) < _LEAST_ROOM
    sliver = triangle_qualities(*outer) < _LEAST_TRIANGLE_QUALITY
    poor = outer.triangles[turned | near | sliver]
    shift = len(lumen.surface.points)
    points = np.concatenate([lumen.surface.points, outer.points])
    sides = stack_sides(found.stack(lumen, layers=1), points)[:, ::-1]
    rest = outer.triangles[len(found.triangles) :] + shift
    sharp = at_sharp_corners(points, np.concatenate([rest, sides]), least_deg=_SHARP_DEG) - shift
    spoilt = np.unique(np.concatenate([poor.ravel(), sharp]))
    return spoilt[(spoilt >= 0) & (spoilt < count)]


def _reason(lumen: Surface, columns: Columns, anatomy: Anatomy) -> str:
    """Why nothing is left to stand columns on."""
    thickness = float(np.median(anatomy.thickness(lumen.points)))
    width = float(np.median(edge_lengths(lumen.points, triangle_edges(lumen.triangles)[:, 0])))
    measures = f"it is {thickness:.3g} cm thick over triangles {width:.3g} cm wide"
    share = float(np.mean(columns.sound))
    if share > 0.5:
        return f"no wedge is well shaped, {measures}; use a finer preset or a thicker wall"
    return (
        f"only {share:.0%} of the columns reach the outer surface without meeting others,"
        f" {measures}; use a thinner wall"
    )


def _facing(
    graph: SurfaceGraph,
    ends: np.ndarray,
    zone: Int[np.ndarray, "triangles 3"],
    rim: Bool[np.ndarray, " points"],
    field: SizeField,
) -> Bool[np.ndarray, " points"]:
    """Columns at the border of a patch whose ends have others just across a groove."""
    border = np.unique(np.concatenate(border_loops(zone)))
    border = border[~rim[border]]
    facing = np.zeros(graph.count, dtype=bool)
    if len(border) == 0:
        return facing
    size = _GROOVE * size_at(field, ends[border])
    pairs = KDTree(ends[border]).query_pairs(float(size.max()), output_type="ndarray")
    way = np.linalg.norm(ends[border[pairs[:, 0]]] - ends[border[pairs[:, 1]]], axis=1)
    pairs = pairs[way < np.minimum(*size[pairs].T)]
    pairs = border[pairs]
    facing[pairs[~graph.close(pairs, _STEPS_ROUND)]] = True
    return facing
