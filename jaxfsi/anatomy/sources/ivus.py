"""The anatomy of a patient from an ultrasound pullback and the centre line of a CT.

The measured contours are lofted (`loft`), each turned to the aortic wall (`pullback`), along a path
that follows CT (`ct_course`) and keeps the measured tissue between the two lumens
(`septum_course`).

Upstream of the last frame, the ostium, its contour is carried on into the aortic lumen at the
take-off angle. The angle is not in these data: 40° lies in the upper half of the published range
(22.9° ± 11.6°, 81 adults) and keeps the wedge of tissue at the ostium thick enough for elements.
Caution: the ultrasound catheter is 1 mm thick, so no lumen narrower than that can be read.
"""

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import MARGIN, OPENING_BALL, OVERRUN, Anatomy, Centerline, Opening
from jaxfsi.anatomy.curves.curve import Curve, at_arc_length, curve_through
from jaxfsi.anatomy.curves.loft import eccentric_sections, lofted
from jaxfsi.anatomy.implicit import elliptic_contours, tube
from jaxfsi.anatomy.sources.centerline_files import read_centerline
from jaxfsi.anatomy.sources.ct_course import AortaFit, OstiumEnd, fit_aorta
from jaxfsi.anatomy.sources.pullback import Pullback, polygon_areas, read_pullback
from jaxfsi.anatomy.sources.septum_course import (
    CoronaryCourse,
    between,
    coronary_course,
    shifted,
)
from jaxfsi.anatomy.vessels import VesselTube, local_half_width, lumen_function
from jaxfsi.anatomy.wall import requested_thickness, thickness_from_radius, wall_function

