"""A lumen surface with its wall: distances, local radius and thickness as functions of position.

The outer surface is an additively weighted offset of the lumen by its thickness t::

    W(x) = min over surface points c of (|x − c| − t(c))      outside the lumen

evaluated as the minimum over classes of similar thickness, each with its own nearest point and the
thickness interpolated there. The nearest surface point alone would cut a notch into a thick wall
beside a thin one. Two lumens nearer than their walls share one solid.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy.implicit import smooth_minimum
from jaxfsi.anatomy.surfaces.distance import Nearest, SurfaceDistance, nearest, surface_distance
from jaxfsi.anatomy.surfaces.triangles import Triangles

_CLASS = 0.025  # width of a class of thickness [cm]
_CREASE = 0.04  # blend radius between the thick and the thin half of the classes [cm]
_NEAR = 0.45  # farther outside the wall than this the nearest point decides alone [cm]
_INSIDE = 0.05  # and deeper in the lumen than this [cm]


class ThicknessClass(NamedTuple):
    """The part of a surface that has about one thickness.

    Attributes:
        part: for distances to it; the sign means nothing.
        thickness: at its points [cm].
        thick: whether it belongs to the thicker half of the classes.
    """

    part: SurfaceDistance
    thickness: Float[np.ndarray, " points"]
    thick: bool


@dataclasses.dataclass(frozen=True)
class WalledSurface:
    """A closed lumen surface with its local radius and wall thickness.

    Attributes:
        lumen: for distances to the whole surface.
        classes: its parts of similar thickness.
        class_of_face: index of the class of each triangle.
        radius: at the points [cm].
        thickness: at the points [cm].
    """

    lumen: SurfaceDistance
    classes: tuple[ThicknessClass, ...]
    class_of_face: Int[np.ndarray, " faces"]
    radius: Float[np.ndarray, " points"]
    thickness: Float[np.ndarray, " points"]


def walled_surface(
    surface: Triangles,
    radius: Float[np.ndarray, " points"],
    thickness: Float[np.ndarray, " points"],
) -> WalledSurface:
    """Prepare a surface for distances to itself and to its wall.

    Args:
        surface: closed, wound outwards, of triangles of similar size.
        radius: local radius at its points [cm].
        thickness: of the wall at its points [cm].
    """
    of_face = thickness[surface.faces].mean(axis=1)
    span = float(np.ptp(of_face))
    n_classes = max(int(np.ceil(span / _CLASS)), 1)
    number = np.minimum(
        (n_classes * (of_face - of_face.min()) / max(span, 1e-12)).astype(int), n_classes - 1
    )
    present, class_of_face = np.unique(number, return_inverse=True)
    classes = []
    for k in present:
        used, faces = np.unique(surface.faces[number == k], return_inverse=True)
        part = surface_distance(Triangles(surface.points[used], faces.reshape(-1, 3)))
        classes.append(ThicknessClass(part, thickness[used], bool(2 * k >= n_classes)))
    return WalledSurface(
        surface_distance(surface), tuple(classes), class_of_face, radius, thickness
    )


def _at_foot(
    ready: SurfaceDistance, values: Float[np.ndarray, " values"], found: Nearest
) -> Float[np.ndarray, " points"]:
    """Values given at the points of a surface, at the feet of points in space."""
    return np.sum(values[ready.surface.faces[found.face]] * found.weights, axis=1)


def lumen_distance(
    walled: WalledSurface, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Lumen function L [cm], negative in the blood."""
    return nearest(walled.lumen, points).distance


def local_radius(
    walled: WalledSurface, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Radius of the inscribed ball at the nearest surface point [cm]."""
    return _at_foot(walled.lumen, walled.radius, nearest(walled.lumen, points))


def local_thickness(
    walled: WalledSurface, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Wall thickness at the nearest surface point [cm]."""
    return _at_foot(walled.lumen, walled.thickness, nearest(walled.lumen, points))


def wall_distance(
    walled: WalledSurface, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Outer wall function W [cm], negative inside the outer surface."""
    found = nearest(walled.lumen, points)
    value = found.distance - _at_foot(walled.lumen, walled.thickness, found)
    if len(walled.classes) == 1:
        return value
    close = np.flatnonzero((value < _NEAR) & (found.distance > -_INSIDE))
    x, depth, own = points[close], np.abs(found.distance[close]), value[close]
    own = np.where(found.distance[close] < 0.0, own + 2.0 * depth, own)
    nearest_class = walled.class_of_face[found.face[close]]
    # A part farther away than the surface itself by more than this decides nothing.
    slack = float(np.ptp(walled.thickness)) + _CREASE
    groups = {thick: np.full(len(close), np.inf) for thick in (False, True)}
    for k, (part, thickness, thick) in enumerate(walled.classes):
        mine = nearest_class == k
        groups[thick][mine] = np.minimum(groups[thick][mine], own[mine])
        others = np.flatnonzero(~mine)
        reach = slack + float(np.max(part.reach))
        bound = reach + float(np.max(depth[others], initial=0.0))
        to_centroid, _ = part.tree.query(x[others], distance_upper_bound=bound)
        chosen = others[to_centroid < depth[others] + reach]
        foot = nearest(part, x[chosen])
        outside = np.abs(foot.distance) - _at_foot(part, thickness, foot)
        groups[thick][chosen] = np.minimum(groups[thick][chosen], outside)
    offset = np.minimum(groups[False], groups[True])
    both = np.isfinite(groups[False]) & np.isfinite(groups[True])
    offset[both] = smooth_minimum(groups[False][both], groups[True][both], _CREASE)
    # Inside the lumen the way to the surface is counted down, not up.
    value[close] = offset + 2.0 * np.minimum(found.distance[close], 0.0)
    return value
