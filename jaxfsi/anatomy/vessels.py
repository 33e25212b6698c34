"""Vessels with their wall: a main vessel and its branches as one lumen.

The lumen is the smooth minimum of the distances to all vessels, with a blend radius that belongs
to the place along the branch: wide at its ostium, where a sharp edge would be, and far below the
septum where the branch runs inside the wall of the main vessel::

    L(x) = min_k( d_main(x), d_branch(x) ),   k = blend(s of x on the branch)
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.implicit import Foot, Tube, smooth_minimum, tube_foot

_REACH = 0.5  # farther than this from a branch [cm] its exact distance decides nothing
_TIP_BLEND = 1.5  # blend radius at the tip of the septum, over the septum
_FAR_BLEND = 0.3  # blend radius along the septum, over the septum
_SHARE_WIDTH = 0.03  # over which a property passes from one vessel to the next [cm]


@dataclasses.dataclass(frozen=True)
class VesselTube:
    """A tube and what belongs to each place along it (at the samples of its axis).

    Attributes:
        name: of the vessel.
        tube: its lumen.
        half_width: half the smallest width of the lumen [cm].
        thickness: of its wall [cm].
        blend: radius of blending with the main vessel [cm]; unused for the main vessel.
    """

    name: str
    tube: Tube
    half_width: Float[np.ndarray, " samples"]
    thickness: Float[np.ndarray, " samples"]
    blend: Float[np.ndarray, " samples"]


def septum_blend(
    gap: Float[np.ndarray, " samples"], s: Float[np.ndarray, " samples"], septum: float
) -> Float[np.ndarray, " samples"]:
    """Blend radius along an artery that leaves the main vessel and runs beside it [cm].

    Where the gap g between the lumens is below half the septum, k = 1.5 septum joins them (two
    parallel surfaces join where g < k/2); where it has grown to the septum, k = 0.3 septum leaves
    both alone. In between the septum begins, with a rounded tip.

    Args:
        gap: least distance of each section from the lumen of the main vessel [cm].
        s: arc length of each [cm], 0 at the ostium.
        septum: thickness of the tissue between the lumens [cm].
    """
    x = np.clip((gap / septum - 0.5) / 0.4, 0.0, 1.0)
    # Distal of the first place with a septum no blending may come back.
    x = np.maximum.accumulate(np.where(s < 0.0, 0.0, x))
    x = x**2 * (3.0 - 2.0 * x)
    return septum * (_TIP_BLEND + (_FAR_BLEND - _TIP_BLEND) * x)


def vessel_feet(vessels: Sequence[VesselTube], points: Float[np.ndarray, "points 3"]) -> list[Foot]:
    """Foot of the points on each vessel; branches (all but the first) only within reach."""
    reaches = [np.inf] + [_REACH] * (len(vessels) - 1)
    return [
        tube_foot(vessel.tube, points, reach=reach)
        for vessel, reach in zip(vessels, reaches, strict=True)
    ]


def along(
    vessel: VesselTube, values: Float[np.ndarray, " samples"], foot: Foot
) -> Float[np.ndarray, " points"]:
    """Values given along a vessel, at the feet of points."""
    return np.interp(foot.s, vessel.tube.axis.s, values)


def united(vessels: Sequence[VesselTube], feet: Sequence[Foot]) -> Float[np.ndarray, " points"]:
    """Lumen function L [cm] from the feet on all vessels."""
    value = feet[0].distance
    for vessel, foot in zip(vessels[1:], feet[1:], strict=True):
        value = smooth_minimum(value, foot.distance, along(vessel, vessel.blend, foot))
    return value


def lumen_distance(
    vessels: Sequence[VesselTube], points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Lumen function L [cm], negative in the blood.

    Args:
        vessels: main vessel first, then its branches.
        points: positions [cm].
    """
    return united(vessels, vessel_feet(vessels, points))


def shared(
    vessels: Sequence[VesselTube],
    feet: Sequence[Foot],
    select: Callable[[VesselTube], Float[np.ndarray, " samples"]],
) -> Float[np.ndarray, " points"]:
    """A positive property of the nearest vessel, passing smoothly from one to the next.

    The geometric mean of the vessels' values with weights exp(−d/w), w = 0.03 cm.
    """
    distance = np.stack([foot.distance for foot in feet])
    weight = np.exp((np.min(distance, axis=0) - distance) / _SHARE_WIDTH)
    values = np.stack(
        [along(vessel, select(vessel), foot) for vessel, foot in zip(vessels, feet, strict=True)]
    )
    return np.exp(np.sum(weight * np.log(values), axis=0) / np.sum(weight, axis=0))


def _half_width(vessel: VesselTube) -> Float[np.ndarray, " samples"]:
    return vessel.half_width


def local_half_width(
    vessels: Sequence[VesselTube], points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Half the smallest width of the lumen that is nearest to each point [cm]."""
    return shared(vessels, vessel_feet(vessels, points), _half_width)


def lumen_function(
    vessels: Sequence[VesselTube],
) -> Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]]:
    """The lumen function of some vessels as a function of position only (it can be pickled)."""
    return partial(lumen_distance, tuple(vessels))
