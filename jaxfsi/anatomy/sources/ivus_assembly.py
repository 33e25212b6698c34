"""Aorta, anomalous coronary and, where it is known, normal coronary as one anatomy, with its cuts.

The aorta is cut across its axis at given lengths from the ostium; further away where the ball of
the cut would touch a coronary.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import MARGIN, OPENING_BALL, OVERRUN, Anatomy, Centerline, Opening
from jaxfsi.anatomy.curves.curve import at_arc_length
from jaxfsi.anatomy.sources.aortic_axis import AorticAxis, aortic_tube, wall_points
from jaxfsi.anatomy.sources.ct_course import AortaFit
from jaxfsi.anatomy.sources.ivus_coronary import outlet_radius
from jaxfsi.anatomy.sources.ivus_options import IvusOptions
from jaxfsi.anatomy.sources.normal_branch import NormalBranch
from jaxfsi.anatomy.sources.pullback import Pullback
from jaxfsi.anatomy.sources.septum_course import CoronaryCourse
from jaxfsi.anatomy.vessels import VesselTube, local_half_width, lumen_function
from jaxfsi.anatomy.wall import requested_thickness, wall_function
from jaxfsi.polygons import polygon_areas

_LINE_SPACING = 0.0125  # of the points of centre lines [cm]
_LENGTHENING = 0.1  # step by which the aorta is lengthened [cm]
_RIM = 48  # points of a rim that bounds the aorta


def _aorta(aorta: AorticAxis, below: float, above: float, options: IvusOptions) -> VesselTube:
    lumen, radius = aortic_tube(aorta, -below - OVERRUN, above + OVERRUN)
    return VesselTube("aorta", lumen, radius, options.thickness(radius), np.zeros(len(radius)))


class _End(NamedTuple):
    """Where the aorta is cut, on one side of the ostium.

    Attributes:
        length: from the ostium along the axis [cm].
        opening: the cut.
    """

    length: float
    opening: Opening


def _aortic_end(
    aorta: AorticAxis,
    wanted: float,
    sign: float,
    arteries: Sequence[VesselTube],
    options: IvusOptions,
) -> _End:
    """The cut at the least length ≥ the wanted one at which no artery enters its ball."""
    outer = [
        (v.tube.axis.points[outside], (v.tube.radius + v.thickness)[outside])
        for v in arteries
        for outside in [v.tube.axis.s >= 0.0]
    ]
    name, key = ("aorta_inlet", "aorta_below") if sign < 0.0 else ("aorta_outlet", "aorta_above")
    reach = abs(aorta.known[0] if sign < 0.0 else aorta.known[1])
    length = wanted
    while length <= reach:
        place = np.array([sign * length])
        centre, tangent, _, _ = (x[0] for x in at_arc_length(aorta.axis, place))
        radius = aorta.radius_at(place)
        ball = float(OPENING_BALL * (radius + options.thickness(radius))[0])
        if all(np.all(np.linalg.norm(p - centre, axis=1) - r > ball) for p, r in outer):
            return _End(length, Opening(name, centre, sign * tangent, ball))
        length += _LENGTHENING
    side = "upstream" if sign < 0.0 else "downstream"
    raise ValueError(
        f"the centre line reaches {reach:.3g} cm {side} of the ostium; the aorta is to be cut"
        f" {length:.3g} cm {side}, clear of the coronaries. Give a longer centre line, or lower"
        f" {key}."
    )


def assembled(
    pullback: Pullback,
    fit: AortaFit,
    course: CoronaryCourse,
    arteries: tuple[VesselTube, NormalBranch | None],
    options: IvusOptions,
    state: str,
) -> Anatomy:
    """The anatomy of the vessels.

    Args:
        pullback: of the anomalous coronary.
        fit: the aorta.
        course: of the anomalous coronary.
        arteries: the anomalous coronary, and the normal one or None.
        options: where the aorta is cut, and how thick its wall is.
        state: name of the measured state.

    Raises:
        ValueError: the centre line of the aorta is too short, or bends too sharply.
    """
    coronary, normal = arteries
    axis = coronary.tube.axis
    branches = (coronary,) if normal is None else (coronary, normal.vessel)
    inlet = _aortic_end(fit.aorta, options.aorta_below, -1.0, branches, options)
    outlet = _aortic_end(fit.aorta, options.aorta_above, 1.0, branches, options)
    below, above = inlet.length, outlet.length
    vessels = (_aorta(fit.aorta, below, above, options), *branches)
    end, tangent, across, _ = at_arc_length(axis, np.array([course.s_outlet]))
    end = end + course.shift[-1] * across
    distal = Opening("anomalous_outlet", end[0], tangent[0], outlet_radius(pullback, options))
    cuts = {"anomalous": course.s_outlet} | ({} if normal is None else {"normal": normal.s_outlet})
    height = np.linspace(-below, above, 81)
    lines = {"aorta": Centerline(at_arc_length(fit.aorta.axis, height)[0], height + below)}
    for vessel in branches:
        last = cuts[vessel.name]
        shown = np.linspace(0.0, last, int(last / _LINE_SPACING) + 1)
        lines[vessel.name] = Centerline(at_arc_length(vessel.tube.axis, shown)[0], shown)
    return Anatomy(
        name=f"ivus {state}".strip(),
        lumen=lumen_function(vessels),
        wall=wall_function(vessels),
        local_radius=partial(local_half_width, vessels),
        thickness=partial(requested_thickness, vessels),
        openings=(inlet.opening, outlet.opening, distal, *((normal.outlet,) if normal else ())),
        bounds=_bounds(fit.aorta, (-below, above), branches, cuts, options),
        centerlines=lines,
        meta=_meta(pullback, fit, course, options, state),
        vessels=vessels,
    )


def _bounds(
    aorta: AorticAxis,
    levels: tuple[float, float],
    branches: Sequence[VesselTube],
    cuts: Mapping[str, float],
    options: IvusOptions,
) -> Float[np.ndarray, "2 3"]:
    """Corners of a box round the aorta between two levels and the arteries up to their cuts."""
    s = np.linspace(levels[0] - MARGIN, levels[1] + MARGIN, _RIM)
    radius = aorta.radius_at(s)
    outer = radius + options.thickness(radius) + MARGIN / 2.0
    angle = 2.0 * np.pi * np.arange(_RIM) / _RIM
    rims = wall_points(aorta, np.repeat(outer, _RIM), np.tile(angle, len(s)), np.repeat(s, _RIM))
    low, high = rims.min(axis=0), rims.max(axis=0)
    for vessel in branches:
        axis = vessel.tube.axis
        kept = (axis.s >= 0.0) & (axis.s <= cuts[vessel.name] + MARGIN)
        spread = (vessel.tube.radius + vessel.thickness[kept] + MARGIN / 2.0)[:, None]
        low = np.minimum(low, np.min(axis.points[kept] - spread, axis=0))
        high = np.maximum(high, np.max(axis.points[kept] + spread, axis=0))
    return np.stack([low, high])


def _meta(
    pullback: Pullback,
    fit: AortaFit,
    course: CoronaryCourse,
    options: IvusOptions,
    state: str,
) -> dict[str, object]:
    measured = np.isfinite(pullback.septum)
    return {
        "source": "ivus",
        "state": state,
        "aorta_radius": float(fit.aorta.radius_at(np.zeros(1))[0]),
        "aorta_measured": bool(np.isfinite(fit.aorta.known[0])),
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
