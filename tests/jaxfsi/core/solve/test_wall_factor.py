"""The approximate inverse of the wall's tangent against dense matrices of a small ring."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from jaxfsi.core.elements.bending import BendingElement
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.solve.krylov import euclidean_norm, fgmres
from jaxfsi.core.solve.wall_blocks import (
    edge_blocks,
    edge_ends,
    mid_edge_block,
    nodal_blocks,
    vertex_block,
)
from jaxfsi.core.solve.wall_factor import (
    wall_factor,
    wall_free,
    wall_product,
    wall_solve,
    wall_solve_transposed,
)
from jaxfsi.core.step.model import build_model
from jaxfsi.meshing import ring

WEIGHTS = Weights(1e3, 1.0, 1e-3)
SHARE = 7.0


@dataclasses.dataclass(frozen=True)
class _Ring:
    """A ring of which one edge between free vertices is held, and matrices of its free unknowns."""

    model: object
    factor: object
    free: np.ndarray
    A: np.ndarray
    C: np.ndarray


def _of_vertices(model):
    """The matrix of the vertices with what is not the elements', such as a support."""
    support = np.repeat(np.arange(model.n_nodes) < model.n_vertices, 3)
    return (vertex_block(model, WEIGHTS) + sp.diags(SHARE * support)).tocsr()


