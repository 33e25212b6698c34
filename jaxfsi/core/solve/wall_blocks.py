"""Matrices of the wall at its reference shape on the host, for what is made once.

The element's law is split as its kernels do it: λ up to 2G acts in the elements, the rest on the
volume averaged round each vertex, whose matrix is Σ_v κ_v b_v b_vᵀ with b_v = ∫ N_v ∇·N dV and
κ_v = Σ k V/4 / (Σ V/4)².
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.assembly import (
    MASS,
    HostGeometry,
    assembled_vector,
    host_geometry,
    isotropic_stiffness,
)
from jaxfsi.core.elements.bending import BendingElement
from jaxfsi.core.elements.quadratic import EDGES, QuadraticElement
from jaxfsi.core.elements.wall import AbstractWallElement, Weights
from jaxfsi.core.elements.wedge import wedge_geometry
from jaxfsi.core.laws.materials import LOCAL_LAME_RATIO
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wedge_solid import element_matrices, wedge_tangent
from jaxfsi.core.step.model import Model


class _Elements(NamedTuple):
    tets: Int[np.ndarray, "tets 4"]
    shape: HostGeometry
    lam: Float[np.ndarray, " tets"]
    G: Float[np.ndarray, " tets"]
    mass: Float[np.ndarray, " tets"]
    spread: Float[np.ndarray, " nodes"]  # κ_v


def _per_tet(value: float | Array, n: int) -> Float[np.ndarray, " tets"]:
    return np.broadcast_to(np.asarray(value, float), (n,))


def _elements(model: Model, weights: Weights) -> _Elements:
    wall, element = _of_tets(model)
    tets = np.asarray(element.tets).T
    shape = host_geometry(np.asarray(model.x).T, tets)
    n = len(tets)
    w_a, w_u, w_d = (np.asarray(w, float) for w in weights)
    lam, G = (w_d * _per_tet(m, n) for m in wall.material.moduli)
    spread = np.zeros(model.n_nodes)
    if isinstance(element, QuadraticElement):
        kept = np.minimum(lam, LOCAL_LAME_RATIO * G)
        corner, quarter = tets.ravel(), np.repeat(shape.volume / 4.0, 4)
        share = np.bincount(corner, quarter, model.n_nodes)
        excess = np.bincount(corner, np.repeat(lam - kept, 4) * quarter, model.n_nodes)
        spread = excess / np.where(share > 0.0, share, 1.0) ** 2
        lam = kept
    G = G + w_u * _per_tet(wall.damping, n)
    mass = w_a * _per_tet(wall.rho_s, n) * shape.volume
    return _Elements(tets, shape, lam, G, mass, spread)


def _of_tets(model: Model) -> tuple[Wall, AbstractWallElement]:
    """Wall and elements of what is made of tetrahedra."""
    assert model.wall is not None
    if isinstance(model.element, BendingElement):
        return model.element.in_rest(model.wall), model.element.rest
    return model.wall, model.element


def vertex_block(model: Model, weights: Weights) -> sp.csr_matrix:
    """Matrix of the wall's vertices, three unknowns a node of the model."""
    tets = _tet_vertices(model, weights)
    if not isinstance(model.element, BendingElement):
        return tets
    assert model.wall is not None
    element, rest = model.element, jnp.zeros_like(model.x)
    shape = wedge_geometry(model.x, element.wedges)
    weights = Weights(*(jnp.asarray(w, float) for w in weights))
    tangent = eqx.filter_jit(wedge_tangent)(
        rest, rest, weights, element.in_wedges(model.wall), element.wedges, shape
    )
    values = np.asarray(eqx.filter_jit(element_matrices)(tangent))
    nodes = np.asarray(element.wedges.nodes).T
    unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 18)
    rows, columns = np.repeat(unknowns, 18, axis=1), np.tile(unknowns, (1, 18))
    size = (3 * model.n_nodes,) * 2
    return (tets + sp.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), size)).tocsr()


def _tet_vertices(model: Model, weights: Weights) -> sp.csr_matrix:
    e = _elements(model, weights)
    values = isotropic_stiffness(e.shape, e.lam, e.G)
    for i in range(3):
        values[:, :, i, :, i] += e.mass[:, None, None] * MASS
    matrix = assembled_vector(e.tets, values, model.n_nodes)
    if not np.any(e.spread):
        return matrix
    slope = (e.shape.grad * e.shape.volume[:, None, None] / 4.0).reshape(-1, 12)
    columns = (3 * e.tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.repeat(e.tets, 12, axis=1), np.tile(columns, (1, 4))
    shape = (model.n_nodes, 3 * model.n_nodes)
    b = sp.csr_matrix((np.tile(slope, (1, 4)).ravel(), (rows.ravel(), columns.ravel())), shape)
    return (matrix + b.T @ sp.diags(e.spread) @ b).tocsr()


def edge_blocks(model: Model, weights: Weights) -> Float[np.ndarray, "edges 3 3"]:
    """Blocks of the edges' unknowns on the diagonal of the matrix.

    With the function 4 N_a N_b of an edge and ∫ N_a N_b = V/20 (V/10 for a = b).
    """
    element = _of_tets(model)[1] if model.wall is not None else model.element
    if not isinstance(element, QuadraticElement) or model.n_nodes == model.n_vertices:
        return np.zeros((0, 3, 3))
    e = _elements(model, weights)
    index = np.asarray(element.edges).T - model.n_vertices
    n_edges = model.n_nodes - model.n_vertices
    grad, V = e.shape
    blocks = np.zeros((n_edges, 3, 3))
    keys, gradients = [], []
    for k, (a, b) in enumerate(EDGES):
        ga, gb = grad[:, a], grad[:, b]
        T = np.einsum("ei,ej->eij", ga, ga) + np.einsum("ei,ej->eij", gb, gb)
        cross = np.einsum("ei,ej->eij", ga, gb)
        T = 16.0 * V[:, None, None] * (T / 10.0 + (cross + np.swapaxes(cross, 1, 2)) / 20.0)
        own = e.G * np.trace(T, axis1=1, axis2=2) + e.mass * 8.0 / 105.0
        values = (e.lam + e.G)[:, None, None] * T + own[:, None, None] * np.eye(3)
        np.add.at(blocks, index[:, k], values)
        for v in range(4):
            weight = 0.2 * V[:, None] * ((1 + (v == a)) * gb + (1 + (v == b)) * ga)
            keys.append(e.tets[:, v] * n_edges + index[:, k])
            gradients.append(weight)
    pair, place = np.unique(np.concatenate(keys), return_inverse=True)
    total = np.concatenate(gradients)
    c = np.stack([np.bincount(place, total[:, i]) for i in range(3)], axis=1)
    vertex, edge = np.divmod(pair, n_edges)
    values = e.spread[vertex][:, None, None] * np.einsum("pi,pj->pij", c, c)
    np.add.at(blocks, edge, values)
    blocks[~np.any(blocks, axis=(1, 2))] = np.eye(3)  # the held one that no element has
    return blocks
