"""The course of the coronary arteries of the synthetic anatomy, from the aortic lumen outwards.

The anomalous artery is laid out in coordinates of the aortic wall: height h, angle θ and depth d
outwards from the aortic lumen, all functions of the length l along the wall. From inside the lumen
d rises at the take-off angle, an arc leads into the intramural depth

    d = septum + (minor half axis) + correction,

another arc leads out of the wall, and a Bézier curve goes on outwards and downwards. The
correction makes the least distance of each cross-section from the aortic lumen equal the septum,
whatever the shape of the wall there.
"""

from typing import NamedTuple

import numpy as np
import scipy.interpolate
import scipy.ndimage
from jaxtyping import Float

from jaxfsi.anatomy.curves import Curve, bezier_points, curve_through, extended
from jaxfsi.anatomy.implicit import Tube, elliptic_contours, surface_points, tube_foot
from jaxfsi.anatomy.parameters import SyntheticAnatomy

_SPACING = 0.02
_ANGLES = 32
_EXIT_ANGLE = 0.7
_STEP = 0.005
_CORRECTIONS = 4
_SMOOTHING = 0.03


class Course(NamedTuple):
    """Axis and cross-sections of a coronary artery.

    Attributes:
        axis: evenly sampled, from inside the aortic lumen to beyond the outlet; s = 0 at the
            ostium.
        half_major: half axis of the section along the wall (the axis' normal) [cm].
        half_minor: half axis across the wall (the axis' binormal) [cm].
        gap: least distance of the section from the aortic lumen [cm], negative where they overlap.
        s_outlet: arc length of the outlet [cm].
    """

    axis: Curve
    half_major: Float[np.ndarray, " samples"]
    half_minor: Float[np.ndarray, " samples"]
    gap: Float[np.ndarray, " samples"]
    s_outlet: float

    @property
    def contours(self) -> Float[np.ndarray, "samples angles 2"]:
        """Cross-sections in the frame of the axis [cm]."""
        return elliptic_contours(self.half_major, self.half_minor, _ANGLES)


class _Depth(NamedTuple):
    """Depth d over the length l along the wall, without correction; l = 0 at the ostium."""

    length: Float[np.ndarray, " points"]
    depth: Float[np.ndarray, " points"]
    plateau: tuple[float, float]


def _depth_profile(p: SyntheticAnatomy) -> _Depth:
    """Straight rise, arc, plateau, arc, straight exit; evenly sampled in l."""
    alpha = p.take_off_angle
    minor = p.intramural_half_axes[1]
    level = p.septum + minor
    bend = max(1.6 * max(minor, p.ostium_minor / 2.0), 0.1)
    # The arc ends on the plateau at l = l_1; the straight rise continues it tangentially.
    start = -(p.ostium_minor / 2.0 + 0.06) - 0.3 * bend
    arc_length, arc_depth = bend * np.sin(alpha), bend * (1.0 - np.cos(alpha))
    straight = (level - arc_depth - start) / np.tan(alpha)
    out_bend = max(3.0 * p.reference_radius, 0.4)
    l_2 = straight + arc_length + 10.0
    rise_length = out_bend * np.sin(_EXIT_ANGLE)
    end = l_2 + rise_length + 0.25
    l_all = np.arange(0.0, end, _STEP)
    l_1 = straight + arc_length
    rise = start + np.minimum(l_all, straight) * np.tan(alpha)
    inside = np.clip(l_1 - l_all, 0.0, arc_length)
    rise = np.where(l_all < straight, rise, level - bend + np.sqrt(bend**2 - inside**2))
    outside = np.clip(l_all - l_2, 0.0, rise_length)
    leave = out_bend - np.sqrt(out_bend**2 - outside**2)
    leave += np.tan(_EXIT_ANGLE) * np.maximum(l_all - l_2 - rise_length, 0.0)
    depth = rise + leave
    ostium = np.interp(0.0, depth[l_all < l_1], l_all[l_all < l_1])
    # Cut the plateau to the wanted length; it was laid out long so that the arcs cannot meet.
    surplus = l_2 - (ostium + p.intramural_length)
    keep = (l_all <= l_1) | (l_all >= l_1 + surplus)
    length = np.where(l_all > l_1, l_all - surplus, l_all)[keep] - ostium
    return _Depth(length, depth[keep], (l_1 - ostium, p.intramural_length))


