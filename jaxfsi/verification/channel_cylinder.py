"""Steady flow past a cylinder across a square channel (DFG 3D-1Z), and the forces on it.

Re = 20 with the cylinder's diameter and the mean inflow. Forces are the reactions at the held nodes
of the cylinder: the momentum equations summed over its nodes, which converge twice as fast as
tractions from the velocity's gradient on the surface. With the mean inflow U and the area D H that
the cylinder shows::

    c_D = 2 F_x/(ρ U² D H),   c_L = 2 F_y/(ρ U² D H)

Source: Schäfer & Turek 1996, Benchmark computations of laminar flow around a cylinder, case 3D-1Z;
the values are those of John & Matthies 2001 as FeatFlow quotes them.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.laws.fluid import Blood, fluid_residual, lagged_coefficients
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.ports.velocity import AbstractVelocity, VelocityPort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.meshing.labels import label_faces
from jaxfsi.meshing.structured.prisms import PlaneMesh, extruded
from jaxfsi.opening import Opening
from lumped.parameters import Parameter
from lumped.waveforms import Constant

HEIGHT, LENGTH, DIAMETER, CENTRE = 0.41, 2.5, 0.1, (0.5, 0.2)
"""Sides of the channel, its length, diameter and place of the cylinder."""

PEAK, MU, RHO = 0.45, 1e-3, 1.0
"""Largest velocity of the inflow, viscosity and density."""

DRAG, LIFT = 6.18533, 0.009401
"""Published coefficients."""


class Inflow(AbstractVelocity):
    """u = 16 U y z (H − y)(H − z)/H⁴."""

    def __call__(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
        """Velocity [cm/s]."""
        _, y, z = x
        along = 16.0 * PEAK * y * z * (HEIGHT - y) * (HEIGHT - z) / HEIGHT**4
        return jnp.stack([along, jnp.zeros_like(y), jnp.zeros_like(z)])


def channel_mesh(n: int) -> Mesh:
    """The channel with 8 n elements round the cylinder, finer at cylinder and walls.

    Args:
        n: refinement; 4 makes 61 000 elements.
    """
    section = _channel_section(n)
    share = np.linspace(-1.0, 1.0, 3 * n + 1)
    heights = 0.5 * HEIGHT * (1.0 + np.sin(0.4 * np.pi * share) / np.sin(0.4 * np.pi))
    points, tets, region = extruded(section, heights)
    middle = 0.5 * HEIGHT
    openings = (
        Opening("inlet", np.array([0.0, middle, middle]), np.array([-1.0, 0.0, 0.0]), HEIGHT),
        Opening("outlet", np.array([LENGTH, middle, middle]), np.array([1.0, 0.0, 0.0]), HEIGHT),
    )
    return label_faces(points, tets, region, openings)


def _channel_section(n: int) -> PlaneMesh:
    """Quadrilaterals round the cylinder and in two rectangles before and behind it, halved."""
    x0, y0 = CENTRE
    before, behind = x0 - y0, x0 + HEIGHT - y0
    # Round the cylinder from the corner below and behind, 2 n edges to each side of the square.
    low, high = (before, 0.0), (behind, HEIGHT)
    corners = np.array([(high[0], low[1]), (high[0], high[1]), (low[0], high[1]), (low[0], low[1])])
    share = np.arange(2 * n) / (2 * n)
    sides = [
        a + share[:, None] * (b - a)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    square = np.concatenate(sides)
    angle = 2.0 * np.pi * (np.arange(8 * n) / (8 * n)) - 0.25 * np.pi
    circle = np.array(CENTRE) + 0.5 * DIAMETER * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radial = np.linspace(0.0, 1.0, 3 * n + 1)[:, None, None] ** 1.7
    ring = circle + radial * (square - circle)
    rows = np.arange(ring[..., 0].size).reshape(3 * n + 1, 8 * n)
    blocks = [_halved(np.concatenate([rows, rows[:, :1]], axis=1))]
    points = [ring.reshape(-1, 2)]
    heights = np.linspace(0.0, HEIGHT, 2 * n + 1)
    behind_share = np.linspace(0.0, 1.0, 6 * n + 1) ** 1.4
    for x in (
        np.linspace(0.0, before, 2 * n + 1),
        behind + (LENGTH - behind) * behind_share,
    ):
        grid = np.stack(np.meshgrid(x, heights, indexing="ij"), axis=2)
        start = sum(len(p) for p in points)
        blocks.append(_halved(start + np.arange(grid[..., 0].size).reshape(grid.shape[:2]).T))
        points.append(grid.reshape(-1, 2))
    return _joined(np.concatenate(points), np.concatenate(blocks))


def _halved(nodes: np.ndarray) -> np.ndarray:
    a, b, c, d = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
    i, j = np.indices(a.shape)
    rising = ((i + j) % 2 == 0)[..., None]
    first = np.where(rising, np.stack([a, b, c], 2), np.stack([a, b, d], 2))
    second = np.where(rising, np.stack([a, c, d], 2), np.stack([b, c, d], 2))
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def _joined(points: np.ndarray, triangles: np.ndarray) -> PlaneMesh:
    """Points that coincide made one, triangles turned counter-clockwise."""
    _, first, index = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    points, triangles = points[first], index.reshape(-1)[triangles]
    a, b, c = (points[triangles[:, k]].T for k in range(3))
    (bx, by), (cx, cy) = b - a, c - a
    turned = bx * cy < by * cx
    triangles[turned] = triangles[turned][:, ::-1]
    return PlaneMesh(points, triangles, np.full(len(triangles), int(Region.FLUID)))


def channel_model(mesh: Mesh) -> Model:
    """The benchmark's inflow, no pressure at the outlet, no slip elsewhere."""
    ports = {"inlet": VelocityPort(Inflow()), "outlet": PressurePort(Constant(0.0))}
    return build_model(mesh, ports, blood=Blood(RHO, Newtonian(MU)))