_N_ANGLES = 96
_AORTA_RADII = (0.3, 3.0)  # newborn to aneurysm [cm]
_LINE_SPACING = 0.0125  # of the points of centre lines [cm]
_AORTA_SPACING = 0.1
_LEAST_BLEND = 0.01
_BLEND_DECAY = 0.15


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
        measured_minimum: least wall thickness where it is measured [cm].
        measured_maximum: greatest wall thickness there [cm].
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
    measured_minimum: float = 0.01
    measured_maximum: float = 0.5

    def thickness(self, radius: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Wall thickness [cm] of vessels of given radius [cm].

        Raises:
            ValueError: the wall is thicker than a radius.
        """
        thickness = thickness_from_radius(
            radius,
            factor=self.thickness_per_radius,
            minimum=self.thickness_minimum,
            maximum=self.thickness_maximum,
        )
        if np.any(thickness > radius):
            k = int(np.argmax(thickness - radius))
            raise ValueError(
                f"a wall of {thickness[k]:.2g} cm is thicker than the vessel's radius of"
                f" {radius[k]:.2g} cm. Lower thickness_minimum or thickness_per_radius (cm)."
            )
        return thickness


def ivus_anatomy(
    contours: str | os.PathLike[str],
    centerline: str | os.PathLike[str],
    *,
    frame_table: str | os.PathLike[str] | None = None,
    reference: str | os.PathLike[str] | None = None,
    state: str = "",
    aorta_radius: float = 1.4,
    septum: float | None = None,
    external: str | os.PathLike[str] | None = None,
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
        external: contours of the external elastic membrane of the same pullback; the wall of the
            coronary then has the measured thickness, not one that follows the radius.
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
    pullback = read_pullback(
        contours, frame_table=frame_table, reference=reference, external=external
    )
    with _about(contours if frame_table is None else frame_table):
        pullback = _with_septum(pullback, septum)
    line = read_centerline(centerline)
    with _about(centerline):
        fit = fit_aorta(
            line,
            aorta_radius,
            offset=float(np.nanmean(pullback.septum) + np.ptp(pullback.sections[0, :, 0]) / 2.0),
            ostium_end=options.ostium_end,
        )
    t_aorta = float(options.thickness(np.array([aorta_radius]))[0])
    course = coronary_course(
        pullback,
        fit.course,
        aorta_radius,
        take_off_angle_deg=options.take_off_angle_deg,
        extension=options.distal_extension,
        clearance=aorta_radius + t_aorta + _outlet_radius(pullback, options),
        overrun=OVERRUN,
    )
    coronary = _coronary(pullback, course, options)
    return _assembled(pullback, fit, course, coronary, aorta_radius, options, state)


@contextmanager
def _about(file: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file that a refusal is about."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


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


def _outlet_radius(pullback: Pullback, options: IvusOptions) -> float:
    section = pullback.sections[-1]
    radius = np.sqrt(polygon_areas(section[None]) / np.pi)
    reach = float(np.max(np.linalg.norm(section, axis=1)))
    thickness = _coronary_thickness(pullback, pullback.s[-1:], radius, options)
    return OPENING_BALL * (reach + float(thickness[0]))


def _coronary_thickness(
    pullback: Pullback,
    s: Float[np.ndarray, " n"],
    radius: Float[np.ndarray, " n"],
    options: IvusOptions,
) -> Float[np.ndarray, " n"]:
    """Thickness of the coronary wall [cm]: as measured, else from the radius."""
    if pullback.wall is None:
        return options.thickness(radius)
    measured = pullback.wall.along(pullback.s, s)
    measured = np.clip(measured, options.measured_minimum, options.measured_maximum)
    return np.minimum(measured, 0.9 * radius)


def _coronary(pullback: Pullback, course: CoronaryCourse, options: IvusOptions) -> VesselTube:
    frames = eccentric_sections(pullback.sections, _N_ANGLES)
    s = course.axis.s
    table = lofted(pullback.s, shifted(frames, course.shift), s)
    blend = options.fillet * np.exp(-(((s - course.s_mouth) / _BLEND_DECAY) ** 2) / 2.0)
    return VesselTube(
        name="anomalous",
        tube=tube(course.axis, table),
        half_width=np.min(np.ptp(table, axis=1), axis=1) / 2.0,
        thickness=_coronary_thickness(pullback, s, np.sqrt(polygon_areas(table) / np.pi), options),
        blend=np.maximum(blend, _LEAST_BLEND),
    )


def _aorta(radius: float, below: float, above: float, options: IvusOptions) -> VesselTube:
    ends = np.array([[0.0, 0.0, -below - OVERRUN], [0.0, 0.0, above + OVERRUN]])
    axis = curve_through(ends, _AORTA_SPACING)
    radii = np.full(len(axis.s), radius)
    contours = elliptic_contours(radii, radii, _N_ANGLES)
    return VesselTube(
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
    course: CoronaryCourse,
    coronary: VesselTube,
    aorta_radius: float,
    options: IvusOptions,
    state: str,
) -> Anatomy:
    axis = coronary.tube.axis
    reach = coronary.tube.radius + coronary.thickness
    t_aorta = float(options.thickness(np.array([aorta_radius]))[0])
    ball = OPENING_BALL * (aorta_radius + t_aorta)
    outside = between(axis, 0.0, np.inf)
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
    half = aorta_radius + t_aorta + MARGIN / 2.0
    low = np.array([-half, -half, -below - MARGIN])
    high = np.array([half, half, above + MARGIN])
    kept = (axis.s >= 0.0) & (axis.s <= course.s_outlet + MARGIN)
    spread = (reach[kept] + MARGIN / 2.0)[:, None]
    bounds = np.stack(
        [
            np.minimum(low, np.min(axis.points[kept] - spread, axis=0)),
            np.maximum(high, np.max(axis.points[kept] + spread, axis=0)),
        ]
    )
    shown = np.linspace(0.0, course.s_outlet, int(course.s_outlet / _LINE_SPACING) + 1)
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
        vessels=vessels,
    )


def _meta(
    pullback: Pullback,
    fit: AortaFit,
    course: CoronaryCourse,
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
        **_measured_wall(pullback),
        "options": dataclasses.asdict(options),
    }


def _measured_wall(pullback: Pullback) -> dict[str, object]:
    """The measured thickness of the wall [cm] at the frames that have it, least and greatest."""
    if pullback.wall is None:
        return {}
    known = np.isfinite(pullback.wall.mean)
    return {
        "wall_s": pullback.s[known].tolist(),
        "wall_mean": pullback.wall.mean[known].tolist(),
        "wall_least": pullback.wall.least[known].tolist(),
        "wall_greatest": pullback.wall.greatest[known].tolist(),
    }