def _half_axes(
    p: SyntheticAnatomy, plateau: tuple[float, float], length: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Half axes along and across the wall: ostium, intramural lumen, round distal artery."""
    major, minor = p.intramural_half_axes
    first, last = plateau
    narrow = max(min(max(first, 0.25), 0.6 * last), 0.5 * first, 0.05)
    widening = max(0.5, 3.0 * p.reference_radius)
    knots = [-9.0, 0.0, narrow, last, last + widening, last + widening + 9.0]
    tops = [p.ostium_major / 2.0] * 2 + [major] * 2 + [p.reference_radius] * 2
    sides = [p.ostium_minor / 2.0] * 2 + [minor] * 2 + [p.reference_radius] * 2
    return tuple(
        np.exp(scipy.interpolate.PchipInterpolator(knots, np.log(values))(length))
        for values in (tops, sides)
    )


def _direction(p: SyntheticAnatomy) -> float:
    """Sense of the anomalous course about the aortic axis."""
    return -1.0 if p.side == "right" else 1.0


def _wall_path(
    p: SyntheticAnatomy, aorta: Tube, profile: _Depth, depth: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
    """Points of the course at given depths, and the normals of the aortic wall there."""
    sign = _direction(p)
    heights = p.ostium_height - profile.length * np.sin(p.course_angle)
    at_ostium, _ = surface_points(
        aorta, np.array([p.ostium_height]), np.array([-sign * p.ostium_angle])
    )
    centre = np.array([0.0, 0.0, at_ostium[0, 2]])
    radius = float(np.linalg.norm((at_ostium - centre)[0, :2]))
    angles = sign * (profile.length * np.cos(p.course_angle) / radius - p.ostium_angle)
    on_wall, normal = surface_points(aorta, heights, angles)
    return on_wall + depth[:, None] * normal, normal


def _tail(
    p: SyntheticAnatomy,
    start: Float[np.ndarray, " 3"],
    direction: Float[np.ndarray, " 3"],
    outward: Float[np.ndarray, " 3"],
    length: float,
) -> Float[np.ndarray, "points 3"]:
    """Bézier curve that goes on in a direction and turns outwards and down."""
    final = direction + 0.9 * outward + np.array([0.0, 0.0, -0.5])
    final /= np.linalg.norm(final)
    mean = (direction + final) / np.linalg.norm(direction + final)
    finish = start + 0.97 * length * mean
    controls = np.stack(
        [start, start + direction * length / 3.0, finish - final * length / 3.0, finish]
    )
    return bezier_points(controls, 41)


def _laid_out(
    p: SyntheticAnatomy, aorta: Tube, profile: _Depth, correction: Float[np.ndarray, " points"]
) -> tuple[Curve, float]:
    """Axis with s = 0 at the ostium, and the arc length of the outlet."""
    path, wall_normal = _wall_path(p, aorta, profile, profile.depth + correction)
    direction = path[-1] - path[-2]
    direction /= np.linalg.norm(direction)
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    ostium = float(np.interp(0.0, profile.length, walked))
    at_exit = float(np.interp(profile.plateau[1], profile.length, walked))
    tail = _tail(
        p, path[-1], direction, wall_normal[-1], max(at_exit + p.distal_length - walked[-1], 0.5)
    )
    every = max(int(_SPACING / _STEP), 1)
    controls = np.concatenate([path[:-1:every], path[-1:], tail[2::2]])
    tangent = np.gradient(path, axis=0)
    framed = profile.length[: len(path) - 1 : every] <= profile.plateau[1]
    across = np.cross(wall_normal, tangent)[: len(path) - 1 : every][framed]
    curve = curve_through(controls, _SPACING, normals=across)
    s_outlet = float(curve.s[-1]) - ostium
    longer = extended(curve, 0.0, p.reference_radius + p.thickness_minimum)
    shifted = Curve(
        longer.points, longer.s - ostium, longer.tangent, longer.normal, longer.binormal
    )
    return shifted, s_outlet


def _gap(
    aorta: Tube, axis: Curve, contours: Float[np.ndarray, "samples angles 2"]
) -> Float[np.ndarray, " samples"]:
    offsets = contours[..., :1] * axis.normal[:, None] + contours[..., 1:] * axis.binormal[:, None]
    points = (axis.points[:, None] + offsets).reshape(-1, 3)
    return np.min(tube_foot(aorta, points).distance.reshape(contours.shape[:2]), axis=1)


def anomalous_course(p: SyntheticAnatomy, aorta: Tube) -> Course:
    """Course of the anomalous artery, its intramural part at the wanted depth.

    Args:
        p: parameters (valid).
        aorta: lumen of the aorta.
    """
    profile = _depth_profile(p)
    _, minor = _half_axes(p, profile.plateau, profile.length)
    widened = np.where(profile.length > profile.plateau[1], minor - p.intramural_half_axes[1], 0.0)
    profile = profile._replace(depth=profile.depth + widened)
    correction = np.zeros_like(profile.length)
    for _ in range(_CORRECTIONS):
        course = _course(p, aorta, profile, correction)
        correction = correction + _change(p, profile, course)
    return _course(p, aorta, profile, correction)


def _course(
    p: SyntheticAnatomy, aorta: Tube, profile: _Depth, correction: Float[np.ndarray, " points"]
) -> Course:
    axis, s_outlet = _laid_out(p, aorta, profile, correction)
    major, minor = _half_axes(p, profile.plateau, axis.s)
    gap = _gap(aorta, axis, elliptic_contours(major, minor, _ANGLES))
    return Course(axis, major, minor, gap, s_outlet)


def _change(p: SyntheticAnatomy, profile: _Depth, course: Course) -> Float[np.ndarray, " points"]:
    """Depth to add so that the gap is the septum on the plateau, and no less beyond it."""
    first, last = profile.plateau
    length = profile.length
    lacking = p.septum - np.interp(length, course.axis.s, course.gap)
    at_first, at_last = np.interp([first, last], length, lacking)
    change = np.where(length < first, at_first * np.clip(length / first, 0.0, 1.0), lacking)
    change = np.where(length > last, np.maximum(lacking, at_last), change)
    return scipy.ndimage.gaussian_filter1d(change, _SMOOTHING / _STEP, mode="nearest")


def normal_course(p: SyntheticAnatomy, aorta: Tube) -> Course:
    """Course of the normal artery: straight out of its sinus, then sideways and down.

    Args:
        p: parameters (valid).
        aorta: lumen of the aorta.
    """
    sign = -_direction(p)
    ostium, outward = surface_points(
        aorta, np.array([p.normal_height]), np.array([sign * p.normal_angle])
    )
    sideways = sign * np.cross(np.array([0.0, 0.0, 1.0]), outward[0])
    inside = p.normal_radius + 0.06
    final = outward[0] + 0.5 * sideways + np.array([0.0, 0.0, -0.35])
    final /= np.linalg.norm(final)
    length = p.normal_length
    start = ostium[0]
    finish = start + length * (0.55 * outward[0] + 0.43 * final)
    controls = np.stack(
        [start, start + outward[0] * length * 0.45, finish - final * length * 0.35, finish]
    )
    stub = start - outward[0] * inside * np.linspace(1.0, 0.0, 8)[:-1, None]
    curve = curve_through(np.concatenate([stub, bezier_points(controls, 31)]), _SPACING)
    s_outlet = float(curve.s[-1]) - inside
    longer = extended(curve, 0.0, p.normal_radius + p.thickness_minimum)
    axis = Curve(longer.points, longer.s - inside, longer.tangent, longer.normal, longer.binormal)
    half = np.full(len(axis.s), p.normal_radius)
    return Course(axis, half, half, _gap(aorta, axis, elliptic_contours(half, half, 16)), s_outlet)
