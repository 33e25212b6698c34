"""What every source of an anatomy gives: implicit lumen and wall, openings, local size.

The lumen is {L < 0}, the wall {W < 0 ≤ L}. Both functions are signed distances near their zero
set, so that |L| and |W| measure depth there. Two lumens that lie closer than twice their wall
share one solid: nothing has to be joined. Vessels run on beyond their openings; each opening is a
plane that cuts them.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.vessels import VesselTube
from jaxfsi.opening import Opening

OVERRUN = 0.5
"""Length by which vessels run on beyond their openings [cm]."""

MARGIN = 0.3
"""Distance of the bounds from what they hold [cm]."""

OPENING_BALL = 1.15
"""Radius of the ball of an opening over that of the vessel with its wall."""

PointFunction = Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]]


class Centerline(NamedTuple):
    """Axis of a vessel from its ostium (or inlet) downstream.

    Attributes:
        points: positions [cm].
        s: arc length of each position [cm], growing downstream.
    """

    points: Float[np.ndarray, "points 3"]
    s: Float[np.ndarray, " points"]


@dataclasses.dataclass(frozen=True)
class Anatomy:
    """Lumen, wall and openings of the vessels of one patient in one state.

    Attributes:
        name: for messages and titles.
        lumen: L(x) [cm], negative in the blood.
        wall: W(x) [cm], negative inside the outer surface of the wall.
        local_radius: half the local width of the nearest lumen [cm] (of a slit: half its minor
            axis); sets the element size.
        thickness: requested wall thickness at points of the lumen's surface [cm].
        openings: where the vessels are cut.
        bounds: lower and upper corner of a box that holds the domain [cm].
        centerlines: axis of each vessel by name (``aorta``, ``anomalous``, ``normal``); used for
            cross-sections and pictures.
        meta: numbers worth keeping with the mesh (parameters, state, source).
        vessels: the tubes whose union the lumen is, the aorta first; none where it is a surface.
    """

    name: str
    lumen: PointFunction
    wall: PointFunction
    local_radius: PointFunction
    thickness: PointFunction
    openings: tuple[Opening, ...]
    bounds: Float[np.ndarray, "2 3"]
    centerlines: dict[str, Centerline]
    meta: dict[str, object] = dataclasses.field(default_factory=dict)
    vessels: tuple[VesselTube, ...] = ()
