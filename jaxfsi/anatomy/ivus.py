"""The anatomy of a patient from an ultrasound pullback and the centre line of a CT.

The measured contours are lofted (`loft`), each turned to the aortic wall (`pullback`), along a path
that follows CT and keeps the measured tissue between the two lumens (`ct_course`)::

    min over contour k of (ϱ − R) = septum_k       for every frame k with a measurement

with ϱ the distance from the aortic axis and R the aortic radius.

Upstream of the last frame, the ostium, its contour is carried on into the aortic lumen at the
take-off angle. The angle is not in these data: 40° lies in the upper half of the published range
(22.9° ± 11.6°, 81 adults) and keeps the wedge of tissue at the ostium thick enough for elements.
Caution: the ultrasound catheter is 1 mm thick, so no lumen narrower than that can be read.
"""

import dataclasses
import os
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import Anatomy, Centerline, Opening
from jaxfsi.anatomy.ct_course import (
    AortaFit,
    Departure,
    OstiumEnd,
    fit_aorta,
    read_centerline,
    wall_path,
)
from jaxfsi.anatomy.curves import Curve, at_arc_length, curve_through, extended
from jaxfsi.anatomy.implicit import elliptic_contours, tube
from jaxfsi.anatomy.loft import eccentric_sections, lofted
from jaxfsi.anatomy.pullback import Pullback, polygon_areas, read_pullback
from jaxfsi.anatomy.vessels import Vessel, local_half_width, lumen_function
from jaxfsi.anatomy.wall import requested_thickness, thickness_from_radius, wall_function

_N_ANGLES = 96
_AORTA_RADII = (0.3, 3.0)  # newborn to aneurysm [cm]
_SPACING = 0.0125  # of the samples along the coronary [cm]
_AORTA_SPACING = 0.1
_OVERRUN = 0.5  # by which vessels run on beyond their openings [cm]
_MARGIN = 0.3  # of the bounds beyond the openings [cm]
_BEFORE = 1.5  # longest way from the ostium frame into the aortic lumen [cm]
_INSIDE = 0.05  # depth of the start of the coronary in the aortic lumen [cm]
_SEPTUM_STEPS = 6  # each leaves less than a tenth of the error
_SHIFT_WIDTH = 0.25  # over which the distance of the axis from the aorta is smoothed [cm]
_DEPARTURE_SLOPE = 0.5
_BALL = 1.15  # radius of an opening's ball over that of the vessel with its wall
_LEAST_BLEND = 0.01
_BLEND_DECAY = 0.15

Thickness = Callable[[Float[np.ndarray, " points"]], Float[np.ndarray, " points"]]


