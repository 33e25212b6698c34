"""Flow through the FDA's nozzle into its sudden expansion; Reynolds number 500 in the throat.

A tube of 12 mm narrows over 22.7 mm to a throat of 4 mm, which after 40 mm opens at z = 0 into a
tube of 12 mm again. The loss coefficient relates the pressure between the first and the last tap
of the experiments to the head of the mean velocity in the throat::

    K = 2 (P(z = −9.03 cm) − P(z = 3.2 cm))/(ρ U²)

Four laboratories measured 2.4, 3.9, 4.4 and 4.6. An ideal fluid up to the throat and a boundary
layer in it lose 3.30 (`boundary_layer_loss`), another method in (z, r) finds 3.404 (`REFERENCE`).
The core gives 3.450 with 27 000 elements and 3.420 with 92 000, and the velocity that was measured
where the jet begins (0.75 m/s; 0.71 to 0.77 by laboratory). Between the taps before and behind the
step the laboratories have a rise of 130 Pa, though the jet can regain no more than about
2/9 (1 − 1/9) of the throat's head of 91 Pa.

Source: Hariharan et al. 2011, J Biomech Eng 133:041002; measurements doi 10.17917/C78G69.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.fields.viscous_loss import drop_added_by_mesh, unresolved_loss, viscous_loss
from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_parts import used_nodes
from jaxfsi.meshing import tube
from jaxfsi.meshing.labels import label_faces
from jaxfsi.opening import Opening
from lumped.waveforms import AbstractWaveform, Constant, Ramp

WIDE, NARROW = 0.6, 0.2
"""Radii of tube and throat [cm]."""

CONE, THROAT, INLET, OUTLET = -6.2685, -4.0, -10.0, 16.0
"""Where the cone, the throat and the model begin and where the model ends [cm]."""

TAPS = (-9.032, 3.2)
"""First and last tap of the experiments [cm]."""

RHO, MU, FLOW = 1.056, 0.035, 5.20624
"""Density [g/cm³], viscosity [g/(cm·s)] and flow [cm³/s] of the experiments at Re 500."""

_HEAD = 0.5 * RHO * (FLOW / (np.pi * NARROW**2)) ** 2
"""Head of the mean velocity in the throat [dyn/cm²]."""

REFERENCE = 3.4042
"""Loss coefficient by an axisymmetric Taylor-Hood method (`benchmarks.axisymmetric`)."""

LEAST, MOST = 3.9, 4.6
"""Loss coefficients of the laboratories, but for one that measured 2.4."""

SLOWEST, FASTEST = 70.9, 76.8
"""Velocity on the axis at z = 0 by laboratory [cm/s]."""


def boundary_layer_loss() -> float:
    """Loss up to the end of the throat, with a flat profile at its entrance and no loss before.

    With x⁺ = L/(D Re) the throat takes, over the head of the mean velocity::

        13.74 √x⁺ + (1.25 + 64 x⁺ − 13.74 √x⁺)/(1 + 0.00021/x⁺²)

    and Bernoulli's equation from Poiseuille's flow in the wide tube 1 − 2 (A_throat/A)².

    Source: Shah & London 1978, Laminar flow forced convection in ducts, chapter V, apparent
    friction in the entrance of a pipe.
    """
    Re = 4.0 * RHO * FLOW / (np.pi * MU * 2.0 * NARROW)
    x = -THROAT / (2.0 * NARROW * Re)
    start = 13.74 * np.sqrt(x)
    throat = start + (1.25 + 64.0 * x - start) / (1.0 + 0.00021 / x**2)
    return float(throat + 1.0 - 2.0 * (NARROW / WIDE) ** 4)


def nozzle_mesh(n: int) -> Mesh:
    """The nozzle with 8 n edges round it.

    Args:
        n: refinement; 3 makes 92 000 elements.
    """
    angle = 2.0 * np.pi / (8 * n)
    scale = np.sqrt(angle / np.sin(angle))  # the polygon has the circle's area
    levels = _levels(n)
    mesh = tube(
        radius=1.0,
        length=1.0,
        thickness=1.0,
        n_around=8 * n,
        n_axial=len(levels) - 1,
        n_layers=2 * n,
        n_rings=2 * n,
    )
    unit_x, unit_y, height = mesh.points.T
    z = np.interp(height, np.linspace(0.0, 1.0, len(levels)), levels)
    inside = np.hypot(unit_x, unit_y)
    lumen = np.interp(z, [INLET, CONE, THROAT, 0.0], [WIDE, WIDE, NARROW, NARROW])
    core = np.minimum(inside, 1.0)
    core = core * (1.0 + 0.35 * (1.0 - core))  # thin elements at the wall and the jet's edge
    layer = np.maximum(inside - 1.0, 0.0)
    r = scale * (lumen * core + (WIDE - NARROW) * layer**1.25)
    turn = r / np.maximum(inside, 1e-12)
    points = np.stack([unit_x * turn, unit_y * turn, z], axis=1)
    behind = np.all(z[mesh.tets] > -1e-9, axis=1)
    kept = behind | (mesh.region == Region.FLUID)
    nodes = used_nodes(mesh.tets[kept])
    points, tets = points[nodes], np.searchsorted(nodes, mesh.tets[kept])
    along = np.array([0.0, 0.0, 1.0])
    openings = (
        Opening("inlet", INLET * along, -along, 2.0 * WIDE),
        Opening("outlet", OUTLET * along, along, 2.0 * WIDE),
    )
    return label_faces(points, tets, np.full(len(tets), int(Region.FLUID)), openings)


def _levels(n: int) -> Float[np.ndarray, " levels"]:
    """Heights of the sections, close together at the ends of cone and throat."""
    parts = (
        np.linspace(INLET, CONE, 4 * n + 1),
        np.linspace(CONE, THROAT, 5 * n + 1),
        THROAT * (1.0 - np.linspace(0.0, 1.0, 8 * n + 1) ** 1.3),
        OUTLET * np.linspace(0.0, 1.0, 18 * n + 1) ** 2.0,
    )
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def nozzle_model(mesh: Mesh, flow: AbstractWaveform) -> Model:
    """Poiseuille's profile at the inlet, no pressure at the outlet."""
    ports = {"inlet": FlowPort(flow), "outlet": PressurePort(Constant(0.0))}
    return build_model(mesh, ports, blood=Blood(RHO, Newtonian(MU)))


