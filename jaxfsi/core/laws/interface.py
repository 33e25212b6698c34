"""Pressure on the mid-edge modes of the wall at the interface, and the volume that they open.

The blood's elements are linear and end at the flat faces between the vertices of the wall. On the
hierarchical mid-edge modes of the wall, with the function N_e = 4 N_a N_b of an edge, the pressure
does work, and the volume that they open fills with blood::

    momentum of edge e: − ∫ p N_e n dA,      continuity of vertex c: + ∫ N_c N_e u_e·n dA

with n out of the blood. Without it the pressure acts at the vertices alone, as forces that dent a
wall whose elements are as long as it is thick by 5 % of what the vessel widens.

On a triangle ∫ N_c N_e dA is A/15 at the corner opposite to the edge and 2A/15 at its ends.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import area_vectors


class MidEdgeInterface(eqx.Module):
    """Faces of the interface with mid-edge modes.

    Attributes:
        faces: corners, pointing out of the blood.
        edges: unknowns of the edges opposite to the corners.
    """

    faces: Int[Array, "3 faces"]
    edges: Int[Array, "3 faces"]


def mid_edge_load(
    p: Float[Array, " nodes"], x: Float[Array, "3 nodes"], interface: MidEdgeInterface
) -> Float[Array, "3 nodes"]:
    """Forces of a pressure on the edges [dyn].

    Args:
        p: pressure at the vertices [dyn/cm²].
        x: node positions [cm].
        interface: the faces.
    """
    area = area_vectors(x, interface.faces)
    corner = p[interface.faces]
    whole = jnp.sum(corner, axis=0)
    load = jnp.zeros_like(x)
    for k in range(3):
        load = load.at[:, interface.edges[k]].add((2.0 * whole - corner[k]) / 15.0 * area)
    return load


def mid_edge_flux(
    u: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], interface: MidEdgeInterface
) -> Float[Array, " nodes"]:
    """Volume flow into the mid-edge modes, by vertex [cm³/s]: `mid_edge_load` transposed.

    Args:
        u: velocity [cm/s].
        x: node positions [cm].
        interface: the faces.
    """
    area = area_vectors(x, interface.faces)
    through = jnp.stack([jnp.sum(u[:, interface.edges[k]] * area, axis=0) for k in range(3)]) / 15.0
    whole = 2.0 * jnp.sum(through, axis=0)
    flow = jnp.zeros(x.shape[1], x.dtype)
    for k in range(3):
        flow = flow.at[interface.faces[k]].add(whole - through[k])
    return flow
