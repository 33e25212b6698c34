"""The lumen of the aorta as an axis with a radius, and coordinates of the wall about it.

A point x has its foot c(z) on the axis, where (x − c)·t = 0. With the frame (n, b, t) there, which
turns as little as possible about the axis::

    x = c(z) + ϱ (cos φ n(z) + sin φ b(z)),   gap(x) = (ϱ − R(z)) / √(1 + R'(z)²)

The gap is the distance from the lumen, negative inside, to first order in the change of slope of R
between x and its foot on the lumen. Beyond its ends the axis goes on straight, and R stays.

All of it is in aortic coordinates: the axis passes the origin along +z (downstream), at the level
of the ostium, and n points to the ostium there (+x).
"""

import dataclasses

import numpy as np
import scipy.spatial
from jaxtyping import Float

from jaxfsi.anatomy.curves.curve import Curve, at_arc_length, curve_through
from jaxfsi.anatomy.implicit import Tube, elliptic_contours, tube

_SPACING = 0.1  # of the samples along the axis [cm]
_HALF = 0.5  # half the length of the samples of a straight axis [cm]
_N_ANGLES = 96
_STEPS = 50
_TOLERANCE = 1e-10  # of a foot [cm]
_BEND = 0.8  # largest radius of the lumen over that of the bend of its axis


@dataclasses.dataclass(frozen=True)
class AorticAxis:
    """Axis and radius of the aortic lumen in aortic coordinates.

    Attributes:
        axis: s = 0 at the level of the ostium, growing downstream [cm].
        radius: of the lumen at its samples [cm].
        known: arc lengths between which axis and radius are measured [cm].
    """

    axis: Curve
    radius: Float[np.ndarray, " samples"]
    known: tuple[float, float] = (-np.inf, np.inf)

    def radius_at(self, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Radius of the lumen at arc lengths [cm]."""
        return np.interp(s, self.axis.s, self.radius)


def straight_axis(radius: float) -> AorticAxis:
    """A straight aorta of one radius [cm]."""
    ends = np.array([[0.0, 0.0, -_HALF], [0.0, 0.0, _HALF]])
    axis = curve_through(ends, _SPACING)
    axis = dataclasses.replace(axis, s=axis.s - _HALF)
    return AorticAxis(axis, np.full(len(axis.s), radius))


def level(axis: Curve, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Arc length of the foot of points on an axis [cm]; it goes on straight beyond its ends.

    Args:
        axis: it bends less than a circle through the points about their feet.
        points: positions [cm].
    """
    _, nearest = scipy.spatial.KDTree(axis.points).query(points)
    s = axis.s[nearest].astype(float)
    for _ in range(_STEPS):
        centre, tangent, _, _ = at_arc_length(axis, s)
        step = np.sum((points - centre) * tangent, axis=1)
        s = s + step
        if np.max(np.abs(step), initial=0.0) < _TOLERANCE:
            break
    return s


def wall_coordinates(
    aorta: AorticAxis, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3"]:
    """ϱ [cm], φ [rad] in (−π, π] and z [cm] of points.

    Args:
        aorta: axis and radius.
        points: in aortic coordinates [cm].
    """
    z = level(aorta.axis, points)
    centre, _, normal, binormal = at_arc_length(aorta.axis, z)
    u, v = (np.sum((points - centre) * across, axis=1) for across in (normal, binormal))
    return np.stack([np.hypot(u, v), np.arctan2(v, u), z], axis=1)


def wall_points(
    aorta: AorticAxis,
    rho: Float[np.ndarray, " points"],
    phi: Float[np.ndarray, " points"],
    z: Float[np.ndarray, " points"],
) -> Float[np.ndarray, "points 3"]:
    """Points at given coordinates of the wall, the inverse of `wall_coordinates` [cm]."""
    centre, _, normal, binormal = at_arc_length(aorta.axis, z)
    across = np.cos(phi)[:, None] * normal + np.sin(phi)[:, None] * binormal
    return centre + rho[:, None] * across


def outward(aorta: AorticAxis, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors from the axis to points [cm]."""
    return points - at_arc_length(aorta.axis, level(aorta.axis, points))[0]


def aortic_gap(
    aorta: AorticAxis, points: Float[np.ndarray, "*shape 3"]
) -> Float[np.ndarray, "*shape"]:
    """Distance of points from the aortic lumen, negative inside [cm]."""
    rho, _, z = wall_coordinates(aorta, points.reshape(-1, 3)).T
    slopes = np.gradient(aorta.radius, aorta.axis.s)
    slope = np.interp(z, aorta.axis.s, slopes, left=0.0, right=0.0)
    gap = (rho - aorta.radius_at(z)) / np.sqrt(1.0 + slope**2)
    return gap.reshape(points.shape[:-1])


def aortic_tube(
    aorta: AorticAxis, low: float, high: float
) -> tuple[Tube, Float[np.ndarray, " samples"]]:
    """The lumen between two levels [cm] with flat ends, and its radius at the samples [cm].

    Args:
        aorta: axis and radius.
        low: level of the upstream end.
        high: level of the downstream end.

    Raises:
        ValueError: the axis bends so sharply that sections cross.
    """
    s = np.linspace(low, high, int(np.ceil((high - low) / _SPACING - 1e-9)) + 1)
    points, tangent, normal, binormal = at_arc_length(aorta.axis, s)
    part = Curve(points, s, tangent, normal, binormal)
    radius = aorta.radius_at(s)
    bend = radius * np.linalg.norm(np.gradient(tangent, s, axis=0), axis=1)
    if np.max(bend) > _BEND:
        k = int(np.argmax(bend))
        raise ValueError(
            f"the centre line of the aorta bends with a radius of {radius[k] / bend[k]:.2g} cm"
            f" {abs(s[k]):.2g} cm from the ostium, where the lumen has {radius[k]:.2g} cm. Smooth"
            " the line, or cut the aorta before the bend (aorta_below, aorta_above)."
        )
    return tube(part, elliptic_contours(radius, radius, _N_ANGLES)), radius
