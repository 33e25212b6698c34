"""Matrices of the wall at its reference shape on the host, for what is made once.

A prestress takes part in them: with it a coupled step of a patient whose wall bends takes 33
iterations, without it 40.

The element's law is split as its kernels do it: λ up to 2G acts in the elements, the rest on the
volume averaged round each vertex, whose matrix is Σ_v κ_v b_v b_vᵀ with b_v = ∫ N_v ∇·N dV and
κ_v = Σ k V/4 / (Σ V/4)².

The block of the vertices is what a factor is made of, and has the stencil of linear elements: there
a part of the rest acts in the elements. With averages, its factor on a patient's wall at ν = 0.49
has 1.8 times the numbers, and the coupled step takes 20 iterations where it takes 21.
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
from jaxfsi.core.elements.bending import BendingElement, BendingPrestress
from jaxfsi.core.elements.quadratic import EDGES, FAR, NEAR, QuadraticElement
from jaxfsi.core.elements.wall import AbstractWallElement, Weights
from jaxfsi.core.elements.wedge import WedgeElement, WedgePrestress, wedge_geometry
from jaxfsi.core.laws.materials import LOCAL_LAME_RATIO, LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wedge_solid import element_matrices, wedge_tangent
from jaxfsi.core.step.model import Model
from lumped.device import quick_jit

_COARSE = 0.4
"""Part of λ beyond 2G that acts in linear elements where the true one acts on averages: they lock,
so that with all of it there are more iterations, as with less than a third."""


class _Elements(NamedTuple):
    tets: Int[np.ndarray, "tets 4"]
    shape: HostGeometry
    lam: Float[np.ndarray, " tets"]
    G: Float[np.ndarray, " tets"]
    mass: Float[np.ndarray, " tets"]
    excess: Float[np.ndarray, " tets"]  # of λ over what acts in the elements
    spread: Float[np.ndarray, " nodes"]  # κ_v
    prestress: Float[np.ndarray, "3 3 4 tets"]  # times the weight of the displacement

    @property
    def coarse(self) -> "_Elements":
        """The elements without averages, for linear shape functions."""
        return self._replace(lam=self.lam + _COARSE * self.excess, spread=0.0 * self.spread)


def _per_tet(value: float | Array, n: int) -> Float[np.ndarray, " tets"]:
    return np.broadcast_to(np.asarray(value, float), (n,))


def _elements(model: Model, weights: Weights) -> _Elements:
    wall, element = _of_tets(model)
    tets = np.asarray(element.tets).T
    shape = host_geometry(np.asarray(model.x).T, tets)
    n = len(tets)
    w_a, w_u, w_d = (np.asarray(w, float) for w in weights)
    lam, G = (w_d * _per_tet(m, n) for m in wall.material.moduli)
    spread, more = np.zeros(model.n_nodes), np.zeros(n)
    if isinstance(element, QuadraticElement):
        kept = np.minimum(lam, LOCAL_LAME_RATIO * G)
        corner, quarter = tets.ravel(), np.repeat(shape.volume / 4.0, 4)
        share = np.bincount(corner, quarter, model.n_nodes)
        more = lam - kept
        excess = np.bincount(corner, np.repeat(more, 4) * quarter, model.n_nodes)
        spread = excess / np.where(share > 0.0, share, 1.0) ** 2
        lam = kept
    G = G + w_u * _per_tet(wall.damping, n)
    mass = w_a * _per_tet(wall.rho_s, n) * shape.volume
    S = model.prestress.rest if isinstance(model.prestress, BendingPrestress) else model.prestress
    S = np.zeros((3, 3, 1, n)) if S is None else w_d * np.asarray(S)
    S = np.broadcast_to(S, (3, 3, 4, n))
    return _Elements(tets, shape, lam, G, mass, more, spread, S)


def _of_tets(model: Model) -> tuple[Wall, AbstractWallElement]:
    """Wall and elements of what is made of tetrahedra."""
    assert model.wall is not None
    if isinstance(model.element, BendingElement):
        return model.element.in_rest(model.wall), model.element.rest
    return model.wall, model.element


def vertex_block(model: Model, weights: Weights) -> sp.csr_matrix:
    """Matrix of the wall's vertices with linear tetrahedra, three unknowns a node of the model."""
    tets = _tet_vertices(model, weights)
    if not isinstance(model.element, BendingElement):
        return tets
    assert model.wall is not None
    element, wall = model.element, model.element.in_wedges(model.wall)
    wall = eqx.tree_at(lambda w: w.material, wall, LinearElastic.of_moduli(*wall.material.moduli))
    S = model.prestress and model.prestress.of_wedges
    if S is None:  # zeros, so that one program serves with and without
        n = element.wedges.n
        S = WedgePrestress(jnp.zeros((3, 3, 2, n)), jnp.zeros((3, n)))
    weights = Weights(*(jnp.asarray(w, float) for w in weights))
    values = np.asarray(_wedge_matrices(model.x, weights, wall, element.wedges, S))
    nodes = np.asarray(element.wedges.nodes).T
    unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 18)
    rows, columns = np.repeat(unknowns, 18, axis=1), np.tile(unknowns, (1, 18))
    size = (3 * model.n_nodes,) * 2
    return (tets + sp.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), size)).tocsr()


