"""The normal coronary of a patient: its stem, from the centre line and the radii of a CT.

The stem is a round tube on the smoothed centre line. It begins where that line leaves the aortic
lumen; upstream it goes on straight into the aorta. Near the ostium the largest spheres in the lumen
reach into the aorta and tell nothing of the coronary: the radius of the first that does not,
gap(c) ≥ r, holds from there back. The stem is cut after a given length: what branches off beyond is
the business of the bed behind the outlet.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.spatial
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import OPENING_BALL, OVERRUN, Opening
from jaxfsi.anatomy.curves.curve import Curve, at_arc_length, curve_through, extended
from jaxfsi.anatomy.implicit import elliptic_contours, tube
from jaxfsi.anatomy.sources.aortic_axis import AorticAxis, aortic_gap
from jaxfsi.anatomy.sources.centerline_files import SizedLine
from jaxfsi.anatomy.sources.ct_course import AortaFit, resampled, smoothed
from jaxfsi.anatomy.sources.septum_course import between, first_clear, placed_sections
from jaxfsi.anatomy.vessels import VesselTube

NAME = "normal"

_SPACING = 0.025  # of the samples along the stem [cm]
_CT_SPACING = 0.05  # of the resampled centre line [cm]
_SMOOTHING = 0.15  # standard deviation of its Gaussian mean [cm]
_LEAST = 0.3  # length of line that must lie outside the aorta [cm]
_NEAR = 0.5  # farthest start of the line from the aortic lumen [cm]
_BEFORE = 1.5  # longest way from the aortic wall into the lumen [cm]
_INSIDE = 0.05  # depth of the start of the stem in the aortic lumen [cm]
_N_ANGLES = 48
_WIDEST = 0.4  # radius of a coronary [cm]


class NormalBranch(NamedTuple):
    """The stem and where it is cut.

    Attributes:
        vessel: the stem with its wall; s = 0 where its axis leaves the aortic lumen.
        s_outlet: arc length of the cut [cm].
        outlet: the cut.
    """

    vessel: VesselTube
    s_outlet: float
    outlet: Opening


def normal_branch(
    fit: AortaFit,
    line: SizedLine,
    *,
    length: float,
    fillet: float,
    thickness: Callable[[Float[np.ndarray, " samples"]], Float[np.ndarray, " samples"]],
) -> NormalBranch:
    """The stem of the normal coronary in aortic coordinates.

    Args:
        fit: the aorta and its coordinates.
        line: of the coronary in CT coordinates, from the aorta or from its ostium, or the other
            way round.
        length: of the stem from the aortic lumen to the cut [cm]; more where the cut would touch
            the aorta, less where the line ends.
        fillet: blend radius of the edge of its ostium [cm].
        thickness: of the wall [cm] of a vessel of given radius [cm].

    Raises:
        ValueError: the line does not leave the aorta, or is too short, or its radii are not those
            of a coronary.
    """
    axis, radius = _outside(fit.aorta, _placed(fit, line))
    t_aorta = float(thickness(fit.aorta.radius_at(np.zeros(1)))[0])
    wall = thickness(radius)
    ball = OPENING_BALL * (radius + wall)
    clearance = t_aorta + float(np.max(ball))
    s_outlet = first_clear(fit.aorta, axis, min(length, float(axis.s[-1])), clearance)
    kept = axis.s <= s_outlet + 1e-9
    whole = extended(between(axis, 0.0, s_outlet), _BEFORE, OVERRUN)
    radii = np.interp(whole.s, axis.s[kept], radius[kept])
    whole = between(whole, _start(fit.aorta, whole, float(radii[0])), np.inf)
    radii = np.interp(whole.s, axis.s[kept], radius[kept])
    contours = elliptic_contours(radii, radii, _N_ANGLES)
    end, tangent, _, _ = (x[0] for x in at_arc_length(whole, np.array([s_outlet])))
    vessel = VesselTube(
        NAME, tube(whole, contours), radii, thickness(radii), np.full(len(radii), fillet)
    )
    size = float(np.interp(s_outlet, axis.s, ball))
    return NormalBranch(vessel, s_outlet, Opening("normal_outlet", end, tangent, size))


def _placed(fit: AortaFit, line: SizedLine) -> Float[np.ndarray, "samples 4"]:
    """Points and radii of a line in aortic coordinates, even, smooth, from the aorta on [cm]."""
    points = (line.points - fit.origin) @ fit.rotation.T
    gap = aortic_gap(fit.aorta, points[[0, -1]])
    values = np.column_stack([points, line.radius])
    values = resampled(values if gap[0] <= gap[1] else values[::-1], _CT_SPACING)
    return smoothed(values, _SMOOTHING / _CT_SPACING)


def _outside(
    aorta: AorticAxis, samples: Float[np.ndarray, "samples 4"]
) -> tuple[Curve, Float[np.ndarray, " samples"]]:
    """Axis of the part outside the aortic lumen, s = 0 at its surface, and its radius [cm]."""
    gap = aortic_gap(aorta, samples[:, :3])
    first = int(np.flatnonzero(gap < 0.0)[-1]) + 1 if np.any(gap < 0.0) else 0
    if first == 0 and gap[0] > _NEAR:
        raise ValueError(
            f"the centre line begins {gap[0]:.2g} cm outside the aortic lumen. Give the line from"
            " the aorta on, in mm and in the coordinates of the aorta's."
        )
    part = samples[first:]
    reach = aortic_gap(aorta, part[:, :3]) >= part[:, 3]
    if (len(part) - 1) * _CT_SPACING < _LEAST or not np.any(reach):
        raise ValueError(
            "the centre line does not leave the aorta. Give the line of the coronary up to its"
            " first bifurcation or beyond."
        )
    radius = np.maximum.accumulate(reach)
    radius = np.where(radius, part[:, 3], part[int(np.argmax(reach)), 3])
    if np.max(radius) > _WIDEST:
        raise ValueError(
            f"the coronary has a radius of {np.max(radius):.2g} cm, expected up to {_WIDEST:g} cm."
            " Check that radii are in mm, and that the line is that of the coronary."
        )
    axis = curve_through(part[:, :3], _SPACING)
    return axis, np.interp(axis.s, np.linspace(0.0, axis.s[-1], len(part)), radius)


def _start(aorta: AorticAxis, axis: Curve, radius: float) -> float:
    """Where the section of the stem lies wholly inside the aortic lumen [cm]."""
    s = axis.s[axis.s <= 0.0]
    half = np.full(len(s), radius)
    placed = placed_sections(axis, s, elliptic_contours(half, half, _N_ANGLES))
    inside = np.flatnonzero(np.max(aortic_gap(aorta, placed), axis=1) < -_INSIDE)
    if len(inside) == 0:
        raise ValueError(
            f"the stem does not enter the aortic lumen within {_BEFORE:g} cm of the aortic wall."
            " Check that its centre line begins at the aorta."
        )
    return float(s[inside[-1]])


def check_apart(anomalous: VesselTube, normal: VesselTube) -> None:
    """Refuse arteries whose walls touch outside the aorta.

    Args:
        anomalous: the anomalous artery.
        normal: the normal one.

    Raises:
        ValueError: says how near they come.
    """
    one, other = (
        np.asarray(v.tube.tree.data)[np.repeat(v.tube.axis.s >= 0.0, v.tube.n_angles)]
        for v in (anomalous, normal)
    )
    apart = float(scipy.spatial.KDTree(one).query(other)[0].min())
    needed = float(anomalous.thickness.max() + normal.thickness.max())
    if apart < needed:
        raise ValueError(
            f"the two arteries come within {apart:.3g} cm of each other, allowed from"
            f" {needed:.3g} cm on. Check that this is the centre line of the other artery, and the"
            " take-off angle."
        )
