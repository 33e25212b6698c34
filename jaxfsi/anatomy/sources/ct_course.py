"""Where an anomalous coronary runs: beside the aorta first, then away from it.

The aorta is that of its own centre line (`measured_aorta`), with the radius R of the largest
spheres in its lumen; both are smoothed. Where there is none (`fit_aorta`), the centre line of the
coronary tells where the aorta lies, for its proximal part hugs it: the aorta is then the straight
tube of given radius on which that part lies best::

    min over axis   mean over 0 ≤ σ ≤ ℓ of (ϱ(σ) − R − offset)² + (w tilt)²

with ϱ the distance from the axis and the weak second term keeping the axis near the cranial
direction (+z of CT coordinates). In the coordinates (ϱ, φ, z) of the axis (`aortic_axis`) the
course of the vessel, φ(τ) and z(τ), comes from CT; the distance ϱ does not: it follows from the
tissue measured between the two lumens, which CT cannot resolve. Beyond the last measurement the
vessel leaves the aorta with a slope that grows to its final value, ϱ' → g x/(x + ℓ) like; upstream
of the ostium it enters the aortic lumen at the take-off angle.
"""

import dataclasses
from typing import Literal, NamedTuple

import numpy as np
import scipy.interpolate
import scipy.ndimage
import scipy.optimize
from jaxtyping import Float

from jaxfsi.anatomy.curves.curve import Curve, at_arc_length, curve_through
from jaxfsi.anatomy.sources.aortic_axis import (
    AorticAxis,
    level,
    straight_axis,
    wall_coordinates,
    wall_points,
)
from jaxfsi.anatomy.sources.centerline_files import SizedLine

OstiumEnd = Literal["auto", "first", "last"]

_SPACING = 0.05  # of the resampled centre line [cm]
_SMOOTHING = 0.15  # standard deviation of its Gaussian mean [cm]
_STEP = 0.02  # of the path along the wall [cm]
_PATH_SMOOTHING = 0.05
_STRAIGHT = 0.3
_TAKE_OFF_BEND = 0.2
_DEPARTURE_BEND = 0.3
_ARC_LENGTH_STEPS = 4
_TILT_WEIGHT = 0.5
_STARTS = 12
_MISFIT = 0.1
_MEASURED_MISFIT = 0.25  # the largest sphere leaves room between itself and an oval lumen
_BESIDE = 1.5  # length of a centre line that runs beside the aorta [cm]
_AORTA_SPACING = 0.1  # of the samples of the aorta's own centre line [cm]
_AORTA_SMOOTHING = 0.3  # standard deviation of their Gaussian mean [cm]
_AORTA_REACH = 12.0  # of that line to either side of the ostium [cm]


class AortaFit(NamedTuple):
    """The aorta that a centre line runs beside.

    Attributes:
        course: centre line from the ostium downstream in aortic coordinates [cm]: the aortic axis
            passes the origin along z (cranial), level with the ostium, which lies at y = 0, x > 0.
        aorta: axis and radius of the aorta in these coordinates.
        residual: root mean square of ϱ − R − offset over the part beside the aorta [cm].
        from_first: whether the ostium is the first point of the file.
        rotation: rows are the aortic axes in CT coordinates.
        origin: the aortic origin in CT coordinates [cm].
    """

    course: Float[np.ndarray, "points 3"]
    aorta: AorticAxis
    residual: float
    from_first: bool
    rotation: Float[np.ndarray, "3 3"]
    origin: Float[np.ndarray, " 3"]


