"""Matrices of the linearised step with the blood at rest, on the host, for what is made once."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from jaxfsi.core.elements.assembly import (
    MASS,
    HostGeometry,
    assembled,
    assembled_vector,
    isotropic_stiffness,
    stiffness,
)
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.fluid import stabilisation_parameters, viscous_rate_squared
from jaxfsi.core.solve.wall_blocks import edge_blocks, vertex_block
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model


class StepBlocks(NamedTuple):
    """Blocks of the step [A G; D C] in velocity and pressure.

    Attributes:
        A_wall: A at the nodes of the wall, with the blood's share, three velocities a node.
        diagonal: of A; 1 where it has none.
        lumped_mass: of the blood, times the weight of the acceleration.
        G: weak gradient of each direction.
        D: divergence of each direction.
        C: stabilisation of the pressure.
    """

    A_wall: sp.csr_matrix
    diagonal: Float[np.ndarray, "nodes 3"]
    lumped_mass: Float[np.ndarray, " nodes"]
    G: tuple[sp.csr_matrix, ...]
    D: tuple[sp.csr_matrix, ...]
    C: sp.csr_matrix


def step_blocks(
    dt: float, model: Model, method: GeneralizedAlpha, shape: HostGeometry
) -> StepBlocks:
    """Blocks of a model with concrete numbers; the equations are those of `solve.blood_tangent`.

    Args:
        dt: length of a step [s].
        model: the model.
        method: coefficients in time.
        shape: of the blood's elements.
    """
    points = np.asarray(model.x).T
    n_nodes = len(points)
    fluid = np.asarray(model.fluid_tets).T
    w_a, w_u, w_d = (float(w) for w in method.weights(dt))
    rho = float(model.blood.rho_f)
    mu = np.asarray(model.blood.viscosity(jnp.ones(len(fluid))))
    metric = np.einsum("eai,eaj->eij", shape.grad[:, 1:], shape.grad[:, 1:])
    steady = viscous_rate_squared(mu, rho, np.sum(metric**2, axis=(1, 2)))
    trace = np.trace(metric, axis1=1, axis2=2)
    tau, tau_continuity = stabilisation_parameters(
        dt, steady, trace, rho, model.blood.transient_continuity, xp=np
    )
    fluid_moduli = (w_u * tau_continuity, w_u * mu)
    fluid_mass = w_a * rho * shape.volume
    diagonal = _diagonal(fluid, shape, fluid_mass, *fluid_moduli, n_nodes)
    near = np.any(np.asarray(model.in_solid)[fluid], axis=1)
    A_wall = _vector_block(
        fluid[near],
        HostGeometry(shape.grad[near], shape.volume[near]),
        fluid_mass[near],
        fluid_moduli[0][near],
        fluid_moduli[1][near],
        n_nodes,
    )
    if model.wall is not None:
        weights = Weights(w_a, w_u, w_d)
        wall = vertex_block(model, weights)
        A_wall = A_wall + wall
        diagonal = diagonal + wall.diagonal().reshape(-1, 3)
        edges = np.diagonal(edge_blocks(model, weights), axis1=1, axis2=2)
        diagonal[model.n_vertices :] += edges
    quarter = shape.volume / 4.0
    G_block, D_block = [], []
    for i in range(3):
        slope = shape.grad[:, :, i] * quarter[:, None]
        spread = np.repeat(slope[:, :, None], 4, axis=2)  # row: gradient, column: value
        G_block.append(assembled(fluid, -w_u * spread, n_nodes))
        weak = w_u * np.swapaxes(spread, 1, 2) + (w_a * rho * tau)[:, None, None] * spread
        D_block.append(assembled(fluid, weak, n_nodes))
    C = assembled(fluid, stiffness(shape, w_u * tau), n_nodes)
    diagonal = np.where(diagonal > 0.0, diagonal, 1.0)
    lumped = np.bincount(fluid.ravel(), np.repeat(fluid_mass / 4.0, 4), n_nodes)
    return StepBlocks(A_wall, diagonal, lumped, tuple(G_block), tuple(D_block), C)


def _vector_block(tets, shape, mass, lam, G, n_nodes) -> sp.csr_matrix:
    values = isotropic_stiffness(shape, lam, G)
    for i in range(3):
        values[:, :, i, :, i] += mass[:, None, None] * MASS
    return assembled_vector(tets, values, n_nodes)


def _diagonal(tets, shape, mass, lam, G, n_nodes) -> Float[np.ndarray, "nodes 3"]:
    square = shape.grad**2
    values = (lam + G)[:, None, None] * square + (G[:, None] * np.sum(square, axis=2))[..., None]
    values = values * shape.volume[:, None, None] + (mass / 10.0)[:, None, None]
    return np.stack(
        [np.bincount(tets.ravel(), values[:, :, i].ravel(), n_nodes) for i in range(3)],
        axis=1,
        dtype=float,
    )
