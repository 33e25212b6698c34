"""A lumen surface with its wall: distances, local radius and thickness as functions of position.

The outer surface is an additively weighted offset of the lumen by its thickness t::

    W(x) = min over surface points c of (|x − c| − t(c))      outside the lumen

evaluated as the minimum over classes of similar thickness, each with its own nearest point and the
thickness interpolated there. The nearest surface point alone would cut a notch into a thick wall
beside a thin one. Two lumens nearer than their walls share one solid.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.implicit import smooth_minimum
from jaxfsi.anatomy.surface_distance import Nearest, SurfaceDistance, nearest, surface_distance
from jaxfsi.anatomy.triangles import Triangles

_CLASS = 0.025  # width of a class of thickness [cm]
_CREASE = 0.04  # blend radius between the thick and the thin half of the classes [cm]
_NEAR = 0.6  # of the wall: farther away the nearest point decides alone [cm]


@dataclasses.dataclass(frozen=True)
class WalledSurface:
    """A closed lumen surface with its local radius and wall thickness.

    Attributes:
        lumen: for distances to the whole surface.
        classes: for distances to the parts of similar thickness.
        thick: whether each class belongs to the thicker half.
        radius: at the points [cm].
        thickness: at the points [cm].
    """

    lumen: SurfaceDistance
    classes: tuple[SurfaceDistance, ...]
    thick: tuple[bool, ...]
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
    present = [k for k in range(n_classes) if np.any(number == k)]
    return WalledSurface(
        surface_distance(surface),
        tuple(
            surface_distance(Triangles(surface.points, surface.faces[number == k])) for k in present
        ),
        tuple(2 * k >= n_classes for k in present),
        radius,
        thickness,
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
    close = np.flatnonzero(np.abs(value) < _NEAR)
    groups = {thick: np.full(len(close), np.inf) for thick in (False, True)}
    for ready, thick in zip(walled.classes, walled.thick, strict=True):
        part = nearest(ready, points[close])
        outside = np.abs(part.distance) - _at_foot(ready, walled.thickness, part)
        groups[thick] = np.minimum(groups[thick], outside)
    offset = np.minimum(groups[False], groups[True])
    both = np.isfinite(groups[False]) & np.isfinite(groups[True])
    offset[both] = smooth_minimum(groups[False][both], groups[True][both], _CREASE)
    # Inside the lumen the way to the surface is counted down, not up.
    value[close] = offset + 2.0 * np.minimum(found.distance[close], 0.0)
    return value