def resampled(
    values: Float[np.ndarray, "points dims"], spacing: float
) -> Float[np.ndarray, "samples dims"]:
    """A line at even steps.

    Args:
        values: its points and, in further columns, what belongs to them.
        spacing: arc length of a step, in the unit of the points.
    """
    steps = np.linalg.norm(np.diff(values[:, :3], axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    s = np.arange(0.0, length[-1], spacing)
    return np.stack([np.interp(s, length, column) for column in values.T], axis=1)


def smoothed(
    values: Float[np.ndarray, "samples dims"], width: float
) -> Float[np.ndarray, "samples dims"]:
    """Gaussian mean over ``width`` samples; odd reflection keeps the ends where they are."""
    n_pad = min(len(values) - 1, int(4.0 * width) + 1)
    padded = np.pad(values, ((n_pad, n_pad), (0, 0)), mode="reflect", reflect_type="odd")
    return scipy.ndimage.gaussian_filter1d(padded, width, axis=0)[n_pad:-n_pad]


def _axis_from(x: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " 3"]:
    axis = np.array([x[2], x[3], 1.0])
    return axis / np.linalg.norm(axis)


def _fit_from(
    course: Float[np.ndarray, "samples 3"], distance: float, length: float
) -> tuple[Float[np.ndarray, " 4"], float]:
    """Axis through (x₀, x₁, mean z) + mean with direction (x₂, x₃, 1), and the residual [cm]."""
    part = course[: max(int(length / _SPACING), 5)]
    centre = part.mean(axis=0)

    def residuals(x: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " residuals"]:
        axis = _axis_from(x)
        offset = part - centre - np.array([x[0], x[1], 0.0])
        across = offset - (offset @ axis)[:, None] * axis
        gap = (np.linalg.norm(across, axis=1) - distance) / np.sqrt(len(part))
        return np.concatenate([gap, 0.1 * _TILT_WEIGHT * distance * x[2:]])

    fits = []
    for angle in 2.0 * np.pi * np.arange(_STARTS) / _STARTS:
        start = np.array([distance * np.cos(angle), distance * np.sin(angle), 0.0, 0.0])
        fits.append(scipy.optimize.least_squares(residuals, start))
    best = min(fits, key=lambda fit: fit.cost)
    return best.x, float(np.linalg.norm(residuals(best.x)[:-2]))


def fit_aorta(
    centerline: Float[np.ndarray, "points 3"],
    radius: float,
    *,
    offset: float,
    length: float = _BESIDE,
    ostium_end: OstiumEnd = "auto",
) -> AortaFit:
    """Place a straight aorta so that the proximal centre line lies on its wall.

    Args:
        centerline: points [cm] in CT coordinates, +z cranial.
        radius: of the aortic lumen [cm].
        offset: from the aortic lumen to the centre line [cm].
        length: of the proximal part that runs beside the aorta [cm].
        ostium_end: which end of the file is the ostium; ``auto`` takes the cranial one, because
            coronaries descend from the aortic root to the apex.

    Raises:
        ValueError: the proximal part lies farther than a tenth of the radius from the tube.
    """
    course, from_first = _from_ostium(centerline, ostium_end)
    x, residual = _fit_from(course, radius + offset, length)
    if residual > _MISFIT * radius:
        raise ValueError(
            f"the proximal centre line does not run beside an aorta of radius {radius:g} cm (it"
            f" misses it by {residual:.2g} cm). Check the aortic radius and the centre line, or"
            " say which end is the ostium."
        )
    axis = _axis_from(x)
    centre = course[: max(int(length / _SPACING), 5)].mean(axis=0) + np.array([x[0], x[1], 0.0])
    origin = centre + ((course[0] - centre) @ axis) * axis
    first = course[0] - origin
    first = first / np.linalg.norm(first)
    rotation = np.stack([first, np.cross(axis, first), axis])
    placed = (course - origin) @ rotation.T
    return AortaFit(placed, straight_axis(radius), residual, from_first, rotation, origin)


def _from_ostium(
    centerline: Float[np.ndarray, "points 3"], ostium_end: OstiumEnd
) -> tuple[Float[np.ndarray, "samples 3"], bool]:
    """The centre line from its ostium, even and smooth, and whether that is its first point."""
    from_first = ostium_end == "first"
    if ostium_end == "auto":
        from_first = bool(centerline[0, 2] >= centerline[-1, 2])
    course = resampled(centerline if from_first else centerline[::-1], _SPACING)
    return smoothed(course, _SMOOTHING / _SPACING), from_first


def measured_aorta(
    centerline: Float[np.ndarray, "points 3"],
    line: SizedLine,
    *,
    offset: float,
    ostium_end: OstiumEnd = "auto",
) -> AortaFit:
    """Place a centre line beside the aorta that has one of its own.

    Args:
        centerline: of the coronary [cm] in CT coordinates, +z cranial.
        line: centre line and radius of the aorta in the same coordinates; it ascends at the ostium.
        offset: from the aortic lumen to the centre line of the coronary [cm].
        ostium_end: see `fit_aorta`.

    Raises:
        ValueError: the aorta does not pass the ostium, or the coronary does not run beside it.
    """
    course, from_first = _from_ostium(centerline, ostium_end)
    aorta, rotation, origin = _placed_axis(line, course[0])
    placed = (course - origin) @ rotation.T
    rho, _, z = wall_coordinates(aorta, placed[: int(_BESIDE / _SPACING)]).T
    misses = rho - aorta.radius_at(z) - offset
    residual = float(np.sqrt(np.mean(misses**2)))
    radius = float(aorta.radius_at(np.zeros(1))[0])
    if residual > _MEASURED_MISFIT * radius:
        raise ValueError(
            f"the proximal centre line of the coronary does not run beside this aorta (it misses"
            f" it by {residual:.2g} cm). Check that both lines are in mm, of one patient and in one"
            " system of coordinates, or say which end of the coronary is the ostium."
        )
    return AortaFit(placed, aorta, residual, from_first, rotation, origin)


def radius_at_ostium(
    centerline: Float[np.ndarray, "points 3"], line: SizedLine, *, ostium_end: OstiumEnd = "auto"
) -> float:
    """Radius of the aortic lumen level with the ostium of a coronary [cm].

    Args:
        centerline: of the coronary [cm].
        line: of the aorta in the same coordinates.
        ostium_end: see `fit_aorta`.

    Raises:
        ValueError: the line of the aorta does not pass the ostium.
    """
    course, _ = _from_ostium(centerline, ostium_end)
    aorta, _, _ = _placed_axis(line, course[0])
    return float(aorta.radius_at(np.zeros(1))[0])


def _placed_axis(
    line: SizedLine, ostium: Float[np.ndarray, " 3"]
) -> tuple[AorticAxis, Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """The aorta in aortic coordinates, their axes and their origin in CT coordinates."""
    samples = resampled(np.column_stack([line.points, line.radius]), _AORTA_SPACING)
    samples = smoothed(samples, _AORTA_SMOOTHING / _AORTA_SPACING)
    nearest = int(np.argmin(np.linalg.norm(samples[:, :3] - ostium, axis=1)))
    reach = int(_AORTA_REACH / _AORTA_SPACING)
    samples = samples[max(nearest - reach, 0) : nearest + reach + 1]
    axis = curve_through(samples[:, :3], _AORTA_SPACING)
    radius = np.interp(axis.s, np.linspace(0.0, axis.s[-1], len(samples)), samples[:, 3])
    place = float(level(axis, ostium[None])[0])
    if not axis.s[0] < place < axis.s[-1]:
        raise ValueError(
            "the centre line of the aorta ends before it is level with the ostium of the coronary."
            " Give a line that runs from the valve past the ostium, in the coordinates of the"
            " coronary's."
        )
    origin, tangent, _, _ = (x[0] for x in at_arc_length(axis, np.array([place])))
    first = (ostium - origin) / np.linalg.norm(ostium - origin)
    up = 1.0 if tangent[2] >= 0.0 else -1.0
    rotation = np.stack([first, up * np.cross(tangent, first), up * tangent])
    order = slice(None) if up > 0.0 else slice(None, None, -1)
    points = ((axis.points - origin) @ rotation.T)[order]
    zero = place if up > 0.0 else float(axis.s[-1]) - place
    known = (-zero, float(axis.s[-1]) - zero)
    return AorticAxis(_towards_ostium(points, zero), radius[order], known), rotation, origin


def _towards_ostium(points: Float[np.ndarray, "samples 3"], zero: float) -> Curve:
    """Curve with s = 0 at the origin, where its normal is +x."""
    curve = curve_through(points, _AORTA_SPACING)
    curve = dataclasses.replace(curve, s=curve.s - zero)
    _, _, normal, binormal = (x[0] for x in at_arc_length(curve, np.zeros(1)))
    turn = np.arctan2(binormal[0], normal[0])
    return dataclasses.replace(
        curve,
        normal=np.cos(turn) * curve.normal + np.sin(turn) * curve.binormal,
        binormal=np.cos(turn) * curve.binormal - np.sin(turn) * curve.normal,
    )


def _wall_course(
    aorta: AorticAxis, course: Float[np.ndarray, "points 3"], before: float, after: float
) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]]:
    """φ [rad] and z [cm] at even steps of `_STEP` along the wall, from −before to after.

    Upstream of the ostium the course goes on in its mean direction over the first `_STRAIGHT`.
    """
    rho, phi, z = wall_coordinates(aorta, course).T
    phi = np.unwrap(phi)
    steps = np.hypot(rho[0] * np.diff(phi), np.diff(z))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    n_before = int(np.ceil(before / _STEP))
    n_after = min(int(np.ceil(after / _STEP)), int(length[-1] / _STEP))
    tau = _STEP * np.arange(-n_before, n_after + 1)
    values = []
    for along in (phi, z):
        slope = (np.interp(_STRAIGHT, length, along) - along[0]) / _STRAIGHT
        values.append(np.interp(tau, length, along) + slope * np.minimum(tau, 0.0))
    return values[0], values[1]


def _bend(x: Float[np.ndarray, " n"], length: float) -> Float[np.ndarray, " n"]:
    """x²/(x + ℓ) for x ≥ 0: starts flat, ends with slope one."""
    x = np.maximum(x, 0.0)
    return x**2 / (x + length)


class Departure(NamedTuple):
    """How the vessel meets and leaves the aortic wall.

    Attributes:
        take_off_slope: tangent of the angle at which it enters the aortic lumen.
        slope: at which it leaves the wall beyond the last measurement.
        s: where it begins to leave [cm].
    """

    take_off_slope: float
    slope: float
    s: float


def wall_path(
    aorta: AorticAxis,
    course: Float[np.ndarray, "points 3"],
    s_knots: Float[np.ndarray, " knots"],
    distance: Float[np.ndarray, " knots"],
    departure: Departure,
    *,
    before: float,
    after: float,
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, " samples"]]:
    """Points of a path at given distances from the aortic lumen.

    Args:
        aorta: axis and radius of the aorta.
        course: CT course in aortic coordinates, see `AortaFit`.
        s_knots: arc length from the ostium [cm], growing from zero.
        distance: ϱ − R wanted there [cm].
        departure: slopes at both ends.
        before: length upstream of the ostium [cm].
        after: length downstream of it [cm].

    Returns:
        Positions [cm] and arc length [cm], zero at the ostium. Smoothing moves ϱ a little; the
        caller corrects ``distance`` until the sections lie where they were measured.
    """
    phi, z = _wall_course(aorta, course, before, after)
    radius = aorta.radius_at(z)
    law = scipy.interpolate.PchipInterpolator(s_knots, distance)
    n_before = int(np.ceil(before / _STEP))
    s = _STEP * (np.arange(len(phi)) - n_before)
    points = np.empty((len(phi), 3))
    for _ in range(_ARC_LENGTH_STEPS):
        rho = radius + law(np.clip(s, s_knots[0], s_knots[-1]))
        rho = rho - departure.take_off_slope * _bend(-s, _TAKE_OFF_BEND)
        rho = rho + departure.slope * _bend(s - departure.s, _DEPARTURE_BEND)
        points = wall_points(aorta, rho, phi, z)
        points = smoothed(points, _PATH_SMOOTHING / _STEP)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        s = length - length[n_before]
    return points, s
