"""The ascending aorta of the synthetic anatomy: outflow tract, sinuses, junction and tube.

Radius about the bending axis, height h from the annulus, angle θ from the border between the left
and the right sinus, where the pulmonary artery lies::

    R(h, θ) = R(h) [1 − A w(h) cos 3θ],    w(h) = exp(−((h − h_sinus)/(0.6 (h_STJ − h_sinus)))²)

R(h) is the monotone cubic through annulus, sinuses, sinotubular junction and tube.
"""

import numpy as np
import scipy.interpolate
from jaxtyping import Float

from jaxfsi.anatomy.curves.curve import Curve, curve_through
from jaxfsi.anatomy.implicit import Tube, polar_contours, tube
from jaxfsi.anatomy.sources.parameters import SyntheticParameters

_SPACING = 0.06
_ANGLES = 72
_TUBE_RISE = 0.8  # from the junction to the full tube radius, over the junction radius


def end_margin(p: SyntheticParameters) -> float:
    """Length by which the aorta runs on beyond its openings [cm]."""
    return 0.35 * p.annulus_radius


def aorta_axis(p: SyntheticParameters) -> Curve:
    """Axis with s = height above the annulus; the normal points to the border of the sinuses.

    It is straight up to the junction; above, it turns away from the pulmonary artery by the
    bend angle, with a curvature that starts and ends at zero.
    """
    low = -(p.inflow_length + end_margin(p))
    high = p.aorta_length + end_margin(p)
    h = np.linspace(low, high, max(int((high - low) / 0.02), 50))
    x = np.clip((h - p.junction_height) / (p.aorta_length - p.junction_height), 0.0, 1.0)
    angle = p.bend_angle * x**2 * (3.0 - 2.0 * x)
    slope = np.stack([-np.sin(angle), np.zeros_like(h), np.cos(angle)], axis=1)
    rise = np.cumsum((slope[1:] + slope[:-1]) / 2.0 * (h[1] - h[0]), axis=0)
    points = np.array([0.0, 0.0, low]) + np.concatenate([np.zeros((1, 3)), rise])
    axis = curve_through(points, _SPACING, normals=np.array([[1.0, 0.0, 0.0]]))
    return Curve(axis.points, axis.s + low, axis.tangent, axis.normal, axis.binormal)


def aorta_radius(
    p: SyntheticParameters, height: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    """Mean radius R(h) of the aortic lumen [cm]."""
    rise = _TUBE_RISE * p.junction_radius
    knots = [-9.0, -0.3 * p.sinus_height, p.sinus_height, p.junction_height]
    radii = [p.annulus_radius, p.annulus_radius, p.sinus_radius, p.junction_radius]
    top = max(p.junction_height + rise, p.aorta_length)
    knots += [p.junction_height + rise, top + 1.0, top + 9.0]
    radii += [p.tube_radius] * 3
    return scipy.interpolate.PchipInterpolator(knots, radii)(height)


def aorta_tube(p: SyntheticParameters) -> Tube:
    """Lumen of the aorta from below its inlet to beyond its outlet."""
    axis = aorta_axis(p)
    theta = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    width = 0.6 * (p.junction_height - p.sinus_height)
    weight = np.exp(-(((axis.s - p.sinus_height) / width) ** 2))
    lobes = 1.0 - p.lobe_depth * weight[:, None] * np.cos(3.0 * theta)
    return tube(axis, polar_contours(aorta_radius(p, axis.s)[:, None] * lobes))
