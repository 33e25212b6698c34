"""The synthetic anatomy: an aortic root with a normal and an anomalous coronary artery.

The lumens of aorta and arteries are tubes; they are united by a smooth minimum whose radius
follows the gap between the lumens, so that the edge of the ostium is rounded and the septum
between two lumens side by side stays whole and as thick as asked.
"""

import dataclasses
from functools import partial

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import OPENING_BALL, Anatomy, Centerline, Opening
from jaxfsi.anatomy.curves.curve import Curve, at_arc_length
from jaxfsi.anatomy.implicit import Tube, tube
from jaxfsi.anatomy.sources.aorta import aorta_radius, aorta_tube, end_margin
from jaxfsi.anatomy.sources.course import Course, anomalous_course, normal_course
from jaxfsi.anatomy.sources.parameters import SyntheticParameters, check_parameters
from jaxfsi.anatomy.vessels import VesselTube, local_half_width, lumen_function, septum_blend
from jaxfsi.anatomy.wall import requested_thickness, thickness_from_radius, wall_function

AORTA_INLET = "aorta_inlet"
AORTA_OUTLET = "aorta_outlet"
ANOMALOUS_OUTLET = "anomalous_outlet"
NORMAL_OUTLET = "normal_outlet"

_NORMAL_BLEND = 0.08


def _thickness(
    p: SyntheticParameters, radius: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    return thickness_from_radius(
        radius,
        factor=p.thickness_per_radius,
        minimum=p.thickness_minimum,
        maximum=p.thickness_maximum,
    )


def _aorta(p: SyntheticParameters) -> VesselTube:
    lumen = aorta_tube(p)
    radius = aorta_radius(p, lumen.axis.s)
    return VesselTube("aorta", lumen, radius, _thickness(p, radius), np.zeros_like(radius))


def _branch(
    p: SyntheticParameters, name: str, course: Course, blend: Float[np.ndarray, " samples"]
) -> VesselTube:
    radius = np.sqrt(course.half_major * course.half_minor)
    half_width = np.minimum(course.half_major, course.half_minor)
    return VesselTube(
        name, tube(course.axis, course.contours), half_width, _thickness(p, radius), blend
    )


def _opening(
    name: str, axis: Curve, s: float, radius: float, thickness: float, margin: float
) -> Opening:
    """A cut across a vessel that runs on for a margin; outwards is away from the axis' middle."""
    centre, tangent, _, _ = (x[0] for x in at_arc_length(axis, np.array([s])))
    outwards = 1.0 if s > (axis.s[0] + axis.s[-1]) / 2.0 else -1.0
    ball = OPENING_BALL * float(np.hypot(radius + thickness, margin + thickness))
    return Opening(name, centre, outwards * tangent, ball)


def _openings(
    p: SyntheticParameters, aorta: VesselTube, anomalous: Course, normal: Course
) -> tuple[Opening, ...]:
    axis = aorta.tube.axis
    ends = ((AORTA_INLET, -p.inflow_length), (AORTA_OUTLET, p.aorta_length))
    openings = [
        _opening(
            name,
            axis,
            s,
            float(np.interp(s, axis.s, aorta.half_width)),
            float(np.interp(s, axis.s, aorta.thickness)),
            end_margin(p),
        )
        for name, s in ends
    ]
    for name, course in ((ANOMALOUS_OUTLET, anomalous), (NORMAL_OUTLET, normal)):
        radius = float(course.half_major[-1])
        thickness = float(_thickness(p, np.array([radius]))[0])
        margin = float(course.axis.s[-1]) - course.s_outlet
        openings.append(_opening(name, course.axis, course.s_outlet, radius, thickness, margin))
    return tuple(openings)


def _centerline(axis: Curve, first: float, last: float) -> Centerline:
    s = np.linspace(first, last, max(int(np.ceil((last - first) / axis.spacing)) + 1, 2))
    return Centerline(at_arc_length(axis, s)[0], s - first)


def _surface(lumen: Tube) -> Float[np.ndarray, "points 3"]:
    return np.asarray(lumen.tree.data)


def _bounds(vessels: tuple[VesselTube, ...]) -> Float[np.ndarray, "2 3"]:
    points = np.concatenate([_surface(vessel.tube) for vessel in vessels])
    margin = 1.5 * max(float(np.max(vessel.thickness)) for vessel in vessels)
    return np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])


def _check_apart(anomalous: VesselTube, normal: VesselTube) -> None:
    apart = float(anomalous.tube.tree.query(_surface(normal.tube))[0].min())
    needed = float(anomalous.thickness.max() + normal.thickness.max())
    if apart < needed:
        raise ValueError(
            "these parameters describe no anatomy:\n"
            f"  normal_angle: the two arteries come within {apart:.3g} cm of each other, allowed"
            f" from {needed:.3g} cm on: raise normal_angle or lower normal_height, or move"
            " ostium_angle"
        )


def synthetic_vessels(p: SyntheticParameters) -> tuple[tuple[VesselTube, ...], Course, Course]:
    """Aorta, anomalous and normal artery as vessels, and the courses of the two arteries.

    Raises:
        ValueError: the parameters describe no anatomy; all faults are listed.
    """
    check_parameters(p)
    aorta = _aorta(p)
    course = anomalous_course(p, aorta.tube)
    other = normal_course(p, aorta.tube)
    anomalous = _branch(p, "anomalous", course, septum_blend(course.gap, course.axis.s, p.septum))
    normal = _branch(p, "normal", other, np.full(len(other.axis.s), _NORMAL_BLEND))
    _check_apart(anomalous, normal)
    return (aorta, anomalous, normal), course, other


def synthetic_anatomy(p: SyntheticParameters) -> Anatomy:
    """The anatomy that parameters describe.

    Openings: ``aorta_inlet``, ``aorta_outlet``, ``anomalous_outlet``, ``normal_outlet``;
    centerlines ``aorta`` (from its inlet), ``anomalous`` and ``normal`` (from their ostia).

    Args:
        p: parameters.

    Raises:
        ValueError: the parameters describe no anatomy; all faults are listed.
    """
    vessels, course, other = synthetic_vessels(p)
    return Anatomy(
        name=f"synthetic {p.side}",
        lumen=lumen_function(vessels),
        wall=wall_function(vessels),
        local_radius=partial(local_half_width, vessels),
        thickness=partial(requested_thickness, vessels),
        openings=_openings(p, vessels[0], course, other),
        bounds=_bounds(vessels),
        centerlines={
            "aorta": _centerline(vessels[0].tube.axis, -p.inflow_length, p.aorta_length),
            "anomalous": _centerline(course.axis, 0.0, course.s_outlet),
            "normal": _centerline(other.axis, 0.0, other.s_outlet),
        },
        meta={"source": "synthetic", "parameters": dataclasses.asdict(p)},
        vessels=vessels,
    )
