"""Wall shear stress on the interface, smooth on unstructured meshes.

Around every node i of the wetted wall the velocity is fitted by a quadratic through the value at
the node, over the blood's nodes up to two edges away (least squares)::

    u(x) ≈ u_i + G y + ½ H : y⊗y,   y = x − x_i,      τ = (I − n⊗n) μ (G + Gᵀ) n

n is the area-weighted normal of the node's faces, out of the blood: τ is what the blood feels; the
wall feels −τ, along the flow. The recovered gradient is of second order up to the wall, while the
gradient of the linear elements is constant on each and belongs to their middle.

Measured on Poiseuille flow (tube, 20 / 36 edges round it, nodes moved at random by a quarter of an
edge; error of |τ| in per cent, mean and largest):

| recovery | 20, moved | 36, even | 36, moved |
|---|---|---|---|
| gradient of the elements, faces averaged by area | −10.6, 18.8 | −6.3, 7.4 | −6.6, 12.0 |
| residual of the blood's equations, lumped surface mass | 30.7, 239 | 0.2, 4.2 | 3.5, 42 |
| the same, consistent surface mass | 60.6, 498 | 0.1, 8.6 | 5.2, 99 |
| patches of element gradients (superconvergent patch recovery) | 2.6, 11.7 | 0.5, 0.8 | −0.3, 4.9 |
| this one | 3.0, 8.3 | 0.4, 0.7 | −0.3, 3.9 |

Source: Zhang & Naga 2005 (SIAM J Sci Comput 26:1192), polynomial preserving recovery; Zienkiewicz
& Zhu 1992 for the patches compared.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import area_vectors
from jaxfsi.core.laws.fluid import Blood, shear_rate
from jaxfsi.mesh import INTERFACE, Mesh, Region

_RIDGE = 1e-9
"""Added to the normal equations, whose diagonal is one: patches that do not fix every coefficient
(a lumen of a few elements) get the smallest ones."""

_DIAGONAL = 1e-30


class WallPatches(eqx.Module):
    """Nodes of the interface with the nodes around them; fixed with the mesh.

    Attributes:
        faces: triangles of the interface, pointing out of the blood.
        nodes: nodes of the interface.
        around: nodes that each fit uses; padded with the node itself, which adds nothing.
    """

    faces: Int[Array, "3 faces"]
    nodes: Int[Array, " wall"]
    around: Int[Array, "around wall"]


def wall_patches(mesh: Mesh, *, rings: int = 2) -> WallPatches:
    """Find the nodes around each node of the interface.

    Args:
        mesh: a mesh with blood and an interface.
        rings: how many edges away nodes may lie.

    Raises:
        ValueError: the mesh has no blood or no interface.
    """
    tets = mesh.tets_of(Region.FLUID)
    if not len(tets) or INTERFACE not in mesh.label_names:
        raise ValueError(
            "there is no wall shear without blood and an interface. Use a mesh that has both."
        )
    faces = mesh.labelled(INTERFACE)
    nodes = np.unique(faces)
    n_nodes = len(mesh.points)
    rows, columns = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    ones = np.ones(len(rows), np.int32)
    near = sp.csr_matrix((ones, (rows, columns)), shape=(n_nodes, n_nodes))
    reach = sp.csr_matrix((np.ones(len(nodes), np.int32), (np.arange(len(nodes)), nodes)),
                          shape=(len(nodes), n_nodes))  # fmt: skip
    for _ in range(rings):
        reach = sp.csr_matrix(reach @ near)
        reach.data[:] = 1
    count = np.diff(reach.indptr)
    around = np.tile(nodes[:, None], (1, int(count.max())))
    place = np.arange(reach.nnz) - np.repeat(reach.indptr[:-1], count)
    around[np.repeat(np.arange(len(nodes)), count), place] = reach.indices
    return WallPatches(jnp.asarray(faces.T), jnp.asarray(nodes), jnp.asarray(around.T))


def wall_normals(x: Float[Array, "3 nodes"], patches: WallPatches) -> Float[Array, "3 wall"]:
    """Unit normals at the nodes of the interface, out of the blood, faces weighted by area."""
    area = area_vectors(x, patches.faces)
    corner = patches.faces.reshape(-1)
    total = jnp.stack([jnp.zeros(x.shape[1]).at[corner].add(jnp.tile(a, 3)) for a in area])
    normal = total[:, patches.nodes]
    return normal / jnp.sqrt(jnp.sum(normal**2, axis=0))


def wall_gradient(
    field: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], patches: WallPatches
) -> Float[Array, "3 3 wall"]:
    """Gradient ∂u_i/∂x_j at the nodes of the interface; exact for quadratic fields.

    Args:
        field: a vector at all nodes.
        x: positions of all nodes [cm].
        patches: see `wall_patches`.
    """
    y = [c[patches.around] - c[patches.nodes] for c in x]
    size = jnp.sqrt(jnp.max(jax.lax.stop_gradient(y[0] ** 2 + y[1] ** 2 + y[2] ** 2), axis=0))
    y = [c / size for c in y]
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    basis = [*y, *(y[i] * y[j] for i, j in pairs)]
    change = [c[patches.around] - c[patches.nodes] for c in field]
    matrix = jnp.stack([jnp.stack([jnp.sum(a * b, axis=0) for b in basis]) for a in basis])
    load = jnp.stack([jnp.stack([jnp.sum(a * c, axis=0) for c in change]) for a in basis])
    scale = jnp.sqrt(jnp.stack([matrix[k, k] for k in range(len(basis))]) + _DIAGONAL)
    matrix = jnp.moveaxis(matrix / (scale[:, None] * scale[None]), -1, 0)
    matrix = matrix + _RIDGE * jnp.eye(len(basis))
    fit = jnp.linalg.solve(matrix, jnp.moveaxis(load / scale[:, None], -1, 0))
    slope = jnp.moveaxis(fit, 0, -1)[:3] / (scale[:3, None] * size)
    return jnp.swapaxes(slope, 0, 1)


def wall_shear(
    u: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], blood: Blood, patches: WallPatches
) -> Float[Array, "3 wall"]:
    """Shear stress of the blood on the wall at the nodes of the interface [dyn/cm²].

    Differentiable in the velocity, the positions and the blood.

    Args:
        u: velocity [cm/s].
        x: positions of all nodes at that time [cm].
        blood: what the blood is like.
        patches: see `wall_patches`.

    Returns:
        The traction along the wall, in the direction of the flow.
    """
    G = wall_gradient(u, x, patches)
    n = wall_normals(x, patches)
    rate = G + jnp.swapaxes(G, 0, 1)
    traction = blood.viscosity(shear_rate(G)) * jnp.stack(
        [rate[i, 0] * n[0] + rate[i, 1] * n[1] + rate[i, 2] * n[2] for i in range(3)]
    )
    along = traction[0] * n[0] + traction[1] * n[1] + traction[2] * n[2]
    return along * n - traction
