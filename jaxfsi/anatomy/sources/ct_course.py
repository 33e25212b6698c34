"""Where an anomalous coronary runs: beside the aorta first, then away from it.

A centre line from CT does not show the aorta, but its proximal part hugs it. The aorta is therefore
taken as the straight tube of given radius on which that part lies best::

    min over axis   mean over 0 ≤ σ ≤ ℓ of (ϱ(σ) − R − offset)² + (w tilt)²

with ϱ the distance from the axis and the weak second term keeping the axis near the cranial
direction (+z of CT coordinates). In the cylinder coordinates (ϱ, φ, z) of that axis the course of
the vessel, φ(τ) and z(τ), comes from CT; the distance ϱ does not: it follows from the tissue
measured between the two lumens, which CT cannot resolve. Beyond the last measurement the vessel
leaves the aorta with a slope that grows to its final value, ϱ' → g x/(x + ℓ) like; upstream of the
ostium it enters the aortic lumen at the take-off angle.
"""

from typing import Literal, NamedTuple

import numpy as np
import scipy.interpolate
import scipy.ndimage
import scipy.optimize
from jaxtyping import Float

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


class AortaFit(NamedTuple):
    """The straight aorta that a centre line hugs.

    Attributes:
        course: centre line from the ostium downstream in aortic coordinates [cm]: the aortic axis
            is z (cranial), z = 0 at the ostium, which lies at y = 0, x > 0.
        residual: root mean square of ϱ − R − offset over the fitted length [cm].
        from_first: whether the ostium is the first point of the file.
        rotation: rows are the aortic axes in CT coordinates.
        origin: the aortic origin in CT coordinates [cm].
    """

    course: Float[np.ndarray, "points 3"]
    residual: float
    from_first: bool
    rotation: Float[np.ndarray, "3 3"]
    origin: Float[np.ndarray, " 3"]


def _resampled(
    points: Float[np.ndarray, "points 3"], spacing: float
) -> Float[np.ndarray, "samples 3"]:
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.arange(0.0, length[-1], spacing)
    return np.stack([np.interp(s, length, points[:, i]) for i in range(3)], axis=1)


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
    length: float = 1.5,
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
    from_first = ostium_end == "first"
    if ostium_end == "auto":
        from_first = bool(centerline[0, 2] >= centerline[-1, 2])
    course = _resampled(centerline if from_first else centerline[::-1], _SPACING)
    course = smoothed(course, _SMOOTHING / _SPACING)
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
    return AortaFit((course - origin) @ rotation.T, residual, from_first, rotation, origin)


def _wall_course(
    course: Float[np.ndarray, "points 3"], before: float, after: float
) -> tuple[Float[np.ndarray, " samples"], Float[np.ndarray, " samples"]]:
    """φ [rad] and z [cm] at even steps of `_STEP` along the wall, from −before to after.

    Upstream of the ostium the course goes on in its mean direction over the first `_STRAIGHT`.
    """
    phi = np.unwrap(np.arctan2(course[:, 1], course[:, 0]))
    reference = float(np.hypot(course[0, 0], course[0, 1]))
    steps = np.hypot(reference * np.diff(phi), np.diff(course[:, 2]))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    n_before = int(np.ceil(before / _STEP))
    n_after = min(int(np.ceil(after / _STEP)), int(length[-1] / _STEP))
    tau = _STEP * np.arange(-n_before, n_after + 1)
    values = []
    for along in (phi, course[:, 2]):
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
    course: Float[np.ndarray, "points 3"],
    s_knots: Float[np.ndarray, " knots"],
    distance: Float[np.ndarray, " knots"],
    departure: Departure,
    *,
    before: float,
    after: float,
) -> tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, " samples"]]:
    """Points of a path at given distances from the aortic axis.

    Args:
        course: CT course in aortic coordinates, see `AortaFit`.
        s_knots: arc length from the ostium [cm], growing from zero.
        distance: ϱ wanted there [cm].
        departure: slopes at both ends.
        before: length upstream of the ostium [cm].
        after: length downstream of it [cm].

    Returns:
        Positions [cm] and arc length [cm], zero at the ostium. Smoothing moves ϱ a little; the
        caller corrects ``distance`` until the sections lie where they were measured.
    """
    phi, z = _wall_course(course, before, after)
    law = scipy.interpolate.PchipInterpolator(s_knots, distance)
    n_before = int(np.ceil(before / _STEP))
    s = _STEP * (np.arange(len(phi)) - n_before)
    points = np.empty((len(phi), 3))
    for _ in range(_ARC_LENGTH_STEPS):
        rho = law(np.clip(s, s_knots[0], s_knots[-1]))
        rho = rho - departure.take_off_slope * _bend(-s, _TAKE_OFF_BEND)
        rho = rho + departure.slope * _bend(s - departure.s, _DEPARTURE_BEND)
        points = np.stack([rho * np.cos(phi), rho * np.sin(phi), z], axis=1)
        points = smoothed(points, _PATH_SMOOTHING / _STEP)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        s = length - length[n_before]
    return points, s
