"""What an operation does to an anatomy: unroofing, reimplantation, a stent.

Each is a pure function from one anatomy to another. The aorta, the other arteries, the outlet and
the thickness of the wall stay; the anomalous artery has new sections, and a new beginning where its
ostium moves::

    unroofed     the inner wall of the intramural course is taken away: the artery opens into the
                 aorta where the course ended, and is round up to there
    reimplanted  the intramural course is cut off: the artery springs at a right angle from the
                 aortic wall outside of which the course ended, in its proper sinus
    stented      the course stays; its sections are round and of the diameter of the stent, pushed
                 away from the aorta so that the tissue between the two lumens stays as thick

Round sections have the reference area, that of the artery beyond its course, and pass into the
patient's own sections over `_PASSAGE`. Idealised: no scar, no patch, no struts, no change of the
sinus, of the tissue outside, or of the bed.
"""

import dataclasses
import math
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import MARGIN, Anatomy, Centerline
from jaxfsi.anatomy.curves.curve import (
    Curve,
    at_arc_length,
    bezier_points,
    curve_through,
    rotation_minimising_normals,
)
from jaxfsi.anatomy.implicit import elliptic_contours, surface_points, tube, tube_foot
from jaxfsi.anatomy.vessel_sections import (
    aorta_distance,
    away_from_aorta,
    contours_at,
    outlet_place,
    tube_areas,
)
from jaxfsi.anatomy.vessels import VesselTube, local_half_width, lumen_function, septum_blend
from jaxfsi.anatomy.wall import requested_thickness, wall_function

ANOMALOUS = "anomalous"

_BEYOND = 0.25  # by which round sections go on beyond the course [cm]
_PASSAGE = 0.5  # over which round sections pass into the patient's own [cm]
_UNROOFED_ANGLE = math.radians(40.0)  # between artery and aortic wall, as steep as a usual take-off
_REACH = 0.9  # beyond the intramural course, where a reimplanted artery meets its old axis [cm]
_ROOM = 0.3  # least length of the old artery that must be left [cm]
_FILLET = 0.06  # tissue at the lip of the new ostium, as of a septum [cm]
_DEPTH = 0.06  # of the start of the artery inside the aortic lumen [cm]
_DIAMETERS = (0.1, 0.6)  # of stents for coronary arteries [cm]


class IntramuralCourse(NamedTuple):
    """The course of the anomalous artery inside the aortic wall.

    Attributes:
        end: its length from the ostium [cm].
        reference_area: area of the artery beyond it [cm²].
    """

    end: float
    reference_area: float


def intramural_course(anatomy: Anatomy) -> IntramuralCourse:
    """Length of the intramural course, and the area of the artery beyond it.

    Args:
        anatomy: from contours or parameters.

    Raises:
        ValueError: the anatomy has no anomalous artery beside an aorta, or nothing tells where its
            course ends.
    """
    vessel, meta = anomalous_vessel(anatomy), anatomy.meta
    parameters = meta.get("parameters")
    if isinstance(parameters, dict):
        end, radius = parameters["intramural_length"], parameters["reference_radius"]
        return IntramuralCourse(float(end), math.pi * float(radius) ** 2)
    beside = np.asarray(meta.get("septum_s", ()), dtype=float)
    if not len(beside):
        raise ValueError(
            "nothing tells where the intramural course ends. Give the tissue between the lumens, in"
            " a frame table or as septum."
        )
    end, outlet = float(beside[-1]), outlet_place(anatomy)
    s = np.linspace(end, outlet, 21)
    return IntramuralCourse(end, float(np.median(tube_areas(vessel.tube, s))))


def anomalous_vessel(anatomy: Anatomy) -> VesselTube:
    """The anomalous artery of an anatomy.

    Raises:
        ValueError: it is a surface, or has no such artery.
    """
    for vessel in anatomy.vessels[1:]:
        if vessel.name == ANOMALOUS:
            return vessel
    raise ValueError(
        f"the anatomy {anatomy.name} has no sections of an anomalous artery. Take one from"
        " contours or parameters, not from a surface or a mesh."
    )