class Forces(NamedTuple):
    """Coefficients of the forces on the cylinder.

    Attributes:
        drag: along the channel.
        lift: across.
        change: of the drag in the last step, relative.
    """

    drag: float
    lift: float
    change: float


def cylinder_forces(mesh: Mesh, *, dt: float, n_steps: int) -> Forces:
    """March until the flow is steady.

    Args:
        mesh: of `channel_mesh`.
        dt: step [s].
        n_steps: number of steps.
    """
    model = channel_model(mesh)
    nodes = np.unique(mesh.labelled(INTERFACE))
    away = np.hypot(*(mesh.points[nodes, :2] - CENTRE).T)
    nodes = nodes[away < 0.5 * DIAMETER + 1e-6]
    stepper = prepare(dt, model, rho_infinity=0.0, tolerance=1e-4, max_iterations=100)
    found = []
    state = initial_state(model)
    for count in (n_steps - 1, 1):
        state = march(model, state, stepper, count).state
        force = np.asarray(reaction(state, model, stepper)[:, nodes]).sum(axis=1)
        found.append(2.0 * force / (RHO * (4.0 / 9.0 * PEAK) ** 2 * DIAMETER * HEIGHT))
    drag, lift, _ = found[-1]
    return Forces(float(drag), float(lift), float(abs(drag / found[0][0] - 1.0)))


def reaction(state: State, model: Model, stepper: Stepper) -> Float[Array, "3 nodes"]:
    """Force of the blood on each held node [dyn]."""
    shape = geometry(model.x, model.fluid_tets)
    coefficients = lagged_coefficients(
        stepper.dt,
        state.u,
        state.a,
        state.p,
        jnp.zeros_like(state.u),
        model.blood,
        model.fluid_tets,
        shape,
    )
    momentum, _ = fluid_residual(
        state.u, state.a, state.p, model.blood, coefficients, model.fluid_tets, shape
    )
    return -momentum