@quick_jit
def _wedge_matrices(
    x: Float[Array, "3 nodes"],
    weights: Weights,
    wall: Wall,
    wedges: WedgeElement,
    prestress: WedgePrestress,
) -> Float[Array, "wedges 18 18"]:
    """Matrix of each wedge at rest, where every material is one of Hooke's."""
    rest, shape = jnp.zeros_like(x), wedge_geometry(x, wedges)
    return element_matrices(wedge_tangent(rest, rest, weights, wall, wedges, shape, prestress))


def _tet_vertices(model: Model, weights: Weights) -> sp.csr_matrix:
    e = _elements(model, weights).coarse
    values = isotropic_stiffness(e.shape, e.lam, e.G)
    turning = _turning(e.shape, np.mean(e.prestress, axis=2))
    for i in range(3):
        values[:, :, i, :, i] += e.mass[:, None, None] * MASS + turning
    return assembled_vector(e.tets, values, model.n_nodes)


def _turning(
    shape: HostGeometry, S: Float[np.ndarray, "3 3 tets"]
) -> Float[np.ndarray, "tets functions functions"]:
    """∫ ∇N_a · S ∇N_b dV: resistance of a stress to the turning of what it pulls at."""
    pull = np.einsum("eai,ije,e->eaj", shape.grad, S, shape.volume)
    return np.einsum("eaj,ebj->eab", pull, shape.grad)


def mid_edge_block(model: Model, weights: Weights) -> sp.csr_matrix:
    """What mid-edge modes add to `vertex_block`, among themselves and with the vertices.

    Resistance to changes of volume acts in the elements, as in the block of the vertices.
    """
    e = _elements(model, weights).coarse
    nodes, n = _unknowns(model), 3 * model.n_nodes
    values = np.zeros((len(nodes), 10, 3, 10, 3))
    for g in range(4):
        point = HostGeometry(_slopes(e.shape.grad, g), e.shape.volume / 4.0)
        values += isotropic_stiffness(point, e.lam, e.G)
        turning = _turning(point, e.prestress[:, :, g])
        for i in range(3):
            values[:, :, i, :, i] += turning
    for i in range(3):
        values[:, :, i, :, i] += e.mass[:, None, None] * _MASS
    values[:, :4, :, :4] = 0.0
    unknowns = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 30)
    rows, columns = np.repeat(unknowns, 30, axis=1), np.tile(unknowns, (1, 30))
    block = sp.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
    block.eliminate_zeros()
    return block


def edge_blocks(model: Model, weights: Weights) -> Float[np.ndarray, "edges 3 3"]:
    """Blocks of the edges' unknowns on the diagonal of the matrix."""
    if model.wall is None or model.n_nodes == model.n_vertices:
        return np.zeros((0, 3, 3))
    basis = np.eye(10)[None]
    blocks = _diagonal_blocks(model, basis, _elements(model, weights))[model.n_vertices :]
    blocks[~np.any(blocks, axis=(1, 2))] = np.eye(3)  # the held one that no element has
    return blocks


def edge_ends(model: Model) -> Int[np.ndarray, "2 edges"]:
    """Vertices at the ends of each edge that has an unknown."""
    ends = np.zeros((2, model.n_nodes - model.n_vertices), int)
    element = _of_tets(model)[1]
    if isinstance(element, QuadraticElement):
        tets, edges = np.asarray(element.tets), np.asarray(element.edges)
        for k, pair in enumerate(EDGES):
            ends[:, edges[k] - model.n_vertices] = tets[list(pair)]
    return ends


