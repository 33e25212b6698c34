"""Approximate inverse of the wall's tangent: a factor of its vertices, a polynomial on its edges.

With vertices v and edges e of quadratic elements the inverse is block lower triangular::

    z_v = A_vv⁻¹ r_v,   z_e = p(D⁻¹ A_ee) D⁻¹ (r_e − A_ev z_v)

A_vv is factored once, D are the 3 × 3 blocks of the edges, and p is the Chebyshev polynomial for
eigenvalues in [λ/6, λ], λ the largest. Products with A are element by element. GMRES reduces the
residual of the wall of a vessel 1000-fold in 13 iterations with a polynomial of degree 2 (30 with
degree 0, 17 with 1), the same whether inertia or stiffness rules; in 28 at ν = 0.49. The
coupled step of the elastic tube takes 31 iterations with degree 1 as with 2, and 44 with 0.

Source: Saad 2003, Iterative Methods for Sparse Linear Systems, algorithm 12.1.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.wall_balance import WallElements, WallShape, wall_geometry
from jaxfsi.core.solve.nested_factor import NestedFactor, nested_factor, nested_solve
from jaxfsi.core.solve.wall_blocks import edge_blocks
from jaxfsi.core.solve.wall_tangent import (
    BendingTangent,
    WallTangent,
    apply_wall,
    wall_tangent,
)
from jaxfsi.core.step.model import Model

Field = Float[Array, "3 nodes"]

_RANGE = 6.0
"""Largest over smallest eigenvalue that the polynomial is made for."""

_DEGREE = 1
_POWER_STEPS = 15
_MARGIN = 1.1


class WallFactor(eqx.Module):
    """Approximate inverse of the wall's tangent on its free nodes.

    Attributes:
        vertices: factor of the block of the vertices.
        vertex_nodes: these vertices.
        edge_inverse: inverses of the blocks of the edges, in the order of all nodes after the
            vertices; zero where an edge is held.
        largest: largest eigenvalue of D⁻¹ A_ee.
        tangent: of the wall at rest in its reference shape.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
    """

    vertices: NestedFactor
    vertex_nodes: Int[Array, " wall"]
    edge_inverse: Float[Array, "3 3 edges"]
    largest: Float[Array, ""]
    tangent: WallTangent | BendingTangent | None
    element: WallElements
    shape: WallShape


def wall_factor(
    A_vertices: sp.csr_matrix,
    model: Model,
    weights: Weights,
    *,
    dtype: type = np.float32,
) -> WallFactor:
    """Factor the wall of a concrete model.

    Args:
        A_vertices: matrix with three unknowns a node of the model, of which the free vertices of
            the wall are used; see `wall_blocks.vertex_block`.
        model: the model.
        weights: of acceleration, velocity and displacement in the tangent.
        dtype: precision in which the factor is kept.
    """
    prescribed = np.asarray(model.prescribed)
    nodes = wall_vertices(model)
    unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
    vertices = nested_factor(
        A_vertices[unknowns][:, unknowns],
        block=3,
        points=np.asarray(model.x).T[nodes],
        dtype=dtype,
    )
    inverse, tangent = np.zeros((0, 3, 3)), None
    shape = wall_geometry(model.x, model.element)
    if model.wall is not None and model.n_nodes > model.n_vertices:
        inverse = np.linalg.inv(edge_blocks(model, weights))
        inverse[prescribed[model.n_vertices :]] = 0.0
        weights = Weights(*(jnp.asarray(w, float) for w in weights))
        rest = jnp.zeros_like(model.x)
        tangent = eqx.filter_jit(wall_tangent)(
            rest, rest, weights, model.wall, model.element, shape
        )
    factor = WallFactor(
        vertices,
        jnp.asarray(nodes, jnp.int32),
        jnp.asarray(np.moveaxis(inverse, 0, 2)),
        jnp.ones(()),
        tangent,
        model.element,
        shape,
    )
    if len(inverse):
        largest = _MARGIN * _largest(factor, model.n_vertices)
        factor = eqx.tree_at(lambda f: f.largest, factor, largest)
    return jax.tree.map(
        lambda a: jnp.asarray(a, dtype) if eqx.is_inexact_array_like(a) else a, factor
    )


def wall_vertices(model: Model) -> Int[np.ndarray, " wall"]:
    """Free vertices of the wall of a concrete model."""
    free = np.asarray(model.in_solid) & ~np.asarray(model.prescribed)
    return np.flatnonzero(free[: model.n_vertices])


@eqx.filter_jit
def _largest(factor: WallFactor, n_vertices: int) -> Float[Array, ""]:
    """Largest eigenvalue of D⁻¹ A_ee by the power method."""
    n_edges = factor.edge_inverse.shape[2]
    start = jax.random.normal(jax.random.key(0), (3, n_edges))

    def once(_, carry):
        x, _ = carry
        y = _blockwise(factor, _product(factor, jnp.zeros((3, n_vertices)), x)[:, n_vertices:])
        norm = jnp.linalg.norm(y)
        return y / norm, norm / jnp.linalg.norm(x)

    return jax.lax.fori_loop(0, _POWER_STEPS, once, (start, jnp.ones(())))[1]


def _product(
    factor: WallFactor, v: Float[Array, "3 vertices"], w: Float[Array, "3 edges"]
) -> Float[Array, "3 _"]:
    """Tangent times a field given on vertices and edges."""
    assert factor.tangent is not None
    return apply_wall(factor.tangent, jnp.concatenate([v, w], axis=1), factor.element, factor.shape)


def _blockwise(factor: WallFactor, r: Float[Array, "3 edges"]) -> Float[Array, "3 edges"]:
    D = factor.edge_inverse
    return jnp.stack([D[i, 0] * r[0] + D[i, 1] * r[1] + D[i, 2] * r[2] for i in range(3)])


def _chebyshev(
    factor: WallFactor, r: Float[Array, "3 edges"], product: Callable[[Array], Array]
) -> Float[Array, "3 edges"]:
    """Approximate solution of A_ee x = r from x = 0."""
    high, low = factor.largest, factor.largest / _RANGE
    middle, half = (high + low) / 2.0, (high - low) / 2.0
    sigma = middle / half
    rho = 1.0 / sigma
    change = _blockwise(factor, r) / middle
    x = change

    def refine(_, carry):
        x, change, rho = carry
        after = 1.0 / (2.0 * sigma - rho)
        correction = _blockwise(factor, r - product(x))
        change = after * rho * change + 2.0 * after / half * correction
        return x + change, change, after

    return jax.lax.fori_loop(0, _DEGREE, refine, (x, change, rho))[0]


def _vertex_solve(factor: WallFactor, r: Field) -> Field:
    nodes = factor.vertex_nodes
    solved = nested_solve(factor.vertices, r[:, nodes].T.reshape(-1)).reshape(-1, 3).T
    return jnp.zeros_like(r).at[:, nodes].set(solved)


def _edge_solve(factor: WallFactor, r: Float[Array, "3 edges"], n: int) -> Float[Array, "3 edges"]:
    zero = jnp.zeros((3, n), r.dtype)
    return _chebyshev(factor, r, lambda x: _product(factor, zero, x)[:, n:])


def wall_solve(factor: WallFactor, r: Field) -> Field:
    """Apply the approximate inverse; zero at all other nodes."""
    n_edges = factor.edge_inverse.shape[2]
    z_v = _vertex_solve(factor, r)
    if not n_edges:
        return z_v
    n = r.shape[1] - n_edges
    pulled = _product(factor, z_v[:, :n], jnp.zeros((3, n_edges), r.dtype))[:, n:]
    z_e = _edge_solve(factor, r[:, n:] - pulled, n)
    return jnp.concatenate([z_v[:, :n], z_e], axis=1)


def wall_solve_transposed(factor: WallFactor, r: Field) -> Field:
    """Apply the transpose of `wall_solve`."""
    n_edges = factor.edge_inverse.shape[2]
    if not n_edges:
        return _vertex_solve(factor, r)
    n = r.shape[1] - n_edges
    z_e = _edge_solve(factor, r[:, n:], n)
    pulled = _product(factor, jnp.zeros((3, n), r.dtype), z_e)[:, :n]
    rest = jnp.concatenate([r[:, :n] - pulled, jnp.zeros((3, n_edges), r.dtype)], axis=1)
    z_v = _vertex_solve(factor, rest)
    return jnp.concatenate([z_v[:, :n], z_e], axis=1)
