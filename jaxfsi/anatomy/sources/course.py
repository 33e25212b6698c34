"""The course of the coronary arteries of the synthetic anatomy, from the aortic lumen outwards.

The anomalous artery is laid out in coordinates of the aortic wall: height h, angle θ and depth d
outwards from the aortic lumen, all functions of the arc length s. From inside the lumen
d rises at the take-off angle, an arc leads into the intramural depth

    d = septum + (minor half axis) + correction,

another arc leads out of the wall, and a Bézier curve goes on outwards and downwards. The
correction makes the least distance of each cross-section from the aortic lumen equal the septum,
whatever the shape of the wall there.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
import scipy.interpolate
import scipy.ndimage
from jaxtyping import Float

from jaxfsi.anatomy.curves.curve import Curve, bezier_points, curve_through, extended
from jaxfsi.anatomy.implicit import Tube, elliptic_contours, surface_points, tube_foot
from jaxfsi.anatomy.sources.aorta import aorta_radius
from jaxfsi.anatomy.sources.parameters import SyntheticParameters, approach

_SPACING = 0.02
_ANGLES = 32
_EXIT_ANGLE = 0.7
_STEP = 0.005
_CORRECTIONS = 4
_RELAXATION = 0.8
_SMOOTHING = 0.06


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


class _Profile(NamedTuple):
    """Depth in the wall along the course, without correction; everything is 0 at the ostium.

    Attributes:
        s: arc length of the course [cm].
        along: length along the wall [cm].
        depth: of the axis below the aortic lumen's surface, outwards [cm].
        plateau: arc lengths between which the depth is constant [cm].
    """

    s: Float[np.ndarray, " points"]
    along: Float[np.ndarray, " points"]
    depth: Float[np.ndarray, " points"]
    plateau: tuple[float, float]


def _profile(p: SyntheticParameters) -> _Profile:
    """Straight rise, arc, plateau, arc, straight exit, with the wider artery farther out."""
    alpha, minor = p.take_off_angle, p.intramural_half_axes[1]
    bend, s_rise, s_first = approach(p)
    s_last = p.intramural_length
    out_bend = max(3.0 * p.reference_radius, 0.4)
    start = min(s_rise, 0.0) - (p.ostium_minor / 2.0 + 0.06) / np.sin(alpha)
    end = s_last + out_bend * _EXIT_ANGLE + 0.25
    s = np.linspace(start, end, int((end - start) / _STEP) + 2)
    turned = np.clip((s - s_rise) / bend, 0.0, alpha)
    angle = alpha - turned + np.clip((s - s_last) / out_bend, 0.0, _EXIT_ANGLE)
    middle = (angle[1:] + angle[:-1]) / 2.0
    along, depth = (
        np.concatenate([[0.0], np.cumsum(f(middle) * np.diff(s))]) for f in (np.cos, np.sin)
    )
    depth += p.septum + minor - np.interp(s_first, s, depth)
    plateau = (s_first, s_last)
    _, half_minor = _half_axes(p, plateau, s)
    depth += np.where(s > s_last, half_minor - minor, 0.0)
    return _Profile(s, along - np.interp(0.0, s, along), depth, plateau)


def _half_axes(
    p: SyntheticParameters, plateau: tuple[float, float], s: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Half axes along and across the wall: ostium, intramural lumen, round distal artery."""
    major, minor = p.intramural_half_axes
    first, last = plateau
    narrow = min(max(first, 0.25), (first + last) / 2.0)
    widening = max(0.5, 3.0 * p.reference_radius)
    knots = [-9.0, 0.0, narrow, last, last + widening, last + widening + 9.0]
    tops = [p.ostium_major / 2.0] * 2 + [major] * 2 + [p.reference_radius] * 2
    sides = [p.ostium_minor / 2.0] * 2 + [minor] * 2 + [p.reference_radius] * 2
    return tuple(
        np.exp(scipy.interpolate.PchipInterpolator(knots, np.log(values))(s))
        for values in (tops, sides)
    )


def _direction(p: SyntheticParameters) -> float:
    """Sense of the anomalous course about the aortic axis."""
    return -1.0 if p.side == "right" else 1.0