def nodal_blocks(
    A_vertices: sp.csr_matrix, model: Model, weights: Weights
) -> Float[np.ndarray, "nodes 3 3"]:
    """Blocks on the diagonal of the matrix in the basis of nodal shape functions.

    The displacement of the middle of an edge is w + (d_a + d_b)/2: the function of a vertex is N_a
    less half of those of the free edges that meet there.

    Args:
        A_vertices: matrix of the vertices; what it has beyond `vertex_block` of the quadratic
            elements belongs to the vertices in this basis too.
        model: a model with quadratic elements.
        weights: of acceleration, velocity and displacement.
    """
    e, n = _elements(model, weights), model.n_vertices
    element = _of_tets(model)[1]
    assert isinstance(element, QuadraticElement)
    edges = np.asarray(element.edges).T
    free = ~np.asarray(model.prescribed)[edges]
    hierarchical = np.eye(10)[None]
    nodal = np.tile(hierarchical, (len(edges), 1, 1))
    for k, pair in enumerate(EDGES):
        nodal[:, list(pair), 4 + k] = -0.5 * free[:, k, None]
    blocks = _diagonal_blocks(model, nodal, e)
    A = A_vertices[: 3 * n, : 3 * n]
    whole = np.array([[A.diagonal(j - i)[min(i, j) :: 3][:n] for j in range(3)] for i in range(3)])
    blocks[:n] += np.moveaxis(whole, 2, 0) - _diagonal_blocks(model, hierarchical, e.coarse)[:n]
    return blocks


def _diagonal_blocks(
    model: Model, basis: Float[np.ndarray, "_ 10 10"], e: _Elements
) -> Float[np.ndarray, "nodes 3 3"]:
    """Blocks on the diagonal for functions that are combined from the hierarchical ones.

    Args:
        model: a model with quadratic elements.
        basis: weights of the ten hierarchical functions in the ten functions of each element.
        e: its elements.
    """
    nodes = _unknowns(model)
    grad, V = e.shape
    mass = e.mass[:, None] * np.sum(basis @ _MASS * basis, axis=2)
    values = mass[:, :, None, None] * np.eye(3)
    measured = np.zeros((len(V), 4, 10, 3))
    for g in range(4):
        at = np.where(np.arange(4) == g, NEAR, FAR)
        slope = basis @ _slopes(grad, g)
        outer = np.einsum("eni,enj->enij", slope, slope)
        square = np.einsum("enii->en", outer)[:, :, None, None] * np.eye(3)
        moduli = [(V / 4.0 * m)[:, None, None, None] for m in (e.lam + e.G, e.G)]
        values += moduli[0] * outer + moduli[1] * square
        share = V[:, None] / 4.0 * at
        measured += share[:, :, None, None] * slope[:, None]
    blocks = np.zeros((model.n_nodes, 3, 3))
    np.add.at(blocks, nodes, values)
    keys = e.tets[:, :, None] * model.n_nodes + nodes[:, None, :]
    pair, place = np.unique(keys, return_inverse=True)
    b = [np.bincount(place.ravel(), measured[..., i].ravel()) for i in range(3)]
    vertex, node = np.divmod(pair, model.n_nodes)
    np.add.at(blocks, node, np.einsum("p,ip,jp->pij", e.spread[vertex], b, b))
    return blocks


def _unknowns(model: Model) -> Int[np.ndarray, "tets 10"]:
    """Vertices and edges of the quadratic elements."""
    element = _of_tets(model)[1]
    assert isinstance(element, QuadraticElement)
    return np.concatenate([np.asarray(element.tets), np.asarray(element.edges)]).T


def _slopes(grad: Float[np.ndarray, "tets 4 3"], g: int) -> Float[np.ndarray, "tets 10 3"]:
    """Gradients of the ten hierarchical functions at quadrature point g."""
    at = np.where(np.arange(4) == g, NEAR, FAR)
    bows = [4.0 * (at[a] * grad[:, b] + at[b] * grad[:, a]) for a, b in EDGES]
    return np.concatenate([grad, np.stack(bows, axis=1)], axis=1)


def _quadratic_mass() -> Float[np.ndarray, "10 10"]:
    """∫ N_a N_b of the hierarchical functions over an element of unit volume."""
    mass = np.zeros((10, 10))
    mass[:4, :4] = MASS
    for k, edge in enumerate(EDGES):
        mass[4 + k, :4] = mass[:4, 4 + k] = [1 / 15 if v in edge else 1 / 30 for v in range(4)]
        for m, other in enumerate(EDGES):
            mass[4 + k, 4 + m] = (2, 4, 8)[len({*edge} & {*other})] / 105.0
    return mass


_MASS = _quadratic_mass()
