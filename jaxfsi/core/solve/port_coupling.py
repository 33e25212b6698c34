"""The resistance of the ports in the preconditioner: one matrix of rank one for each port.

A port whose pressure follows its flow, P = P_offset + Z Q with Q = aᵀu, adds Z a aᵀ to the block of
momentum. A preconditioner that leaves it out has an eigenvalue of several hundred for each opening,
and its Schur complement S lets blood out freely where hardly any leaves.

Let Λ be the diagonal of momentum at the blood's own nodes, and y what S takes for its inverse. With
a, g = Gᵀ y a and s = S⁻¹ g as columns, one for each port, Woodbury's identity gives::

    (Λ + a Z aᵀ)⁻¹ = Λ⁻¹ − Λ⁻¹ a (Z⁻¹ + aᵀ Λ⁻¹ a)⁻¹ aᵀ Λ⁻¹
    S − g (Z⁻¹ + aᵀ y a)⁻¹ gᵀ  has the inverse  S⁻¹ + s (Z⁻¹ + aᵀ y a − gᵀ s)⁻¹ sᵀ

Nodes on the rim of an opening in a free wall are the wall's, and left out. On the medium mesh of a
patient a linear system to 1e-3 takes 14, 23 and 26 iterations at three moments of the beat, and 22,
25 and 34 without the ports.

Source: Esmaily-Moghadam, Bazilevs & Marsden 2013, Comput. Mech. 52:1141; Hager 1989, SIAM Rev.
31:221, for Woodbury's identity.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import Precision
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import area_vectors, face_load
from jaxfsi.core.ports.port import AbstractTractionPort
from jaxfsi.core.solve.nested_factor import NestedFactor, nested_solve_once
from jaxfsi.core.solve.step_blocks import StepBlocks
from jaxfsi.core.step.model import Model

_ROUND_OFF = 1e-5
"""Least eigenvalue of aᵀ y a − gᵀ s, relative to aᵀ y a. Through a rigid vessel whose openings all
have a resistance a uniform pressure drives no flow: what is left of that zero is round-off."""


class PortCoupling(eqx.Module):
    """The vectors of the ports, and the matrices that combine them for given resistances.

    Attributes:
        port: places of these ports among those of the model (static).
        nodes: the blood's own nodes at these ports.
        area: a: flow of each port for a unit velocity of a node [cm²].
        pressure: s: pressure at each node that carries one, for a unit pressure at a port.
        conductance: aᵀ y a − gᵀ s: flow of each port for a unit pressure at another [cm⁵/(dyn·s)].
        of_velocity: (Z⁻¹ + aᵀ Λ⁻¹ a)⁻¹ [dyn·s/cm⁵]; zero until Z is given.
        of_pressure: (Z⁻¹ + aᵀ y a − gᵀ s)⁻¹, likewise.
    """

    port: tuple[int, ...] = eqx.field(static=True)
    nodes: Int[Array, " open"]
    area: Float[Array, "ports 3 open"]
    pressure: Float[Array, "ports wet"]
    conductance: Float[Array, "ports ports"]
    of_velocity: Float[Array, "ports ports"]
    of_pressure: Float[Array, "ports ports"]


def port_coupling(
    model: Model,
    blocks: StepBlocks,
    yielding: Float[np.ndarray, "nodes 3"],
    pressure: NestedFactor,
    dtype: type,
) -> PortCoupling | None:
    """Vectors of the ports whose pressure follows their flow; None where there are none.

    Args:
        model: a model with concrete numbers.
        blocks: of its step.
        yielding: y, zero but at the blood's own nodes.
        pressure: factor of S, at the nodes that carry a pressure.
        dtype: precision in which the vectors are kept.
    """
    ports = tuple(
        k
        for k, port in enumerate(model.ports)
        if isinstance(port, AbstractTractionPort) and port.depends_on_flow
    )
    area = np.zeros((len(ports), model.n_nodes, 3))
    for k, faces in enumerate(model.port_faces[i] for i in ports):
        area[k] = np.asarray(face_load(area_vectors(model.x, faces), faces, model.n_nodes)).T
    area[:, ~np.any(yielding, axis=1)] = 0.0
    nodes = np.flatnonzero(np.any(area, axis=(0, 2)))
    if not len(nodes):
        return None
    yielded, wet = yielding * area, np.flatnonzero(np.asarray(model.in_fluid))
    # S is symmetric: of the gradient G and the divergence D, which differs from −Gᵀ by its
    # stabilisation, the mean
    pairs = list(enumerate(zip(blocks.G, blocks.D, strict=True)))
    g = 0.5 * np.stack([sum((G.T @ v[:, i] - D @ v[:, i]) for i, (G, D) in pairs) for v in yielded])
    g = g[:, wet]
    s = np.stack([nested_solve_once(pressure, column) for column in g])
    free = np.einsum("kni,lni->kl", area, yielded)
    return PortCoupling(
        ports,
        jnp.asarray(nodes, jnp.int32),
        jnp.asarray(np.moveaxis(area[:, nodes], 2, 1), dtype),
        jnp.asarray(s, dtype),
        jnp.asarray(_conductance(free, 0.5 * (g @ s.T + s @ g.T)), dtype),
        *jnp.zeros((2, len(ports), len(ports)), dtype),
    )


def _conductance(
    free: Float[np.ndarray, "ports ports"], held: Float[np.ndarray, "ports ports"]
) -> Float[np.ndarray, "ports ports"]:
    """The difference of two symmetric matrices, with eigenvalues above round-off."""
    scale = np.sqrt(np.where(np.diag(free) > 0.0, np.diag(free), 1.0))
    values, directions = np.linalg.eigh((free - held) / np.outer(scale, scale))
    positive = directions * np.maximum(values, _ROUND_OFF) @ directions.T
    return positive * np.outer(scale, scale)


def with_resistance(
    known: PortCoupling, Z: Float[Array, " all_ports"], inverse_diagonal: Float[Array, "3 nodes"]
) -> PortCoupling:
    """The same with other resistances.

    Args:
        known: vectors of the ports.
        Z: derivative of the pressure of all ports of the model by their flow [dyn·s/cm⁵]; a
            negative one counts as zero.
        inverse_diagonal: Λ⁻¹ [s/g].
    """
    Z = jnp.maximum(Z[np.array(known.port)].astype(known.area.dtype), 0.0)
    eye = jnp.eye(len(Z), dtype=Z.dtype)

    def coupled(flow: Float[Array, "ports ports"]) -> Float[Array, "ports ports"]:
        """(Z⁻¹ + flow)⁻¹, for a Z of zero too."""
        return jnp.linalg.solve(eye + Z[:, None] * flow, Z[:, None] * eye)

    at = inverse_diagonal[:, known.nodes]
    flow = jnp.einsum("kin,in,lin->kl", known.area, at, known.area, precision=Precision.HIGHEST)
    matrices = coupled(flow), coupled(known.conductance)
    return eqx.tree_at(lambda k: (k.of_velocity, k.of_pressure), known, matrices)


def _port_loads(
    known: PortCoupling, matrix: Float[Array, "ports ports"], u: Float[Array, "3 open"]
) -> Float[Array, "3 open"]:
    """A matrix aᵀ u at the nodes of the ports."""
    flow = jnp.einsum("kin,in->k", known.area, u, precision=Precision.HIGHEST)
    P = jnp.matmul(matrix, flow, precision=Precision.HIGHEST)
    return jnp.einsum("k,kin->in", P, known.area, precision=Precision.HIGHEST)


def resisted_velocity(
    known: PortCoupling, inverse_diagonal: Float[Array, "3 nodes"], u: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """Velocity under given forces and the resistance of the ports, from that without resistance.

    Args:
        known: the ports, with their resistances.
        inverse_diagonal: Λ⁻¹ [s/g].
        u: velocity without resistance [cm/s].
    """
    at = inverse_diagonal[:, known.nodes]
    load = _port_loads(known, known.of_velocity, u[:, known.nodes])
    return u.at[:, known.nodes].add(-at * load)


def resisted_velocity_transposed(
    known: PortCoupling, inverse_diagonal: Float[Array, "3 nodes"], r: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """Apply the transpose of `resisted_velocity`."""
    at = inverse_diagonal[:, known.nodes]
    load = _port_loads(known, known.of_velocity.T, at * r[:, known.nodes])
    return r.at[:, known.nodes].add(-load)


def resisted_pressure(
    known: PortCoupling, p: Float[Array, " wet"], r: Float[Array, " wet"]
) -> Float[Array, " wet"]:
    """Pressure under given sources and the resistance of the ports, from that without resistance.

    Args:
        known: the ports, with their resistances.
        p: S⁻¹ r, pressure without resistance [dyn/cm²].
        r: residual of continuity [cm³/s].
    """
    at_ports = jnp.matmul(known.pressure, r, precision=Precision.HIGHEST)
    P = jnp.matmul(known.of_pressure, at_ports, precision=Precision.HIGHEST)
    return p + jnp.matmul(P, known.pressure, precision=Precision.HIGHEST)