def stented(anatomy: Anatomy, diameter: float | None = None) -> Anatomy:
    """The anatomy with a stent in the intramural course.

    Args:
        anatomy: from contours or parameters.
        diameter: of the lumen inside the stent [cm]; None: that of the reference area.

    Raises:
        ValueError: the diameter is none of a stent, or see `intramural_course`.
    """
    course, vessel = intramural_course(anatomy), anomalous_vessel(anatomy)
    if diameter is None:
        diameter = 2.0 * math.sqrt(course.reference_area / math.pi)
    low, high = _DIAMETERS
    if not low <= diameter <= high:
        raise ValueError(
            f"a stent of {diameter:g} cm is not within {low:g}..{high:g} cm. Give its diameter"
            " in cm."
        )
    axis, radius = vessel.tube.axis, diameter / 2.0
    own = contours_at(vessel.tube, axis.s)
    away = away_from_aorta(anatomy.vessels[0], axis)
    near = np.max(-np.einsum("sak,sk->sa", own, away), axis=1)
    middle = (radius - near)[:, None] * away
    middle[axis.s < 0.0] = middle[np.searchsorted(axis.s, 0.0)]
    half = np.full(len(axis.s), radius)
    round_ = elliptic_contours(half, half, own.shape[1]) + middle[:, None]
    share = _passed(axis.s - course.end - _BEYOND)[:, None, None]
    changed = _vessel(vessel, axis, (1.0 - share) * round_ + share * own)
    changed = dataclasses.replace(changed, thickness=vessel.thickness, blend=vessel.blend)
    line = anatomy.centerlines[ANOMALOUS]
    return _assembled(anatomy, changed, line, {"operation": "stent", "diameter": diameter})


def unroofed(anatomy: Anatomy) -> Anatomy:
    """The anatomy with its intramural course opened into the aorta.

    Raises:
        ValueError: see `intramural_course`.
    """
    course, vessel = intramural_course(anatomy), anomalous_vessel(anatomy)
    axis, aorta = vessel.tube.axis, anatomy.vessels[0]
    point, tangent, _, _ = at_arc_length(axis, np.array([course.end]))
    foot = tube_foot(aorta.tube, point)
    _, normal = surface_points(aorta.tube, foot.s, foot.angle)
    along = tangent[0] - (tangent[0] @ normal[0]) * normal[0]
    along /= np.linalg.norm(along)
    # an arc that begins at the angle and ends along the wall rises by this slope on the whole
    upstream = point[0] - along * float(foot.distance[0]) / math.tan(_UNROOFED_ANGLE / 2.0)
    direction = math.cos(_UNROOFED_ANGLE) * along + math.sin(_UNROOFED_ANGLE) * normal[0]
    return _reattached(anatomy, course, upstream, direction, course.end, "unroof")


def reimplanted(anatomy: Anatomy) -> Anatomy:
    """The anatomy with its intramural course cut off and a round ostium in the proper sinus.

    Raises:
        ValueError: too little of the artery lies beyond its course, or see `intramural_course`.
    """
    course, vessel = intramural_course(anatomy), anomalous_vessel(anatomy)
    join = min(course.end + _REACH, outlet_place(anatomy) - _ROOM)
    place = course.end + 0.4 * (join - course.end)
    point, _, _, _ = at_arc_length(vessel.tube.axis, np.array([place]))
    foot = tube_foot(anatomy.vessels[0].tube, point)
    _, normal = surface_points(anatomy.vessels[0].tube, foot.s, foot.angle)
    return _reattached(anatomy, course, point[0], normal[0], join, "reimplant")


def _reattached(
    anatomy: Anatomy,
    course: IntramuralCourse,
    near: Float[np.ndarray, " 3"],
    direction: Float[np.ndarray, " 3"],
    join: float,
    name: str,
) -> Anatomy:
    """The anatomy whose artery begins elsewhere on the aortic wall.

    Args:
        anatomy: the anatomy.
        course: its intramural course.
        near: the new ostium is the point of the aortic wall nearest to this [cm].
        direction: of the artery at its new ostium, out of the aorta.
        join: arc length at which it meets its old axis [cm].
        name: of the operation.
    """
    vessel, aorta = anomalous_vessel(anatomy), anatomy.vessels[0]
    outlet = outlet_place(anatomy)
    if outlet - join < _ROOM or join < course.end - 1e-9:
        raise ValueError(
            f"the artery goes on for {10 * (outlet - course.end):.1f} mm beyond its intramural"
            f" course, too short for this operation. Give at least {10 * (0.1 + _ROOM):.0f} mm of"
            " it: more frames, distal_extension_mm or distal_length_mm."
        )
    foot = tube_foot(aorta.tube, near[None])
    ostium, normal = surface_points(aorta.tube, foot.s, foot.angle)
    radius = math.sqrt(course.reference_area / math.pi)
    sine = float(np.clip(direction @ normal[0], 0.1, 1.0))
    stem = (radius * math.sqrt(1.0 - sine**2) + _DEPTH) / sine + radius * sine
    axis, start = _new_axis(vessel.tube.axis, ostium[0], direction, stem, join)
    share = _passed(axis.s - start + join - course.end - _BEYOND)[:, None, None]
    own = contours_at(vessel.tube, np.maximum(axis.s - start, 0.0) + join)
    half = np.full(len(axis.s), radius)
    round_ = elliptic_contours(half, half, own.shape[1])
    changed = _vessel(vessel, axis, (1.0 - share) * round_ + share * own)
    changed = dataclasses.replace(
        changed,
        thickness=np.interp(axis.s - start + join, vessel.tube.axis.s, vessel.thickness),
        blend=septum_blend(aorta_distance(aorta, changed.tube), axis.s, _FILLET),
    )
    last = outlet - join + start
    s = np.linspace(0.0, last, max(int(last / axis.spacing), 2) + 1)
    line = Centerline(at_arc_length(axis, s)[0], s)
    return _assembled(anatomy, changed, line, {"operation": name, "moved_ostium": ostium.tolist()})


