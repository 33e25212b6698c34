"""The anomalous coronary of a pullback as a vessel with its wall."""

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import OPENING_BALL
from jaxfsi.anatomy.curves.loft import eccentric_sections, lofted
from jaxfsi.anatomy.implicit import tube
from jaxfsi.anatomy.sources.ivus_options import IvusOptions
from jaxfsi.anatomy.sources.pullback import Pullback
from jaxfsi.anatomy.sources.septum_course import CoronaryCourse, shifted
from jaxfsi.anatomy.vessels import VesselTube
from jaxfsi.polygons import polygon_areas

_N_ANGLES = 96
_LEAST_BLEND = 0.01
_BLEND_DECAY = 0.15


def outlet_radius(pullback: Pullback, options: IvusOptions) -> float:
    """Radius of the ball of the cut beyond the distal frame [cm]."""
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


def coronary_vessel(pullback: Pullback, course: CoronaryCourse, options: IvusOptions) -> VesselTube:
    """The artery: its frames, moved as the septum asks, lofted along its course.

    Args:
        pullback: sections and, where it is measured, thickness of the wall.
        course: axis and shifts.
        options: what the measurements do not say.
    """
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