class NozzleFlow(NamedTuple):
    """What comes out.

    Attributes:
        K: loss coefficient.
        added: what the mesh adds to it by the estimate of `jaxfsi.fields.viscous_loss`.
        change: of K over the last tenth of the time, relative.
        z: nodes on the axis [cm].
        u: velocity there [cm/s].
        P: pressure there, from that at the last tap [dyn/cm²].
    """

    K: float
    added: float
    change: float
    z: Float[np.ndarray, " axis"]
    u: Float[np.ndarray, " axis"]
    P: Float[np.ndarray, " axis"]


def nozzle_flow(mesh: Mesh, *, dt: float, n_steps: int) -> NozzleFlow:
    """March until the flow is steady; it rises from rest within a quarter of the steps.

    Args:
        mesh: of `nozzle_mesh`.
        dt: step [s].
        n_steps: number of steps.
    """
    rise, last = n_steps // 4, n_steps // 10
    model = nozzle_model(mesh, Ramp(0.0, FLOW / (rise * dt)))
    stepper = prepare(dt, model, rho_infinity=0.0, tolerance=1e-3, max_iterations=200)
    state = march(model, initial_state(model), stepper, rise).state
    model = nozzle_model(mesh, Constant(FLOW))
    before = march(model, state, stepper, n_steps - rise - last).state
    state = march(model, before, stepper, last).state
    earlier, (K, z, u, P) = _on_axis(before, mesh)[0], _on_axis(state, mesh)
    added = _added_by_mesh(state, mesh, model.blood, dt)
    return NozzleFlow(K, added, abs(K / earlier - 1.0), z, u, P)


def _added_by_mesh(state: State, mesh: Mesh, blood: Blood, dt: float) -> float:
    x, tets = jnp.asarray(mesh.points.T), jnp.asarray(mesh.tets.T)
    loss = viscous_loss(state.u, x, tets, blood.viscosity)
    S = unresolved_loss(dt, state.u, state.p, x, tets, blood)
    middle = mesh.points[mesh.tets, 2].mean(axis=1)
    between = jnp.asarray((TAPS[0] < middle) & (middle < TAPS[1]))
    E, eta, S = (jnp.sum(part * between) for part in (loss.rate, loss.defect, S))
    return float(drop_added_by_mesh(FLOW, E, eta, S)) / _HEAD


def _on_axis(state: State, mesh: Mesh) -> tuple[float, *tuple[Float[np.ndarray, " axis"], ...]]:
    nodes = np.flatnonzero(np.hypot(mesh.points[:, 0], mesh.points[:, 1]) < 1e-9)
    nodes = nodes[np.argsort(mesh.points[nodes, 2])]
    z = mesh.points[nodes, 2]
    pressure: Float[Array, " nodes"] = state.p
    P = np.asarray(pressure)[nodes]
    last = np.interp(TAPS[1], z, P)
    return loss_coefficient(z, P), z, np.asarray(state.u)[2, nodes], P - last


def loss_coefficient(z: Float[np.ndarray, " axis"], P: Float[np.ndarray, " axis"]) -> float:
    """K of the pressure along the axis.

    Args:
        z: places, ascending [cm].
        P: pressure there [dyn/cm²].
    """
    first, last = np.interp(TAPS, z, P)
    return float(first - last) / _HEAD