def _wall_path(
    p: SyntheticParameters, aorta: Tube, profile: _Profile, depth: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
    """Points of the course at given depths, and the normals of the aortic wall there."""
    sign = _direction(p)
    heights = p.ostium_height - profile.along * np.sin(p.course_angle)
    # Angles at which a step along the wall has its length at the depth of the course.
    mean = float(np.mean(aorta_radius(p, heights))) + p.septum + p.intramural_half_axes[1]
    angles = sign * (profile.along * np.cos(p.course_angle) / mean - p.ostium_angle)
    on_wall, normal = surface_points(aorta, heights, angles)
    return on_wall + depth[:, None] * normal, normal


def _tail(
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
    p: SyntheticParameters, aorta: Tube, profile: _Profile, correction: Float[np.ndarray, " points"]
) -> tuple[Curve, float]:
    """Axis with s = 0 at the ostium, and the arc length of the outlet."""
    path, wall_normal = _wall_path(p, aorta, profile, profile.depth + correction)
    direction = path[-1] - path[-2]
    direction /= np.linalg.norm(direction)
    left = p.intramural_length + p.distal_length - profile.s[-1]
    tail = _tail(path[-1], direction, wall_normal[-1], max(left, 0.5))
    chosen = np.arange(0, len(path) - 1, max(int(_SPACING / _STEP), 1))
    controls = np.concatenate([path[chosen], path[-1:], tail[2::2]])
    framed = chosen[profile.s[chosen] <= profile.plateau[1]]
    across = np.cross(wall_normal, np.gradient(path, axis=0))[framed]
    curve = curve_through(controls, _SPACING, normals=across)
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    ostium = float(np.interp(0.0, profile.s, walked))
    s_outlet = float(curve.s[-1]) - ostium
    longer = extended(curve, 0.0, p.reference_radius + p.thickness_minimum)
    return dataclasses.replace(longer, s=longer.s - ostium), s_outlet


def _gap(
    aorta: Tube, axis: Curve, contours: Float[np.ndarray, "samples angles 2"]
) -> Float[np.ndarray, " samples"]:
    offsets = contours[..., :1] * axis.normal[:, None] + contours[..., 1:] * axis.binormal[:, None]
    points = (axis.points[:, None] + offsets).reshape(-1, 3)
    return np.min(tube_foot(aorta, points).distance.reshape(contours.shape[:2]), axis=1)


def anomalous_course(p: SyntheticParameters, aorta: Tube) -> Course:
    """Course of the anomalous artery, its intramural part at the wanted depth.

    Args:
        p: parameters (valid).
        aorta: lumen of the aorta.
    """
    profile = _profile(p)
    correction = np.zeros_like(profile.s)
    for _ in range(_CORRECTIONS):
        course = _course(p, aorta, profile, correction)
        correction = correction + _change(p, profile, course)
    return _course(p, aorta, profile, correction)


def _course(
    p: SyntheticParameters, aorta: Tube, profile: _Profile, correction: Float[np.ndarray, " points"]
) -> Course:
    axis, s_outlet = _laid_out(p, aorta, profile, correction)
    major, minor = _half_axes(p, profile.plateau, axis.s)
    gap = _gap(aorta, axis, elliptic_contours(major, minor, _ANGLES))
    return Course(axis, major, minor, gap, s_outlet)


def _change(
    p: SyntheticParameters, profile: _Profile, course: Course
) -> Float[np.ndarray, " points"]:
    """Depth to add so that the gap is the septum along the plateau.

    Where the artery turns out of the wall its sections tilt; there the change of the plateau is
    held. On the rise the change fades to nothing at the ostium.
    """
    first, last = profile.plateau
    untilted = max(last - p.intramural_half_axes[1], (first + last) / 2.0)
    held = np.clip(profile.s, first, untilted)
    lacking = p.septum - np.interp(held, course.axis.s, course.gap)
    change = _RELAXATION * lacking * np.clip(profile.s / first, 0.0, 1.0)
    return scipy.ndimage.gaussian_filter1d(change, _SMOOTHING / _STEP, mode="nearest")


def normal_course(p: SyntheticParameters, aorta: Tube) -> Course:
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
    stem = start - outward[0] * inside * np.linspace(1.0, 0.0, 8)[:-1, None]
    curve = curve_through(np.concatenate([stem, bezier_points(controls, 31)]), _SPACING)
    s_outlet = float(curve.s[-1]) - inside
    longer = extended(curve, 0.0, p.normal_radius + p.thickness_minimum)
    axis = dataclasses.replace(longer, s=longer.s - inside)
    half = np.full(len(axis.s), p.normal_radius)
    return Course(axis, half, half, _gap(aorta, axis, elliptic_contours(half, half, 16)), s_outlet)
