"""A slit that closes: blood in a flat lumen whose wall bends inwards as the pressure inside falls.

The lumen is an ellipse of 4 mm × 1 mm, 6 mm long, in a wall of 0.5 mm, clamped at both ends. The
pressure at both openings falls by 400 mmHg a second below that outside, and the damping of the wall
(its viscosity over its modulus is 20 ms) keeps it from falling shut in one step. There is no known
answer: the problem asks whether the mesh of the blood stays valid while the area halves, and what
ends the motion.
"""

from typing import NamedTuple

import numpy as np

from jaxfsi.core.laws.contact import LeastGap
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.meshing import elliptic, tube
from jaxfsi.meshing.check.tet_quality import tet_quality
from jaxfsi.polygons import polygon_areas
from lumped.units import MMHG
from lumped.waveforms import Ramp

WIDTH, HEIGHT, LENGTH, THICKNESS = 0.4, 0.1, 0.6, 0.05
"""Major and minor axis of the lumen, length of the slit, thickness of its wall [cm]."""

YOUNG, POISSON = 1e6, 0.45
"""Young's modulus [dyn/cm²] and Poisson's ratio of the wall."""

DAMPING = 2e4
"""Kelvin-Voigt viscosity of the wall [g/(cm·s)]."""

FALL = -400.0 * MMHG
"""Rate of the pressure in the lumen [dyn/(cm²·s)]."""

STEP = 1e-3
"""Length of a step [s]."""


class SlitShape(NamedTuple):
    """The slit half-way along.

    Attributes:
        area: of the lumen over that of the reference [-].
        gap: between the two flat sides on the minor axis [cm].
        quality: least scaled Jacobian of the blood's elements, 1 for regular ones; negative where
            one is inverted.
    """

    area: float
    gap: float
    quality: float


def slit_mesh(*, n_around: int = 16, n_axial: int = 6, n_rings: int = 2) -> Mesh:
    """The slit with one layer of wedges in its wall; `n_around` is a multiple of four."""
    radius = float(np.sqrt(WIDTH * HEIGHT)) / 2.0
    return tube(
        radius=radius,
        length=LENGTH,
        thickness=THICKNESS,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=1,
        n_rings=n_rings,
        mapping=elliptic(axis_ratio=WIDTH / HEIGHT, radius=radius),
        columns=True,
    )


def slit_model(
    mesh: Mesh, *, wall_element: WallElement = "bending", least_gap: LeastGap | None = None
) -> Model:
    """The slit under a pressure that falls at both openings."""
    pressure = PressurePort(Ramp(0.0, FALL))
    wall = Wall(SaintVenantKirchhoff(YOUNG, POISSON), damping=DAMPING)
    ports = {"inlet": pressure, "outlet": pressure}
    return build_model(mesh, ports, wall=wall, wall_element=wall_element, least_gap=least_gap)


def slit_shape(mesh: Mesh, state: State) -> SlitShape:
    """Area and gap half-way along the slit, and the quality of its mesh."""
    moved = mesh.points + np.asarray(state.d_mesh).T[: len(mesh.points)]
    ring = np.unique(mesh.labelled(INTERFACE))
    ring = ring[np.isclose(mesh.points[ring, 2], LENGTH / 2.0)]
    x, y = mesh.points[ring, :2].T
    ring = ring[np.argsort(np.arctan2(y * WIDTH, x * HEIGHT))]
    flat = np.abs(mesh.points[ring, 0]) < 1e-9
    tets = mesh.tets_of(Region.FLUID)
    area, area_at_rest = polygon_areas(np.stack([moved[ring, :2], mesh.points[ring, :2]]))
    return SlitShape(
        float(area / area_at_rest),
        float(np.ptp(moved[ring][flat, 1])),
        float(np.min(tet_quality(moved, tets).scaled_jacobian)),
    )