def _new_axis(
    old: Curve,
    ostium: Float[np.ndarray, " 3"],
    direction: Float[np.ndarray, " 3"],
    stem: float,
    join: float,
) -> tuple[Curve, float]:
    """Axis from inside the aorta through a new ostium, s = 0, on to the old axis.

    Returns:
        The axis, and the arc length at which it meets the old one [cm].
    """
    kept = old.s > join + 0.5 * old.spacing
    point, tangent, normal, _ = (x[0] for x in at_arc_length(old, np.array([join])))
    reach = float(np.linalg.norm(point - ostium)) / 3.0
    bend = bezier_points(
        np.stack([ostium, ostium + reach * direction, point - reach * tangent, point]), 25
    )
    inside = ostium - direction * np.linspace(stem, 0.0, 9)[:-1, None]
    lead = np.concatenate([inside, bend])
    slope = np.gradient(lead, axis=0)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    turned = rotation_minimising_normals(lead[::-1], -slope[::-1], normal)[::-1]
    points = np.concatenate([lead, old.points[kept]])
    normals = np.concatenate([turned, old.normal[kept]])
    axis = curve_through(points, old.spacing, normals=normals)
    nearest = int(np.argmin(np.linalg.norm(axis.points - ostium, axis=1)))
    offset = float((ostium - axis.points[nearest]) @ axis.tangent[nearest])
    zero = float(axis.s[nearest]) + offset
    meets = int(np.argmin(np.linalg.norm(axis.points - point, axis=1)))
    along = float((point - axis.points[meets]) @ axis.tangent[meets])
    return dataclasses.replace(axis, s=axis.s - zero), float(axis.s[meets]) + along - zero


def _passed(s: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " samples"]:
    """From 0 at s ≤ 0 to 1 at `_PASSAGE`, smoothly."""
    x = np.clip(s / _PASSAGE, 0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def _vessel(
    vessel: VesselTube, axis: Curve, contours: Float[np.ndarray, "samples angles 2"]
) -> VesselTube:
    """The artery with other sections; its thickness and blend are still to be set."""
    half = np.min(np.ptp(contours, axis=1), axis=1) / 2.0
    return VesselTube(vessel.name, tube(axis, contours), half, half, half)


def _assembled(
    anatomy: Anatomy, changed: VesselTube, line: Centerline, meta: dict[str, object]
) -> Anatomy:
    """The anatomy with another anomalous artery."""
    vessels = tuple(changed if v.name == changed.name else v for v in anatomy.vessels)
    axis = changed.tube.axis
    kept = (axis.s >= 0.0) & (axis.s <= line.s[-1] + MARGIN)
    spread = changed.tube.radius + float(np.max(changed.thickness)) + MARGIN / 2.0
    bounds = np.stack(
        [
            np.minimum(anatomy.bounds[0], np.min(axis.points[kept], axis=0) - spread),
            np.maximum(anatomy.bounds[1], np.max(axis.points[kept], axis=0) + spread),
        ]
    )
    frames = ("s_frames", "area_frames", "septum_s", "septum", "shift_frames", "s_mouth")
    return dataclasses.replace(
        anatomy,
        name=f"{anatomy.name}, {meta['operation']}",
        lumen=lumen_function(vessels),
        wall=wall_function(vessels),
        local_radius=partial(local_half_width, vessels),
        thickness=partial(requested_thickness, vessels),
        bounds=bounds,
        centerlines={**anatomy.centerlines, ANOMALOUS: line},
        meta={**{k: v for k, v in anatomy.meta.items() if k not in frames}, **meta},
        vessels=vessels,
    )
