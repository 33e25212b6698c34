"""Motion of the fluid's mesh: the interface's displacement spread over the blood.

Each component is harmonic with a coefficient 1/V, so that small elements are stiff::

    ∇·((1/V) ∇d_mesh) = 0 in the blood,  d_mesh = d on the interface,  d_mesh = 0 on the openings

The coefficient belongs to the reference mesh, so that the map from interface to mesh is linear and
its factor is made once.

Source: Stein, Tezduyar & Benney 2003, J. Appl. Mech. 70:58 (Jacobian-based stiffening).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.assembly import assembled, host_geometry, stiffness
from jaxfsi.core.elements.linear import Geometry, added, corners, gradient, scatter
from jaxfsi.core.solve.nested_factor import NestedFactor, nested_factor, nested_solve
from jaxfsi.core.step.model import Model


class MeshMotion(eqx.Module):
    """The map from the interface's displacement to that of the mesh.

    Attributes:
        factor: of the weighted Laplacian on the nodes that move freely.
        free: these nodes.
        shape: reference geometry of the fluid elements with a held node; the weight V/V is 1 and
            stands as `volume`.
        tets: corners of these elements.
        volume: reference volumes of all fluid elements [cm³].
    """

    factor: NestedFactor
    free: Int[Array, " free"]
    shape: Geometry
    tets: Int[Array, "4 near"]
    volume: Float[Array, " tets"]


def mesh_motion(model: Model) -> MeshMotion:
    """Prepare the motion of the mesh of a model with concrete node positions."""
    points, tets = np.asarray(model.x).T, np.asarray(model.fluid_tets).T
    shape = host_geometry(points, tets)
    matrix = assembled(tets, stiffness(shape, 1.0 / shape.volume), len(points))
    free = np.flatnonzero(~np.asarray(model.mesh_prescribed))
    near = np.flatnonzero(np.any(np.asarray(model.mesh_prescribed)[tets], axis=1))
    x, y, z = (tuple(jnp.asarray(shape.grad[near, a, j]) for a in range(4)) for j in range(3))
    return MeshMotion(
        nested_factor(matrix[free][:, free], points=points[free]),
        jnp.asarray(free, jnp.int32),
        Geometry((x, y, z), jnp.ones(len(near))),
        jnp.asarray(tets[near].T, jnp.int32),
        jnp.asarray(shape.volume),
    )


def mesh_displacement(
    motion: MeshMotion, d_interface: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """Displacement of the fluid's nodes [cm].

    Args:
        motion: see `mesh_motion`.
        d_interface: displacement of the held nodes, 0 elsewhere [cm].
    """
    grad, n = motion.shape.grad, d_interface.shape[1]
    residual = []
    for d in d_interface:
        slope = gradient(corners(d, motion.tets), motion.shape)
        flux = tuple(added(grad[j][b] * slope[j] for j in range(3)) for b in range(4))
        residual.append(scatter(flux, motion.tets, n)[motion.free])
    moved = jax.vmap(lambda r: nested_solve(motion.factor, r))(jnp.stack(residual))
    return d_interface.at[:, motion.free].add(-moved)
