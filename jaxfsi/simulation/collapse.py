"""Collapse of the lumen: a run ends because the blood between two walls has no room left.

A step that fails at every length because an element of the blood turns inside out is a collapse
where some element had lost three quarters of its reference volume before: walls have come together.
From a larger volume an element turns inside out in a single step, which is a failure of the
computation.

A slit may also snap: without viscosity a buckling wall accelerates until no step resolves it. Walls
of arteries move at one or two cm/s; their measured phase lag of 6 to 7 degrees (Circ. Res. 1990,
66:1413) is a viscosity over Young's modulus of some 15 ms, and 2 ms slow a snap enough.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State

COLLAPSED = 0.25
"""Volume over reference volume of an element below which an inversion is a collapse."""


SNAPPING = 10.0
"""Speed of a wall that snaps [cm/s]."""


class Collapse(NamedTuple):
    """Where and when a lumen collapsed.

    Attributes:
        t: end of the last good step [s].
        place: middle of the element with the least volume ratio, in the reference shape [cm].
        point: the same in the deformed one [cm].
        volume_ratio: volume of that element over its reference volume, 0 where it is inverted at
            the end of the step [-].
        d: displacement of the vertices of the mesh, wall and blood [cm].
    """

    t: float
    place: Float[np.ndarray, " 3"]
    point: Float[np.ndarray, " 3"]
    volume_ratio: float
    d: Float[np.ndarray, "nodes 3"]

    @property
    def sentence(self) -> str:
        """What happened."""
        at = ", ".join(f"{10.0 * x:.1f}" for x in self.point)
        kept = f"{100.0 * self.volume_ratio:.1f} %"
        return (
            f"The lumen collapsed at t = {self.t:.4g} s, at ({at}) mm: an element of blood there"
            f" kept {kept} of its volume, and the walls meet in the next step."
        )


def collapse(model: Model, state: State) -> Collapse | None:
    """The collapse that a state is about to end in; None where no element is small enough.

    Args:
        model: the model, with blood.
        state: after the last good step before an element turned inside out.
    """
    moved = np.where(np.asarray(model.in_solid), np.asarray(state.d), np.asarray(state.d_mesh))
    tets = np.asarray(model.fluid_tets)
    before = np.asarray(geometry(model.x, model.fluid_tets).volume)
    ratio = np.asarray(geometry(model.x + state.d_mesh, model.fluid_tets).volume) / before
    least = int(np.argmin(ratio))
    if not ratio[least] < COLLAPSED:
        return None
    x, nodes = np.asarray(model.x), tets[:, least]
    place = x[:, nodes].mean(axis=1)
    point = place + np.asarray(state.d_mesh)[:, nodes].mean(axis=1)
    d = moved[:, : model.n_vertices].T
    return Collapse(float(state.t), place, point, max(float(ratio[least]), 0.0), d)


def snapping(model: Model, state: State) -> str:
    """Where a wall snaps and what slows it; empty where none is that fast.

    Args:
        model: the model.
        state: after the last good step.
    """
    u = np.where(np.asarray(model.in_solid), np.asarray(state.u), 0.0)[:, : model.n_vertices]
    speed = np.linalg.norm(u, axis=0)
    fastest = int(np.argmax(speed))
    if not speed[fastest] > SNAPPING:
        return ""
    place = np.asarray(model.x)[:, fastest] + np.asarray(state.d)[:, fastest]
    at = ", ".join(f"{10.0 * x:.1f}" for x in place)
    return (
        f" The wall moves at {speed[fastest]:.0f} cm/s at ({at}) mm: it snaps. Give it viscosity,"
        " from 2 ms times Young's modulus, or support by the tissue round it."
    )
