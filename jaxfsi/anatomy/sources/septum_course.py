"""The axis of a coronary that keeps the tissue measured between its lumen and the aorta.

For every frame k with a measurement the section, placed in the plane across the axis, satisfies::

    min over contour k of gap = septum_k

with the gap of `aortic_axis`, the distance from the aortic lumen. The distance of the coronary axis
from the aorta is smoothed along s, so that its planes stay parallel to their neighbours where sizes
jump from frame to frame; what is left of the measured distance moves each section within its plane.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.curves.curve import Curve, at_arc_length, curve_through, extended
from jaxfsi.anatomy.sources.aortic_axis import AorticAxis, aortic_gap, outward
from jaxfsi.anatomy.sources.ct_course import Departure, wall_path
from jaxfsi.anatomy.sources.pullback import Pullback

_SPACING = 0.0125  # of the samples along the coronary [cm]
_BEFORE = 1.5  # longest way from the ostium frame into the aortic lumen [cm]
_INSIDE = 0.05  # depth of the start of the coronary in the aortic lumen [cm]
_SEPTUM_STEPS = 6  # each leaves less than a tenth of the error
_SHIFT_WIDTH = 0.25  # over which the distance of the axis from the aorta is smoothed [cm]
_DEPARTURE_SLOPE = 0.5


class CoronaryCourse(NamedTuple):
    """Axis of the coronary with its sections.

    Attributes:
        axis: from inside the aortic lumen to beyond the outlet; s = 0 at the ostium frame.
        shift: of each section along u [cm].
        s_outlet: where the vessel is cut [cm].
        s_mouth: where the axis crosses the surface of the aortic lumen [cm].
    """

    axis: Curve
    shift: Float[np.ndarray, " frames"]
    s_outlet: float
    s_mouth: float


def _filled(pullback: Pullback) -> tuple[Float[np.ndarray, " frames"], int]:
    """Septum of every frame, and the index of the last frame with a measurement."""
    measured = np.flatnonzero(np.isfinite(pullback.septum))
    filled = np.interp(pullback.s, pullback.s[measured], pullback.septum[measured])
    return filled, int(measured[-1])


def placed_sections(
    axis: Curve, s: Float[np.ndarray, " frames"], sections: Float[np.ndarray, "frames points 2"]
) -> Float[np.ndarray, "frames points 3"]:
    """Points of sections in space."""
    position, _, normal, binormal = at_arc_length(axis, s)
    across = sections[..., :1] * normal[:, None] + sections[..., 1:] * binormal[:, None]
    return position[:, None] + across


def _framed(
    aorta: AorticAxis, points: Float[np.ndarray, "n 3"], s: Float[np.ndarray, " n"]
) -> Curve:
    """Curve through a path with its normals pointing away from the aortic axis."""
    curve = curve_through(points, _SPACING, normals=outward(aorta, points))
    return dataclasses.replace(curve, s=curve.s + s[0])


def between(curve: Curve, low: float, high: float) -> Curve:
    """The samples of a curve from s = low to s = high [cm]."""
    keep = (curve.s >= low - 1e-9) & (curve.s <= high + 1e-9)
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


def coronary_course(
    pullback: Pullback,
    course: Float[np.ndarray, "points 3"],
    aorta: AorticAxis,
    *,
    take_off_angle_deg: float,
    extension: float,
    clearance: float,
    overrun: float,
) -> CoronaryCourse:
    """A smooth axis, from inside the aorta to the outlet, and the sections placed about it.

    Args:
        pullback: sections and measured septum.
        course: CT centre line in aortic coordinates, see `AortaFit`.
        aorta: axis and radius of the aorta.
        take_off_angle_deg: between coronary and aortic wall at the ostium.
        extension: least length beyond the distal frame [cm].
        clearance: distance from the aortic lumen that the outlet must reach [cm].
        overrun: length of axis beyond the outlet [cm].

    Raises:
        ValueError: the coronary reaches the aortic lumen, or the clearance, nowhere.
    """
    septum, last = _filled(pullback)
    slope = float(np.tan(np.radians(take_off_angle_deg)))
    departure = Departure(slope, _DEPARTURE_SLOPE, float(pullback.s[last]))
    distance = septum - np.min(pullback.sections[:, :, 0], axis=1)
    path = wall_path(
        aorta,
        course,
        pullback.s,
        _locally_linear(pullback.s, distance),
        departure,
        before=_BEFORE,
        after=float(pullback.s[-1]) + extension + 2.0 * _BEFORE,
    )
    axis = _framed(aorta, *path)
    shift = np.zeros(len(septum))
    measured = slice(0, last + 1)
    for _ in range(_SEPTUM_STEPS):
        sections = shifted(pullback.sections, shift)
        placed = placed_sections(axis, pullback.s, sections)
        gap = np.min(aortic_gap(aorta, placed), axis=1)
        shift[measured] += (septum - gap)[measured]
    s_start, s_mouth = _entrance(aorta, axis, shifted(pullback.sections, shift)[0])
    s_outlet = first_clear(aorta, axis, float(pullback.s[-1]) + extension, clearance)
    inside = between(axis, s_start, s_outlet)
    return CoronaryCourse(extended(inside, 0.0, overrun), shift, s_outlet, s_mouth)


def shifted(
    sections: Float[np.ndarray, "frames points 2"], shift: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames points 2"]:
    """Sections moved along u [cm]."""
    return sections + np.stack([shift, np.zeros_like(shift)], axis=1)[:, None]


def _entrance(
    aorta: AorticAxis, axis: Curve, ostium: Float[np.ndarray, "points 2"]
) -> tuple[float, float]:
    """Where the ostium section lies wholly inside the aortic lumen, and where its axis enters."""
    s = axis.s[axis.s <= 0.0]
    placed = placed_sections(axis, s, np.broadcast_to(ostium, (len(s), *ostium.shape)))
    inside = np.flatnonzero(np.max(aortic_gap(aorta, placed), axis=1) < -_INSIDE)
    if len(inside) == 0:
        raise ValueError(
            f"the coronary does not enter the aortic lumen within {_BEFORE:g} cm of the ostium"
            " frame. Raise the take-off angle, or check the septum at the ostium."
        )
    mouth = s[aortic_gap(aorta, axis.points[: len(s)]) <= 0.0]
    return float(s[inside[-1]]), float(mouth[-1])


def first_clear(aorta: AorticAxis, axis: Curve, least: float, clearance: float) -> float:
    """First place of an artery beyond ``least`` that is far enough from the aortic lumen [cm].

    Args:
        aorta: axis and radius of the aorta.
        axis: of the artery.
        least: arc length from which on the place is looked for [cm].
        clearance: distance from the aortic lumen [cm].

    Raises:
        ValueError: the axis ends before, or there is none.
    """
    if axis.s[-1] < least:
        raise ValueError(
            f"the centre line of the coronary is too short: it ends {axis.s[-1]:.3g} cm from the"
            f" ostium, and is cut {least:.3g} cm from it at the earliest. Give a longer centre"
            " line, or ask for a shorter vessel."
        )
    outside = np.flatnonzero((axis.s >= least) & (aortic_gap(aorta, axis.points) >= clearance))
    if len(outside) == 0:
        raise ValueError(
            f"the coronary stays within {clearance:.2g} cm of the aortic lumen, too near to be cut"
            " off by itself. Check the centre line and the aorta."
        )
    return float(axis.s[outside[0]])
