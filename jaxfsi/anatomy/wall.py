"""The wall of vessels: its thickness from their size, and its outer surface.

Thickness follows the radius within limits::

    t = clip(factor · radius, minimum, maximum),   corners rounded

The outer surface is an additively weighted offset (a thick-walled vessel is offset by more)::

    W(x) = min_k over vessels (dᵢ(x) − tᵢ),      W ← min(W, L(x) − 0.6 min tᵢ)

Offsetting each vessel by its own thickness before taking the minimum keeps the thick aortic wall
whole beside a thin coronary wall, where the thickness of the nearest lumen would cut a notch. Two
lumens nearer than their walls share one solid. The last term is a floor on the thickness where
lumens were blended.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.implicit import Foot, smooth_minimum
from jaxfsi.anatomy.vessels import VesselTube, along, shared, united, vessel_feet

_FLOOR = 0.6
_ROUNDING = 0.25  # of the span between the limits, at each corner of the clip
_CREASE = 0.06  # blend radius of the outer surfaces of two vessels [cm]


def thickness_from_radius(
    radius: Float[np.ndarray, " points"], *, factor: float, minimum: float, maximum: float
) -> Float[np.ndarray, " points"]:
    """Wall thickness [cm] from the radius of a vessel, clip(factor · radius, minimum, maximum).

    The corners of the clip are rounded (smooth minimum and maximum), so the thickness has
    continuous derivatives; it differs from the clip by at most 1/16 of maximum − minimum.

    Args:
        radius: of the vessel [cm].
        factor: thickness over radius.
        minimum: least thickness [cm].
        maximum: greatest thickness [cm].

    Raises:
        ValueError: the limits are not 0 < minimum ≤ maximum, or the factor is not positive.
    """
    if not 0.0 < minimum <= maximum or not factor > 0.0:
        raise ValueError(
            f"thickness limits {minimum:g}..{maximum:g} cm and factor {factor:g} make no wall."
            " Give 0 < minimum <= maximum and a positive factor."
        )
    k = _ROUNDING * (maximum - minimum)
    capped = smooth_minimum(factor * radius, np.full_like(radius, maximum), k)
    raised = -smooth_minimum(-capped, np.full_like(radius, -minimum), k)
    return np.clip(raised, minimum, maximum)


def _thickness(vessel: VesselTube) -> Float[np.ndarray, " samples"]:
    return vessel.thickness


def offset(vessels: Sequence[VesselTube], feet: Sequence[Foot]) -> Float[np.ndarray, " points"]:
    """Outer wall function W [cm] from the feet on all vessels."""
    value: Float[np.ndarray, " points"] | None = None
    for vessel, foot in zip(vessels, feet, strict=True):
        outside = foot.distance - along(vessel, vessel.thickness, foot)
        value = outside if value is None else smooth_minimum(value, outside, _CREASE)
    assert value is not None
    thinnest = min(float(np.min(vessel.thickness)) for vessel in vessels)
    return np.minimum(value, united(vessels, feet) - _FLOOR * thinnest)


def wall_distance(
    vessels: Sequence[VesselTube], points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Outer wall function W [cm], negative inside the outer surface.

    Args:
        vessels: main vessel first, then its branches.
        points: positions [cm].
    """
    return offset(vessels, vessel_feet(vessels, points))


def requested_thickness(
    vessels: Sequence[VesselTube], points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Wall thickness asked for at points of the lumen's surface [cm], that of the nearest vessel.

    In the septum between two lumens the solid is as thick as the lumens are apart, not this.
    """
    return shared(vessels, vessel_feet(vessels, points), _thickness)


def wall_function(
    vessels: Sequence[VesselTube],
) -> Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]]:
    """The wall function of some vessels as a function of position only (it can be pickled)."""
    return partial(wall_distance, tuple(vessels))
