"""Tissue outside the wall: springs and dashpots on its outer surface.

A traction t = k d + c u resists displacement and velocity in all directions::

    force of node a: ∫ N_a t dA over the reference surface

With the functions N_c of the corners of a triangle and N_e = 4 N_a N_b of its edges, which bow,
∫ N_c² dA = A/6, ∫ N_c N_d dA = A/12, ∫ N_c N_e dA = A/15 with the corner opposite to an edge and
2A/15 with its ends, ∫ N_e² dA = 8A/45 and ∫ N_e N_f dA = 4A/45.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import area_vectors
from jaxfsi.core.step.model import Model


def tissue_force(t: Float[Array, "3 nodes"], model: Model) -> Float[Array, "3 nodes"]:
    """Forces with which a traction acts on the outer surface [dyn].

    Args:
        t: traction at the vertices, and of the bow of each edge [dyn/cm²].
        model: the model.
    """
    faces, edges = model.outer_faces, model.outer_edges
    area = jnp.sqrt(jnp.sum(area_vectors(model.x, faces) ** 2, axis=0))
    corner = [t[:, faces[k]] for k in range(3)]
    everywhere = area * (corner[0] + corner[1] + corner[2])
    whole = [(everywhere + area * value) / 12.0 for value in corner]
    force = jnp.zeros_like(t)
    if edges is not None:
        bow = [t[:, edges[k]] for k in range(3)]
        all_bows = area * (bow[0] + bow[1] + bow[2])
        for k in range(3):
            whole[k] = whole[k] + (2.0 * all_bows - area * bow[k]) / 15.0
            own = (2.0 * everywhere - area * corner[k]) / 15.0
            own = own + 4.0 / 45.0 * (all_bows + area * bow[k])
            force = force.at[:, edges[k]].add(own)
    for k in range(3):
        force = force.at[:, faces[k]].add(whole[k])
    return force