@pytest.fixture(
    scope="module", params=[("quadratic", 0.3), ("quadratic", 0.45), ("bending", 0.3)], ids=str
)
def problem(request):
    kind, nu = request.param
    sizes = {"radius": 0.5, "length": 0.4, "thickness": 0.1, "n_around": 6, "n_axial": 2}
    mesh = ring(n_layers=1, columns=kind == "bending", **sizes)
    mesh = dataclasses.replace(mesh, wedges=mesh.wedges[: len(mesh.wedges) // 2])
    wall = Wall(LinearElastic(3e6, nu), rho_s=1.1, damping=40.0)
    model = build_model(mesh, {}, wall=wall, wall_element=kind)
    n, ends = model.n_vertices, edge_ends(model)
    inner = np.flatnonzero(~np.any(np.asarray(model.prescribed)[ends], axis=0))
    model = eqx.tree_at(lambda m: m.prescribed, model, model.prescribed.at[n + inner[0]].set(True))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("jaxfsi.core.solve.wall_factor._MOST_FACTORED", 0)
        factor = wall_factor(_of_vertices(model), model, WEIGHTS, dtype=np.float64)
    free = np.flatnonzero(wall_free(factor))

    def product(flat):
        v = jnp.zeros_like(model.x).at[:, free].set(flat.reshape(3, -1))
        return wall_product(factor, v)[:, free].reshape(-1)

    A = np.asarray(jax.jit(jax.vmap(product))(jnp.eye(3 * len(free))))
    C = np.eye(model.n_nodes)
    for k in np.flatnonzero(~np.asarray(model.prescribed)[n:]):
        C[n + k, ends[:, k]] = -0.5
    return _Ring(model, factor, free, A, C[np.ix_(free, free)])


def _blocks(matrix, n):
    at = np.arange(n)
    return matrix.reshape(3, n, 3, n)[:, at, :, at]


def test_free_nodes_are_those_that_are_not_prescribed(problem):
    assert np.array_equal(problem.free, np.flatnonzero(~np.asarray(problem.model.prescribed)))


def test_product_is_symmetric_and_positive(problem):
    assert np.allclose(problem.A, problem.A.T, rtol=0.0, atol=1e-12 * np.max(problem.A))
    assert np.linalg.eigvalsh(problem.A)[0] > 0.0


def test_blocks_of_edges_are_those_of_the_product(problem):
    n, model = len(problem.free), problem.model
    found = edge_blocks(model, WEIGHTS)
    expected = _blocks(problem.A, n)[problem.free >= model.n_vertices]
    edges = problem.free[problem.free >= model.n_vertices] - model.n_vertices
    assert np.allclose(found[edges], expected, rtol=1e-10, atol=1e-10 * np.max(expected))


def test_blocks_of_the_nodal_basis_are_those_of_the_product(problem):
    """Vertices among them, with the support that the elements do not have."""
    n, model = len(problem.free), problem.model
    found = nodal_blocks(_of_vertices(model), model, WEIGHTS)[problem.free]
    C = np.kron(np.eye(3), problem.C)
    expected = _blocks(C.T @ problem.A @ C, n)
    assert np.allclose(found, expected, rtol=1e-10, atol=1e-10 * np.max(expected))


def test_vertices_are_the_linear_part_of_the_product_where_nothing_is_averaged(problem):
    """λ = 1.5 G at ν = 0.3; beyond, the factor locks more than the elements and is stiffer."""
    model = problem.model
    vertices = problem.free[problem.free < model.n_vertices]
    n, k = len(problem.free), len(vertices)
    part = problem.A.reshape(3, n, 3, n)[:, :k, :, :k].reshape(3 * k, 3 * k)
    unknowns = (3 * vertices + np.arange(3)[:, None]).ravel()
    coarse = vertex_block(model, WEIGHTS)[unknowns][:, unknowns].toarray() + SHARE * np.eye(3 * k)
    if model.wall.material.nu == 0.3:
        assert np.allclose(coarse, part, rtol=1e-10, atol=1e-10 * np.max(part))
    else:
        assert np.trace(coarse) == pytest.approx(np.trace(part), rel=0.5)
        assert not np.allclose(coarse, part, rtol=0.01, atol=0.01 * np.max(part))


def test_whole_block_is_the_product_where_nothing_is_averaged(problem):
    """λ = 1.5 G at ν = 0.3; beyond, a part of the averages acts in the elements."""
    model, n = problem.model, len(problem.free)
    whole = _of_vertices(model) + mid_edge_block(model, WEIGHTS)
    unknowns = (3 * problem.free + np.arange(3)[:, None]).ravel()
    found = whole[unknowns][:, unknowns].toarray()
    if model.wall.material.nu == 0.3:
        assert np.allclose(found, problem.A, rtol=1e-10, atol=1e-10 * np.max(problem.A))
    else:
        assert np.linalg.eigvalsh(found)[0] > 0.0
        assert np.trace(found) == pytest.approx(np.trace(problem.A), rel=0.5)
    assert found.shape == (3 * n, 3 * n)


def test_wall_that_bends_is_factored_with_its_mid_edge_modes(problem):
    """At ν = 0.3 its factor is the inverse of the matrix."""
    model = problem.model
    if not isinstance(model.element, BendingElement):
        pytest.skip("a wall of other elements has a smoother")
    factor = wall_factor(_of_vertices(model), model, WEIGHTS, dtype=np.float64)
    assert factor.smoother is None
    assert np.array_equal(factor.nodes, problem.free)
    r = np.random.default_rng(3).standard_normal(model.x.shape)
    r[:, np.asarray(model.prescribed)] = 0.0
    x = np.asarray(wall_solve(factor, jnp.asarray(r)))
    assert np.allclose(problem.A @ x[:, problem.free].ravel(), r[:, problem.free].ravel())
    assert not np.any(x[:, np.asarray(model.prescribed)])


def test_transposed_solution_is_the_transpose(problem):
    rng = np.random.default_rng(0)
    r, s = (jnp.asarray(rng.standard_normal(problem.model.x.shape)) for _ in range(2))
    there = jnp.vdot(s, wall_solve(problem.factor, r))
    back = jnp.vdot(wall_solve_transposed(problem.factor, s), r)
    assert float(there) == pytest.approx(float(back), rel=1e-10)


def test_held_nodes_have_no_solution(problem):
    r = jnp.ones_like(problem.model.x)
    held = np.asarray(problem.model.prescribed)
    for solve in (wall_solve, wall_solve_transposed):
        assert not np.any(np.asarray(solve(problem.factor, r))[:, held])


@pytest.mark.slow  # compiles product and inverse inside of GMRES
def test_a_few_iterations_solve_the_wall(problem):
    shape = problem.model.x.shape
    free = wall_free(problem.factor)
    b = jnp.where(free, jnp.asarray(np.random.default_rng(1).standard_normal(shape)), 0.0)
    found = jax.jit(
        lambda b: fgmres(
            lambda v: jnp.where(free, wall_product(problem.factor, v.reshape(shape)), 0.0).ravel(),
            b,
            lambda v: wall_solve(problem.factor, v.reshape(shape)).ravel(),
            tolerance=1e-3 * euclidean_norm(b),
            max_iterations=40,
        )
    )(b.ravel())
    assert int(found.n_iterations) <= 18  # 15 at ν = 0.3, 17 at 0.45; 8 where it bends
