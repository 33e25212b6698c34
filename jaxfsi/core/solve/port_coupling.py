"""What the resistance of ports adds to the preconditioner: matrices of rank one.

A port whose pressure follows its flow, P = P_offset + Z Q with Q = aᵀu, adds Z a aᵀ to the block A
of momentum. Without it GMRES meets eigenvalues Z aᵀD⁻¹a of up to several hundred, one for each
opening, and the Schur complement takes for open what is nearly closed. With the diagonal D of A at
the openings, and y for it in the Schur complement, Woodbury's identity gives::

    (D + a Z aᵀ)⁻¹ = D⁻¹ − D⁻¹ a (Z⁻¹ + aᵀD⁻¹a)⁻¹ aᵀD⁻¹
    S − g (Z⁻¹ + aᵀy a)⁻¹ gᵀ,    g = Gᵀ y a
    its inverse:  S⁻¹ + s (Z⁻¹ + aᵀy a − gᵀs)⁻¹ sᵀ,    s = S⁻¹ g

with a and g as columns, one for each port. On the medium mesh of a patient a system to 1e-3 takes
14, 22 and 26 iterations at three moments of the beat, and 22, 25 and 34 without.

Source: Esmaily-Moghadam, Bazilevs & Marsden 2013, Comput. Mech. 52:1141; Hager 1989, SIAM Rev.
31:221, for Woodbury's identity.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import area_vectors
from jaxfsi.core.ports.port import AbstractTractionPort
from jaxfsi.core.solve.nested_factor import NestedFactor, nested_solve_once
from jaxfsi.core.solve.step_blocks import StepBlocks
from jaxfsi.core.step.model import Model

_LEAST_COMPLIANCE = 1e-3
"""Least eigenvalue of aᵀy a − gᵀs over the largest of aᵀy a, below which it is round-off of S⁻¹."""


class PortCoupling(eqx.Module):
    """The vectors of the ports, and what they are combined with for given resistances.

    Attributes:
        port: which ports these are, by their place in the model (static).
        nodes: the blood's own nodes at these ports.
        area: a of each port at these nodes.
        pressure: s of each port, at the nodes that carry a pressure.
        compliance: aᵀy a − gᵀs.
        in_velocity: (Z⁻¹ + aᵀD⁻¹a)⁻¹; zero until Z is given.
        in_pressure: (Z⁻¹ + aᵀy a − gᵀs)⁻¹, likewise.
    """

    port: tuple[int, ...] = eqx.field(static=True)
    nodes: Int[Array, " open"]
    area: Float[Array, "ports 3 open"]
    pressure: Float[Array, "ports wet"]
    compliance: Float[Array, "ports ports"]
    in_velocity: Float[Array, "ports ports"]
    in_pressure: Float[Array, "ports ports"]


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
    for k, i in enumerate(ports):
        faces = np.asarray(model.port_faces[i])
        third = np.asarray(area_vectors(model.x, model.port_faces[i])).T / 3.0
        for corner in faces:
            np.add.at(area[k], corner, third)
    area[:, ~np.any(yielding, axis=1)] = 0.0
    nodes = np.flatnonzero(np.any(area, axis=(0, 2)))
    if not len(nodes):
        return None
    yielded, wet = yielding * area, np.flatnonzero(np.asarray(model.in_fluid))
    # S is symmetric, and the divergence differs from −Gᵀ by its stabilisation
    pairs = list(enumerate(zip(blocks.G, blocks.D, strict=True)))
    g = 0.5 * np.stack([sum((G.T @ v[:, i] - D @ v[:, i]) for i, (G, D) in pairs) for v in yielded])
    g = g[:, wet]
    s = np.stack([nested_solve_once(pressure, column) for column in g])
    flow = np.einsum("kni,lni->kl", area, yielded)
    compliance, directions = np.linalg.eigh(flow - 0.5 * (g @ s.T + s @ g.T))
    compliance = np.maximum(compliance, _LEAST_COMPLIANCE * np.max(np.diag(flow)))
    return PortCoupling(
        ports,
        jnp.asarray(nodes, jnp.int32),
        jnp.asarray(np.moveaxis(area[:, nodes], 2, 1), dtype),
        jnp.asarray(s, dtype),
        jnp.asarray(directions * compliance @ directions.T, dtype),
        *np.zeros((2, len(ports), len(ports)), dtype),
    )


def with_resistance(
    known: PortCoupling, Z: Float[Array, " all_ports"], inverse_diagonal: Float[Array, "3 nodes"]
) -> PortCoupling:
    """The same with other resistances.

    Args:
        known: of the ports.
        Z: of all ports of the model [dyn·s/cm⁵].
        inverse_diagonal: D⁻¹.
    """
    Z = Z[np.array(known.port)].astype(known.area.dtype)
    eye = jnp.eye(len(Z), dtype=Z.dtype)

    def coupled(flow: Float[Array, "ports ports"]) -> Float[Array, "ports ports"]:
        """(Z⁻¹ + flow)⁻¹, for resistances of zero too."""
        return jnp.linalg.solve(eye + Z[:, None] * flow, Z[:, None] * eye)

    at = inverse_diagonal[:, known.nodes]
    flow = jnp.einsum("kin,in,lin->kl", known.area, at, known.area)
    weights = coupled(flow), coupled(known.compliance)
    return eqx.tree_at(lambda k: (k.in_velocity, k.in_pressure), known, weights)


def closed_velocity(
    known: PortCoupling, inverse_diagonal: Float[Array, "3 nodes"], z: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """Velocity of the blood's own nodes with the resistance of the ports, from that without it.

    Args:
        known: of the ports.
        inverse_diagonal: D⁻¹.
        z: velocity without resistance.
    """
    at = inverse_diagonal[:, known.nodes]
    flow = jnp.einsum("kin,in->k", known.area, z[:, known.nodes])
    load = jnp.einsum("k,kin->in", known.in_velocity @ flow, known.area)
    return z.at[:, known.nodes].add(-at * load)


def closed_velocity_transposed(
    known: PortCoupling, inverse_diagonal: Float[Array, "3 nodes"], r: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """The transpose of `closed_velocity`."""
    at = inverse_diagonal[:, known.nodes]
    flow = jnp.einsum("kin,in->k", known.area, at * r[:, known.nodes])
    load = jnp.einsum("k,kin->in", known.in_velocity.T @ flow, known.area)
    return r.at[:, known.nodes].add(-load)


def closed_pressure(
    known: PortCoupling, z: Float[Array, " wet"], r: Float[Array, " wet"]
) -> Float[Array, " wet"]:
    """Pressure with the resistance of the ports.

    Args:
        known: of the ports.
        z: S⁻¹ r, without resistance.
        r: residual of continuity.
    """
    return z + (known.in_pressure @ (known.pressure @ r)) @ known.pressure
