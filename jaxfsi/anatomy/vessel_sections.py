"""Sections of the tubes of an anatomy: contours, areas, and where the aorta lies."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import Anatomy
from jaxfsi.anatomy.curves.curve import Curve, at_arc_length
from jaxfsi.anatomy.implicit import Tube, surface_points, tube_foot
from jaxfsi.anatomy.vessels import VesselTube

_SPACING = 0.05  # of sections along an artery [cm]


class ArterySections(NamedTuple):
    """Sections of an artery from where they have left the aortic lumen to its outlet.

    Attributes:
        s: distance from the ostium [cm].
        contours: points of each section in its own plane [cm].
    """

    s: Float[np.ndarray, " sections"]
    contours: Float[np.ndarray, "sections points 2"]


def vessel_sections(anatomy: Anatomy, name: str = "anomalous") -> ArterySections:
    """Even sections of an artery from where they have left the aortic lumen to its outlet.

    A section that is open to the aorta has no outline of its own.

    Args:
        anatomy: from contours or parameters.
        name: of the artery.

    Raises:
        ValueError: the anatomy has no sections of such an artery.
    """
    vessel = next((v for v in anatomy.vessels[1:] if v.name == name), None)
    if vessel is None:
        raise ValueError(
            f"the anatomy {anatomy.name} has no sections of the artery {name}. Take one from"
            " contours or parameters, not from a surface or a mesh."
        )
    last = float(anatomy.centerlines[name].s[-1])
    outside = aorta_distance(anatomy.vessels[0], vessel.tube) >= 0.0
    begun = (vessel.tube.axis.s >= 0.0) & np.logical_and.accumulate(outside[::-1])[::-1]
    first = float(vessel.tube.axis.s[np.argmax(begun)])
    s = np.linspace(first, last, max(int(np.ceil((last - first) / _SPACING)), 2) + 1)
    return ArterySections(s, contours_at(vessel.tube, s))


def outlet_place(anatomy: Anatomy, name: str = "anomalous") -> float:
    """Arc length of the outlet of an artery from its ostium [cm]."""
    return float(anatomy.centerlines[name].s[-1])


def contours_at(
    tube: Tube, s: Float[np.ndarray, " sections"]
) -> Float[np.ndarray, "sections angles 2"]:
    """Contours of a tube in the frame of its axis [cm]; beyond its ends the last one goes on.

    Args:
        tube: any tube.
        s: arc lengths along its axis [cm].
    """
    axis, n = tube.axis, tube.n_angles
    inside = np.clip(s, axis.s[0], axis.s[-1])
    angle = 2.0 * np.pi * np.arange(n) / n
    points, _ = surface_points(tube, np.repeat(inside, n), np.tile(angle, len(inside)))
    centre, _, normal, binormal = at_arc_length(axis, inside)
    offset = points.reshape(len(inside), n, 3) - centre[:, None]
    u, v = (np.einsum("sak,sk->sa", offset, across) for across in (normal, binormal))
    return np.stack([u, v], axis=2)


def tube_areas(tube: Tube, s: Float[np.ndarray, " sections"]) -> Float[np.ndarray, " sections"]:
    """Areas of the sections of a tube [cm²]."""
    p = contours_at(tube, s)
    q = np.roll(p, -1, axis=1)
    return np.abs(np.sum(p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1], axis=1)) / 2.0


def away_from_aorta(aorta: VesselTube, axis: Curve) -> Float[np.ndarray, "samples 2"]:
    """Unit vectors across an axis that point away from the axis of the aorta, in its frame."""
    line = aorta.tube.axis
    gaps = np.linalg.norm(axis.points[:, None] - line.points[None], axis=2)
    outward = axis.points - line.points[np.argmin(gaps, axis=1)]
    flat = np.stack([np.sum(outward * axis.normal, 1), np.sum(outward * axis.binormal, 1)], axis=1)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)


def aorta_distance(aorta: VesselTube, artery: Tube) -> Float[np.ndarray, " samples"]:
    """Least distance of each section of an artery from the aortic lumen [cm], negative inside."""
    axis, contours = artery.axis, contours_at(artery, artery.axis.s)
    offsets = contours[..., :1] * axis.normal[:, None] + contours[..., 1:] * axis.binormal[:, None]
    points = (axis.points[:, None] + offsets).reshape(-1, 3)
    return np.min(tube_foot(aorta.tube, points).distance.reshape(contours.shape[:2]), axis=1)