@dataclasses.dataclass(frozen=True)
class IvusOptions:
    """What the measurements do not say.

    Attributes:
        aorta_below: length of aorta upstream of the ostium [cm]; lengthened where the coronary
            would come too near its opening.
        aorta_above: length downstream of it [cm].
        take_off_angle_deg: between the anomalous coronary and the aortic wall at the ostium.
        distal_extension: least length added beyond the distal frame [cm].
        fillet: blend radius of the edge of the ostium [cm].
        thickness_per_radius: wall thickness over local radius.
        thickness_minimum: least wall thickness [cm].
        thickness_maximum: greatest wall thickness [cm].
        ostium_end: which end of the centre line is the ostium.
    """

    aorta_below: float = 2.0
    aorta_above: float = 2.0
    take_off_angle_deg: float = 40.0
    distal_extension: float = 0.5
    fillet: float = 0.06
    thickness_per_radius: float = 0.1
    thickness_minimum: float = 0.05
    thickness_maximum: float = 0.15
    ostium_end: OstiumEnd = "auto"

    def thickness(self, radius: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Wall thickness [cm] of vessels of given radius [cm]."""
        return thickness_from_radius(
            radius,
            factor=self.thickness_per_radius,
            minimum=self.thickness_minimum,
            maximum=self.thickness_maximum,
        )


class _Course(NamedTuple):
    """Axis of the coronary, shift of each section along u, and s of its outlet and its mouth."""

    axis: Curve
    shift: Float[np.ndarray, " frames"]
    s_outlet: float
    s_mouth: float


def ivus_anatomy(
    contours: str | os.PathLike[str],
    centerline: str | os.PathLike[str],
    *,
    frame_table: str | os.PathLike[str] | None = None,
    reference: str | os.PathLike[str] | None = None,
    state: str = "",
    aorta_radius: float = 1.4,
    septum: float | None = None,
    options: IvusOptions | None = None,
) -> Anatomy:
    """Lumen and wall of a patient with an anomalous coronary, in one measured state.

    Args:
        contours: pullback, see `read_pullback`.
        centerline: CT centre line of the anomalous coronary, see `read_centerline`.
        frame_table: order of the frames and measured tissue, see `read_pullback`.
        reference: point on the aortic side, see `read_pullback`.
        state: name of the measured state, kept with the anatomy.
        aorta_radius: radius of the aortic lumen [cm]; not in these data.
        septum: tissue between the two lumens [cm], instead of the measured one; needed where the
            frame table holds none.
        options: what the measurements do not say.

    Returns:
        The anatomy in aortic coordinates (z along the aorta, downstream; z = 0 at the ostium),
        with openings ``aorta_inlet``, ``aorta_outlet``, ``anomalous_outlet``. Its ``meta`` holds
        the frames: ``s_frames``, ``area_frames``, ``septum_s``, ``septum``; s is arc length on
        ``centerlines["anomalous"]``, whose first point is the ostium frame.

    Raises:
        ValueError: a file cannot be read, or the data do not fit together; says what to change.
    """
    options = IvusOptions() if options is None else options
    low, high = _AORTA_RADII
    if not low <= aorta_radius <= high:
        raise ValueError(
            f"an aortic radius of {aorta_radius:g} cm is not within {low:g}..{high:g} cm."
            " Give it in cm."
        )
    pullback = read_pullback(contours, frame_table=frame_table, reference=reference)
    pullback = _with_septum(pullback, septum)
    fit = fit_aorta(
        read_centerline(centerline),
        aorta_radius,
        offset=float(np.nanmean(pullback.septum) + np.ptp(pullback.sections[0, :, 0]) / 2.0),
        ostium_end=options.ostium_end,
    )
    course = _coronary_course(pullback, fit, aorta_radius, options)
    coronary = _coronary(pullback, course, options)
    return _assembled(pullback, fit, course, coronary, aorta_radius, options, state)


def _with_septum(pullback: Pullback, septum: float | None) -> Pullback:
    """The pullback with a given septum on its first centimetre, or the measured one."""
    if septum is not None:
        if not 0.0 < septum <= 1.0:
            raise ValueError(f"a septum of {septum:g} cm is not between 0 and 1 cm. Give it in cm.")
        beside = pullback.s <= max(1.0, float(pullback.s[1]))
        return pullback._replace(septum=np.where(beside, septum, np.nan))
    if not np.any(np.isfinite(pullback.septum)):
        raise ValueError(
            "no tissue thickness between aorta and coronary is known. Give a frame table with a"
            " measurement_1 column, or the septum [cm]."
        )
    return pullback


def _filled(pullback: Pullback) -> tuple[Float[np.ndarray, " frames"], int]:
    """Septum of every frame, and the index of the last frame with a measurement."""
    measured = np.flatnonzero(np.isfinite(pullback.septum))
    filled = np.interp(pullback.s, pullback.s[measured], pullback.septum[measured])
    return filled, int(measured[-1])


def _placed(
    axis: Curve, s: Float[np.ndarray, " frames"], sections: Float[np.ndarray, "frames points 2"]
) -> Float[np.ndarray, "frames points 3"]:
    """Points of sections in space."""
    position, _, normal, binormal = at_arc_length(axis, s)
    across = sections[..., :1] * normal[:, None] + sections[..., 1:] * binormal[:, None]
    return position[:, None] + across


def _framed(points: Float[np.ndarray, "n 3"], s: Float[np.ndarray, " n"]) -> Curve:
    """Curve through a path with its normals pointing away from the aortic axis (z)."""
    outward = points * np.array([1.0, 1.0, 0.0])
    curve = curve_through(points, _SPACING, normals=outward)
    return dataclasses.replace(curve, s=curve.s + s[0])


def _between(curve: Curve, low: float, high: float) -> Curve:
    keep = (curve.s >= low) & (curve.s <= high)
    return Curve(*(getattr(curve, field.name)[keep] for field in dataclasses.fields(curve)))


def _locally_linear(
    s: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, " frames"]:
    """Values smoothed by a straight line through the neighbours, with Gaussian weights."""
    away = s[None] - s[:, None]
    weight = np.exp(-((away / _SHIFT_WIDTH) ** 2) / 2.0)
    m0, m1, m2 = (np.sum(weight * away**i, axis=1) for i in range(3))
    line = weight * (m2[:, None] - m1[:, None] * away)
    return line @ values / (m0 * m2 - m1**2)


def _coronary_course(
    pullback: Pullback, fit: AortaFit, aorta_radius: float, options: IvusOptions
) -> _Course:
    """A smooth axis, from inside the aorta to the outlet, and the sections placed about it.

    The distance of the axis from the aorta is smoothed along s, so that its planes stay parallel
    to their neighbours where sizes jump from frame to frame; what is left of the measured distance
    moves each section within its own plane.
    """
    septum, last = _filled(pullback)
    slope = float(np.tan(np.radians(options.take_off_angle_deg)))
    departure = Departure(slope, _DEPARTURE_SLOPE, float(pullback.s[last]))
    distance = aorta_radius + septum - np.min(pullback.sections[:, :, 0], axis=1)
    path = wall_path(
        fit.course,
        pullback.s,
        _locally_linear(pullback.s, distance),
        departure,
        before=_BEFORE,
        after=float(pullback.s[-1]) + options.distal_extension + 2.0 * _BEFORE,
    )
    axis = _framed(*path)
    shift = np.zeros(len(septum))
    measured = slice(0, last + 1)
    for _ in range(_SEPTUM_STEPS):
        sections = _shifted(pullback.sections, shift)
        placed = _placed(axis, pullback.s, sections)
        gap = np.min(np.hypot(placed[..., 0], placed[..., 1]), axis=1) - aorta_radius
        shift[measured] += (septum - gap)[measured]
    return _cut(pullback, axis, shift, aorta_radius, options)


def _shifted(
    sections: Float[np.ndarray, "frames points 2"], shift: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames points 2"]:
    return sections + np.stack([shift, np.zeros_like(shift)], axis=1)[:, None]


def _cut(
    pullback: Pullback,
    axis: Curve,
    shift: Float[np.ndarray, " frames"],
    aorta_radius: float,
    options: IvusOptions,
) -> _Course:
    """Let the axis start inside the aortic lumen and end where its outlet is clear of the aorta."""
    upstream = axis.s[axis.s <= 0.0]
    ostium = _shifted(pullback.sections, shift)[0]
    first = np.broadcast_to(ostium, (len(upstream), *ostium.shape))
    placed = _placed(axis, upstream, first)
    outmost = np.max(np.hypot(placed[..., 0], placed[..., 1]), axis=1)
    inside = np.flatnonzero(outmost < aorta_radius - _INSIDE)
    rho = np.hypot(axis.points[:, 0], axis.points[:, 1])
    clear = aorta_radius + float(options.thickness(np.array([aorta_radius]))[0])
    clear += _outlet_radius(pullback, options)
    far = axis.s >= pullback.s[-1] + options.distal_extension
    outside = np.flatnonzero(far & (rho >= clear))
    if len(inside) == 0 or len(outside) == 0:
        end = "enter the aortic lumen" if len(inside) == 0 else "leave the aortic wall"
        raise ValueError(
            f"the coronary does not {end} within {_BEFORE:g} cm of its frames."
            " Raise the take-off angle or check the centre line."
        )
    s_outlet = float(axis.s[outside[0]])
    mouth = axis.s[(axis.s <= 0.0) & (rho <= aorta_radius)]
    body = _between(axis, float(upstream[inside[-1]]) - 1e-9, s_outlet + 1e-9)
    return _Course(extended(body, 0.0, _OVERRUN), shift, s_outlet, float(mouth[-1]))


def _outlet_radius(pullback: Pullback, options: IvusOptions) -> float:
    section = pullback.sections[-1]
    radius = np.sqrt(polygon_areas(section[None]) / np.pi)
    reach = float(np.max(np.linalg.norm(section, axis=1)))
    return _BALL * (reach + float(options.thickness(radius)[0]))


def _coronary(pullback: Pullback, course: _Course, options: IvusOptions) -> Vessel:
    frames = eccentric_sections(pullback.sections, _N_ANGLES)
    s = course.axis.s
    table = lofted(pullback.s, _shifted(frames, course.shift), s)
    blend = options.fillet * np.exp(-(((s - course.s_mouth) / _BLEND_DECAY) ** 2) / 2.0)
    return Vessel(
        name="anomalous",
        tube=tube(course.axis, table),
        half_width=np.min(np.ptp(table, axis=1), axis=1) / 2.0,
        thickness=options.thickness(np.sqrt(polygon_areas(table) / np.pi)),
        blend=np.maximum(blend, _LEAST_BLEND),
    )


def _aorta(radius: float, below: float, above: float, options: IvusOptions) -> Vessel:
    ends = np.array([[0.0, 0.0, -below - _OVERRUN], [0.0, 0.0, above + _OVERRUN]])
    axis = curve_through(ends, _AORTA_SPACING)
    radii = np.full(len(axis.s), radius)
    contours = elliptic_contours(radii, radii, _N_ANGLES)
    return Vessel(
        "aorta", tube(axis, contours), radii, options.thickness(radii), np.zeros(len(radii))
    )


def _clear_length(
    length: float, sign: float, ball: float, axis: Curve, reach: Float[np.ndarray, " samples"]
) -> float:
    """Least length ≥ the given one at which no part of the coronary enters the ball [cm]."""
    while True:
        centre = np.array([0.0, 0.0, sign * length])
        if np.all(np.linalg.norm(axis.points - centre, axis=1) - reach > ball):
            return length
        length += _AORTA_SPACING


def _assembled(
    pullback: Pullback,
    fit: AortaFit,
    course: _Course,
    coronary: Vessel,
    aorta_radius: float,
    options: IvusOptions,
    state: str,
) -> Anatomy:
    axis = coronary.tube.axis
    reach = coronary.tube.radius + coronary.thickness
    t_aorta = float(options.thickness(np.array([aorta_radius]))[0])
    ball = _BALL * (aorta_radius + t_aorta)
    outside = _between(axis, 0.0, np.inf)
    outer = reach[axis.s >= 0.0]
    below = _clear_length(options.aorta_below, -1.0, ball, outside, outer)
    above = _clear_length(options.aorta_above, 1.0, ball, outside, outer)
    vessels = (_aorta(aorta_radius, below, above, options), coronary)
    end, tangent, normal, _ = at_arc_length(axis, np.array([course.s_outlet]))
    end = end + course.shift[-1] * normal
    up = np.array([0.0, 0.0, 1.0])
    openings = (
        Opening("aorta_inlet", -below * up, -up, ball),
        Opening("aorta_outlet", above * up, up, ball),
        Opening("anomalous_outlet", end[0], tangent[0], _outlet_radius(pullback, options)),
    )
    half = aorta_radius + t_aorta + _MARGIN / 2.0
    low = np.array([-half, -half, -below - _MARGIN])
    high = np.array([half, half, above + _MARGIN])
    kept = (axis.s >= 0.0) & (axis.s <= course.s_outlet + _MARGIN)
    spread = (reach[kept] + _MARGIN / 2.0)[:, None]
    bounds = np.stack(
        [
            np.minimum(low, np.min(axis.points[kept] - spread, axis=0)),
            np.maximum(high, np.max(axis.points[kept] + spread, axis=0)),
        ]
    )
    shown = np.linspace(0.0, course.s_outlet, int(course.s_outlet / _SPACING) + 1)
    height = np.linspace(-below, above, 81)
    line = np.stack([np.zeros(81), np.zeros(81), height], axis=1)
    return Anatomy(
        name=f"ivus {state}".strip(),
        lumen=lumen_function(vessels),
        wall=wall_function(vessels),
        local_radius=partial(local_half_width, vessels),
        thickness=partial(requested_thickness, vessels),
        openings=openings,
        bounds=bounds,
        centerlines={
            "aorta": Centerline(line, height + below),
            "anomalous": Centerline(at_arc_length(axis, shown)[0], shown),
        },
        meta=_meta(pullback, fit, course, aorta_radius, options, state),
    )


def _meta(
    pullback: Pullback,
    fit: AortaFit,
    course: _Course,
    aorta_radius: float,
    options: IvusOptions,
    state: str,
) -> dict[str, object]:
    measured = np.isfinite(pullback.septum)
    return {
        "source": "ivus",
        "state": state,
        "aorta_radius": aorta_radius,
        "s_frames": pullback.s.tolist(),
        "area_frames": polygon_areas(pullback.sections).tolist(),
        "septum_s": pullback.s[measured].tolist(),
        "septum": pullback.septum[measured].tolist(),
        "aortic_side_known": pullback.side_known,
        "s_mouth": course.s_mouth,
        "s_outlet": course.s_outlet,
        "shift_frames": course.shift.tolist(),
        "ostium_is_first_point": fit.from_first,
        "centerline_residual": fit.residual,
        "aortic_axes_in_ct": fit.rotation.tolist(),
        "aortic_origin_in_ct": fit.origin.tolist(),
        "options": dataclasses.asdict(options),
    }
