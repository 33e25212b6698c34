"""Axes of vessels: curves sampled evenly along their length, each sample with an orthonormal frame.

The frame (n, b, t) is right-handed, t = n × b, with t along the curve. Unless a direction is
prescribed, n turns as little as possible about t (rotation-minimising frame). Beyond its ends a
curve goes on straight.

Source: Wang, Jüttler, Zheng, Liu 2008, "Computation of rotation minimizing frames", ACM Trans.
Graph. 27:2, table 1 (double reflection).
"""

import dataclasses

import numpy as np
import scipy.interpolate
from jaxtyping import Float

_OVERSAMPLING = 8


@dataclasses.dataclass(frozen=True)
class Curve:
    """Samples of a curve at even arc length, with frames.

    Attributes:
        points: positions [cm].
        s: arc length of the samples [cm], evenly spaced.
        tangent: unit tangent t, towards growing s.
        normal: unit vector n across the curve.
        binormal: b = t × n.
    """

    points: Float[np.ndarray, "samples 3"]
    s: Float[np.ndarray, " samples"]
    tangent: Float[np.ndarray, "samples 3"]
    normal: Float[np.ndarray, "samples 3"]
    binormal: Float[np.ndarray, "samples 3"]

    @property
    def spacing(self) -> float:
        """Arc length between two samples [cm]."""
        return float(self.s[1] - self.s[0])


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _across(
    vectors: Float[np.ndarray, "samples 3"], tangent: Float[np.ndarray, "samples 3"]
) -> Float[np.ndarray, "samples 3"]:
    return _unit(vectors - np.sum(vectors * tangent, axis=-1, keepdims=True) * tangent)


def rotation_minimising_normals(
    points: Float[np.ndarray, "samples 3"],
    tangent: Float[np.ndarray, "samples 3"],
    first: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "samples 3"]:
    """Normals that do not turn about the curve, by double reflection (Wang 2008, table 1).

    Args:
        points: samples of the curve [cm].
        tangent: unit tangents there.
        first: direction of the first normal; its part along the tangent is dropped.

    Returns:
        Unit normals; fourth-order accurate in the spacing of the samples.
    """
    normals = np.empty_like(points)
    normals[0] = _across(first[None], tangent[:1])[0]
    steps = np.diff(points, axis=0)
    for i, step in enumerate(steps):
        reflection = 2.0 / (step @ step)
        reflected = normals[i] - reflection * (step @ normals[i]) * step
        turned = tangent[i] - reflection * (step @ tangent[i]) * step
        second = tangent[i + 1] - turned
        length = second @ second
        scale = 2.0 / length if length > 0.0 else 0.0
        normals[i + 1] = reflected - scale * (second @ reflected) * second
    return _across(normals, tangent)


