"""Preconditioner of the coupled step: a frozen wall factor and a pressure Schur complement.

The linearised step has the form [A G; D C] in velocity and pressure. With Â ≈ A and S ≈ C − D A⁻¹ G
the upper triangular approximate inverse is::

    z_p = S⁻¹ r_p,   z_u = Â⁻¹ (r_u − G z_p)

Â is a factor of the wall's block with the blood's share of its nodes, and in the blood relaxation
with the diagonal of A, and with its scalar operator where flow crosses elements (`relaxation`). The
least-squares stabilisation τ_C is part of A: where it has the time scale of the step in it, it is
of the size of inertia, and without it there are three times as many iterations. S takes for A in
the blood the diagonal and `SMOOTH` lumped masses: a velocity that a pressure drives is smooth, and
on it the consistent mass acts as the lumped one, two and a half times its diagonal; what upwinding
adds where flow crosses ten elements in a step makes it five times. On the interface S has the
wall's response to a uniform pressure, node by node; that of a wall that bends is found with its
whole tangent, since the vertices alone yield half as much. G has the forces of the pressure on
mid-edge modes: without them the coupled tube with a quadratic wall takes 15 iterations where it
takes 9 with the exact inverse of the wall.

Everything is assembled once at the reference shape with the blood at rest, but for the relaxation
in the blood and the resistance of the ports (`port_coupling`), which each linear system renews
(`with_blood`): where flow crosses ten elements in a step its stabilisation is forty times inertia,
and a patient's systole takes 37 iterations with the diagonal at rest, 19 with its own. S with the
diagonal at that flow is worse than at rest (31, 41, 32, 32 iterations in four phases of a patient's
stressed beat, 21, 41, 31, 30 at rest): the large diagonal belongs to velocities that alternate from
node to node. With the lumped masses it takes 23, 24, 24, 23, the elastic tube as many as before.
Measured on the elastic tube of 10 000 elements (Δt 1e-4 s, E 3e6 dyn/cm²): 7 iterations to 1e-3, as
many as with the exact Schur complement; 5 with an exact blood block.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.assembly import host_geometry
from jaxfsi.core.elements.linear import added
from jaxfsi.core.elements.stencil import apply, columns_of, neighbours
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.interface import MidEdgeInterface, mid_edge_flux, mid_edge_load
from jaxfsi.core.solve.krylov import euclidean_norm, fgmres
from jaxfsi.core.solve.nested_factor import (
    NestedFactor,
    nested_factor,
    nested_solve,
    nested_solve_once,
)
from jaxfsi.core.solve.port_coupling import (
    PortCoupling,
    port_coupling,
    resisted_pressure,
    resisted_velocity,
    resisted_velocity_transposed,
    with_resistance,
)
from jaxfsi.core.solve.relaxation import (
    Relaxation,
    relaxation,
    relaxed,
    renewed,
    transposed,
)
from jaxfsi.core.solve.step_blocks import StepBlocks, step_blocks
from jaxfsi.core.solve.wall_factor import (
    WallFactor,
    wall_factor,
    wall_free,
    wall_product,
    wall_solve,
    wall_solve_transposed,
)
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model
from lumped.device import quick_jit

SMOOTH = 1.6
"""Lumped masses of the blood in S beside the diagonal of A, which holds 0.4 of one."""

_RESPONSE_TOLERANCE = 1e-3
_RESPONSE_ITERATIONS = 60


class MidEdgeGradient(NamedTuple):
    """G of the mid-edge modes of the interface, in the reference shape.

    Attributes:
        interface: the faces.
        x: node positions [cm].
        weight: what a change of the unknown does to the velocity.
    """

    interface: MidEdgeInterface
    x: Float[Array, "3 nodes"]
    weight: Float[Array, ""]

    def load(self, p: Float[Array, " nodes"]) -> Float[Array, "3 nodes"]:
        """Forces of a pressure."""
        return -self.weight * mid_edge_load(p, self.x, self.interface)

    def flux(self, u: Float[Array, "3 nodes"]) -> Float[Array, " nodes"]:
        """The transpose of `load`."""
        return -self.weight * mid_edge_flux(u, self.x, self.interface)


_load, _flux = quick_jit(MidEdgeGradient.load), quick_jit(MidEdgeGradient.flux)


class Preconditioner(eqx.Module):
    """Frozen approximate inverse of the linearised step.

    Attributes:
        wall: approximate inverse of the wall's block.
        inverse_diagonal: of A at the blood's own nodes, 0 elsewhere; at rest until renewed.
        relaxation: of the velocity there; the diagonal alone until renewed.
        pressure: factor of S.
        pressure_nodes: nodes that carry a pressure.
        neighbour: nodes of the columns of the following, see `stencil.neighbours`.
        gradient: G of each direction, as stencils.
        gradient_transposed: the transpose of each.
        velocity_scale: A^(−1/2) of each velocity, by its diagonal.
        pressure_scale: S^(−1/2) of each pressure, by its diagonal.
        mid_edge: G of mid-edge modes; None where there are none.
        ports: resistance of the ports, zero until renewed; None where no pressure follows a flow.
    """

    wall: WallFactor
    inverse_diagonal: Float[Array, "3 nodes"]
    relaxation: Relaxation
    pressure: NestedFactor
    pressure_nodes: Int[Array, " wet"]
    neighbour: Int[Array, "columns nodes"]
    gradient: Float[Array, "3 columns nodes"]
    gradient_transposed: Float[Array, "3 columns nodes"]
    velocity_scale: Float[Array, "3 nodes"]
    pressure_scale: Float[Array, " nodes"]
    mid_edge: MidEdgeGradient | None
    ports: PortCoupling | None


def preconditioner(
    dt: float, model: Model, method: GeneralizedAlpha, *, dtype: type = np.float32
) -> Preconditioner:
    """Factor the step of a model with concrete parameters."""
    points = np.asarray(model.x).T
    prescribed, in_solid = np.asarray(model.prescribed), np.asarray(model.in_solid)
    in_fluid = np.asarray(model.in_fluid)
    fluid = np.asarray(model.fluid_tets).T
    shape = host_geometry(points, fluid)
    blocks = step_blocks(dt, model, method, shape)
    wall = wall_factor(blocks.A_wall, model, Weights(*method.weights(dt)), dtype=dtype)
    free_fluid = in_fluid & ~in_solid & ~prescribed
    inverse_diagonal = np.where(free_fluid[:, None], 1.0 / blocks.diagonal, 0.0)
    wet = np.flatnonzero(in_fluid)
    S = blocks.C
    smooth = blocks.diagonal + SMOOTH * blocks.lumped_mass[:, None]
    yielding = np.where(free_fluid[:, None], 1.0 / smooth, 0.0)
    for i in range(3):
        S = S - blocks.D[i] @ sp.diags(yielding[:, i]) @ blocks.G[i]
    mid_edge = None
    if model.mid_edge is not None:
        mid_edge = MidEdgeGradient(model.mid_edge, model.x, jnp.asarray(method.weights(dt)[1]))
    S = S + sp.diags(_wall_response(blocks, wall, mid_edge, in_fluid & in_solid))
    S = ((S + S.T) / 2.0).tocsr()[wet][:, wet]
    S_diagonal = np.ones(len(points))
    S_diagonal[wet] = S.diagonal()
    pressure = nested_factor(S, points=points[wet], dtype=dtype)
    neighbour = neighbours(fluid, len(points))
    G = np.stack([columns_of(block, neighbour) for block in blocks.G])
    G_transposed = np.stack([columns_of(block.T.tocsr(), neighbour) for block in blocks.G])
    return Preconditioner(
        wall,
        jnp.asarray(inverse_diagonal.T, dtype),
        relaxation(fluid, free_fluid, dtype=dtype),
        pressure,
        jnp.asarray(wet, jnp.int32),
        jnp.asarray(neighbour, jnp.int32),
        jnp.asarray(G, dtype),
        jnp.asarray(G_transposed, dtype),
        jnp.asarray(np.where(prescribed[:, None], 1.0, blocks.diagonal**-0.5).T),
        jnp.asarray(S_diagonal**-0.5),
        jax.tree.map(
            lambda a: jnp.asarray(a, dtype) if eqx.is_inexact_array_like(a) else a, mid_edge
        ),
        port_coupling(model, blocks, yielding, pressure, dtype),
    )


def _wall_response(
    blocks: StepBlocks,
    wall: WallFactor,
    mid_edge: MidEdgeGradient | None,
    interface: Bool[np.ndarray, " nodes"],
) -> Float[np.ndarray, " nodes"]:
    """Volume flow that a uniform unit pressure presses into the wall at each interface node."""
    nodes = np.asarray(wall.nodes)
    if not len(nodes):
        return np.zeros(len(interface))
    ones = np.ones(len(interface))
    push = -np.stack([G @ ones for G in blocks.G])
    if mid_edge is not None:
        push = push - np.asarray(_load(mid_edge, jnp.asarray(ones)))
    velocity = np.zeros_like(push)
    if wall.smoother is None:
        solved = nested_solve_once(wall.direct, push[:, nodes].T.ravel())
        velocity[:, nodes] = solved.reshape(-1, 3).T
    else:
        velocity = np.asarray(_yielding(wall, jnp.asarray(push, wall.smoother.free.dtype)), float)
    response = sum(D @ v for D, v in zip(blocks.D, velocity, strict=True))
    if mid_edge is not None:
        flux = _flux(mid_edge, jnp.asarray(velocity))
        response = response - np.asarray(flux)
    return np.where(interface, np.maximum(response, 0.0), 0.0)


@quick_jit
def _yielding(wall: WallFactor, push: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
    """Velocity of a wall at rest under a force, with its whole tangent."""
    free = wall_free(wall)

    def product(v: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        v = v.reshape(push.shape)
        return jnp.where(free, wall_product(wall, v), v).reshape(-1)

    found = fgmres(
        product,
        jnp.where(free, push, 0.0).reshape(-1),
        lambda r: wall_solve(wall, r.reshape(push.shape)).reshape(-1),
        tolerance=_RESPONSE_TOLERANCE * euclidean_norm(push.reshape(-1)),
        max_iterations=_RESPONSE_ITERATIONS,
    )
    return found.x.reshape(push.shape)


def with_blood(
    M: Preconditioner,
    diagonal: Sequence[Float[Array, " nodes"]],
    A: tuple[Float[Array, " tets"], ...],
    Z: Float[Array, " ports"],
) -> Preconditioner:
    """The preconditioner with another A at the blood's own nodes.

    Args:
        M: with any.
        diagonal: of A, by component, without the resistance of the ports.
        A: entries of its scalar operator, see `relaxation.renewed`.
        Z: derivative of each port's pressure by its flow [dyn·s/cm⁵].
    """
    known = M.inverse_diagonal
    inverse = jnp.stack(
        [jnp.where(d > 0.0, 1.0 / jnp.where(d > 0.0, d, 1.0), 0.0) for d in diagonal]
    )
    inverse = jnp.where((known > 0.0) & (inverse > 0.0), inverse.astype(known.dtype), known)
    own = M.relaxation.nodes
    stiffened = jnp.mean(known[:, own] / inverse[:, own])
    blood = renewed(M.relaxation, A, stiffened)
    ports = None if M.ports is None else with_resistance(M.ports, Z, inverse)
    return dataclasses.replace(M, inverse_diagonal=inverse, relaxation=blood, ports=ports)


def _weak_gradient(M: Preconditioner, p: Float[Array, " nodes"]) -> Float[Array, "3 nodes"]:
    """G p: force of a pressure on the nodes."""
    force = jnp.stack([apply(g, M.neighbour, p) for g in M.gradient])
    return force if M.mid_edge is None else force + M.mid_edge.load(p)


def _weak_gradient_transposed(
    M: Preconditioner, u: Float[Array, "3 nodes"]
) -> Float[Array, " nodes"]:
    flow = added(
        apply(g, M.neighbour, u_i) for g, u_i in zip(M.gradient_transposed, u, strict=True)
    )
    return flow if M.mid_edge is None else flow + M.mid_edge.flux(u)


def _velocity_solve(M: Preconditioner, r: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
    own = relaxed(M.relaxation, M.inverse_diagonal, r)
    if M.ports is not None:
        own = resisted_velocity(M.ports, M.inverse_diagonal, own)
    return own + wall_solve(M.wall, r)


def _velocity_solve_transposed(
    M: Preconditioner, r: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    rest = r
    if M.ports is not None:
        rest = resisted_velocity_transposed(M.ports, M.inverse_diagonal, r)
    own = relaxed(transposed(M.relaxation), M.inverse_diagonal, rest)
    return own + wall_solve_transposed(M.wall, r)


def _pressure_solve(M: Preconditioner, r: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
    wet = r[M.pressure_nodes]
    z = nested_solve(M.pressure, wet)
    if M.ports is not None:
        z = resisted_pressure(M.ports, z, wet)
    return jnp.zeros_like(r).at[M.pressure_nodes].set(z)


def precondition(
    M: Preconditioner, r_u: Float[Array, "3 nodes"], r_p: Float[Array, " nodes"]
) -> tuple[Float[Array, "3 nodes"], Float[Array, " nodes"]]:
    """Apply the approximate inverse to residuals of momentum and continuity, in its precision."""
    dtype = M.inverse_diagonal.dtype
    with jax.named_scope("pressure_solve"):
        z_p = _pressure_solve(M, r_p.astype(dtype))
    with jax.named_scope("velocity_solve"):
        z_u = _velocity_solve(M, r_u.astype(dtype) - _weak_gradient(M, z_p))
    return z_u.astype(r_u.dtype), z_p.astype(r_p.dtype)


def precondition_transposed(
    M: Preconditioner, r_u: Float[Array, "3 nodes"], r_p: Float[Array, " nodes"]
) -> tuple[Float[Array, "3 nodes"], Float[Array, " nodes"]]:
    """Apply the transpose of `precondition`; S is symmetric."""
    dtype = M.inverse_diagonal.dtype
    z_u = _velocity_solve_transposed(M, r_u.astype(dtype))
    z_p = _pressure_solve(M, r_p.astype(dtype) - _weak_gradient_transposed(M, z_u))
    return z_u.astype(r_u.dtype), z_p.astype(r_p.dtype)