def _any_normal(tangent: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    axis = np.zeros(3)
    axis[np.argmin(np.abs(tangent))] = 1.0
    return axis


def curve_through(
    points: Float[np.ndarray, "controls 3"],
    spacing: float,
    *,
    normals: Float[np.ndarray, "framed 3"] | None = None,
) -> Curve:
    """The cubic spline through points, sampled evenly.

    Args:
        points: points in order [cm]; the spline is parametrised by chord length.
        spacing: wanted arc length between samples [cm]; the one used divides the length evenly.
        normals: directions of the normal at the first ``framed`` points (at least one); from
            there on the frame minimises its rotation. Default: any direction at the first point.

    Raises:
        ValueError: fewer than two points, or two that coincide.
    """
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 2 or not np.all(chords > 0.0):
        raise ValueError(
            "a curve needs at least two points, no two neighbours alike. Remove repeated points."
        )
    chord = np.concatenate([[0.0], np.cumsum(chords)])
    degree = min(3, len(points) - 1)
    spline = scipy.interpolate.make_interp_spline(chord, points, k=degree)
    n_samples = max(int(np.ceil(chord[-1] / spacing)) + 1, 5)
    fine = np.linspace(0.0, chord[-1], _OVERSAMPLING * n_samples + 1)
    middle = (fine[1:] + fine[:-1]) / 2.0
    speed = np.linalg.norm(spline(fine, 1), axis=1)
    speed_middle = np.linalg.norm(spline(middle, 1), axis=1)
    pieces = np.diff(fine) * (speed[:-1] + 4.0 * speed_middle + speed[1:]) / 6.0
    length = np.concatenate([[0.0], np.cumsum(pieces)])
    s = np.linspace(0.0, length[-1], n_samples)
    parameter = scipy.interpolate.CubicSpline(length, fine)(s)
    samples, tangent = spline(parameter), _unit(spline(parameter, 1))
    if normals is None:
        normals = _any_normal(tangent[0])[None]
    return _framed(samples, s, tangent, normals, np.interp(chord[: len(normals)], fine, length))


def _framed(
    points: Float[np.ndarray, "samples 3"],
    s: Float[np.ndarray, " samples"],
    tangent: Float[np.ndarray, "samples 3"],
    normals: Float[np.ndarray, "framed 3"],
    s_normals: Float[np.ndarray, " framed"],
) -> Curve:
    n_given = max(int(np.searchsorted(s, s_normals[-1], side="right")), 1)
    given = np.stack([np.interp(s[:n_given], s_normals, normals[:, i]) for i in range(3)], axis=1)
    given = _across(given, tangent[:n_given])
    rest = rotation_minimising_normals(points[n_given - 1 :], tangent[n_given - 1 :], given[-1])
    normal = np.concatenate([given[:-1], rest])
    return Curve(points, s, tangent, normal, np.cross(tangent, normal))


def bezier_points(
    controls: Float[np.ndarray, "controls 3"], n_points: int
) -> Float[np.ndarray, "points 3"]:
    """Points of a Bézier curve at even parameter (de Casteljau's construction).

    Args:
        controls: control points [cm]; the curve starts at the first and ends at the last.
        n_points: number of points, both ends included.
    """
    parameter = np.linspace(0.0, 1.0, n_points)[:, None, None]
    level = np.broadcast_to(controls, (n_points, *controls.shape))
    while level.shape[1] > 1:
        level = (1.0 - parameter) * level[:, :-1] + parameter * level[:, 1:]
    return level[:, 0]


def extended(curve: Curve, before: float, after: float) -> Curve:
    """The curve with straight pieces at its ends; s = 0 stays where it was.

    Args:
        curve: any curve.
        before: length to add ahead of its start [cm]; rounded up to whole spacings.
        after: length to add behind its end [cm]; rounded up to whole spacings.
    """
    h = curve.spacing
    n_before, n_after = (int(np.ceil(x / h - 1e-9)) for x in (before, after))
    ahead = -h * np.arange(n_before, 0, -1)
    behind = h * np.arange(1, n_after + 1)
    points = np.concatenate(
        [
            curve.points[0] + ahead[:, None] * curve.tangent[0],
            curve.points,
            curve.points[-1] + behind[:, None] * curve.tangent[-1],
        ]
    )
    tangent, normal, binormal = (
        np.pad(x, ((n_before, n_after), (0, 0)), mode="edge")
        for x in (curve.tangent, curve.normal, curve.binormal)
    )
    s = np.concatenate([curve.s[0] + ahead, curve.s, curve.s[-1] + behind])
    return Curve(points, s, tangent, normal, binormal)


def at_arc_length(
    curve: Curve, s: Float[np.ndarray, " points"]
) -> tuple[
    Float[np.ndarray, "points 3"],
    Float[np.ndarray, "points 3"],
    Float[np.ndarray, "points 3"],
    Float[np.ndarray, "points 3"],
]:
    """Position, tangent, normal and binormal at arc lengths; straight beyond the ends.

    Between samples positions follow cubic Hermite pieces, so they are fourth-order accurate.
    """
    h = curve.spacing
    inside = np.clip(s, curve.s[0], curve.s[-1])
    x = (inside - curve.s[0]) / h
    i = np.minimum(x.astype(int), len(curve.s) - 2)
    f = (x - i)[:, None]
    p0, p1, t0, t1 = curve.points[i], curve.points[i + 1], curve.tangent[i], curve.tangent[i + 1]
    position = (
        (1.0 + 2.0 * f) * (1.0 - f) ** 2 * p0
        + f**2 * (3.0 - 2.0 * f) * p1
        + h * f * (1.0 - f) ** 2 * t0
        - h * f**2 * (1.0 - f) * t1
    )
    tangent = _unit((1.0 - f) * t0 + f * t1)
    normal = _across((1.0 - f) * curve.normal[i] + f * curve.normal[i + 1], tangent)
    position = position + (s - inside)[:, None] * tangent
    return position, tangent, normal, np.cross(tangent, normal)
