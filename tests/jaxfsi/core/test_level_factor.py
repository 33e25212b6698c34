"""The direct solver for long thin graphs against dense solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from jaxfsi.core.level_factor import breadth_first_levels, level_factor, level_solve


def _graph(rng: np.random.Generator, n: int, reach: int, gaps: tuple[int, ...] = ()) -> np.ndarray:
    """Adjacency of n shuffled nodes, each coupled to those up to `reach` away; cut at the gaps."""
    i, j = np.indices((n, n))
    near = (np.abs(i - j) <= reach) & (rng.random((n, n)) < 0.6)
    near |= np.abs(i - j) == 1
    for gap in gaps:
        near &= (i < gap) == (j < gap)
    near |= near.T
    shuffle = rng.permutation(n)
    return near[np.ix_(shuffle, shuffle)]


def _matrix(rng: np.random.Generator, adjacency: np.ndarray, block: int) -> np.ndarray:
    """Symmetric, diagonally dominant, full blocks where nodes are coupled."""
    dense = np.kron(adjacency, np.ones((block, block))) * rng.standard_normal(
        (len(adjacency) * block,) * 2
    )
    dense = dense + dense.T
    np.fill_diagonal(dense, np.sum(np.abs(dense), axis=1) + 1.0)
    return dense


@pytest.mark.parametrize("block", [1, 3])
@pytest.mark.parametrize("gaps", [(), (13,), (9, 27, 28)], ids=["one", "two", "four"])
def test_factor_solves_like_a_dense_solver(block, gaps):
    rng = np.random.default_rng(7)
    dense = _matrix(rng, _graph(rng, 40, 4, gaps), block)
    factor = level_factor(sp.csr_matrix(dense), block=block)
    b = rng.standard_normal(len(dense))
    # Diagonally dominant: a condition number below 1e3, so round-off stays below 1e-12.
    np.testing.assert_allclose(
        level_solve(factor, jnp.asarray(b)), np.linalg.solve(dense, b), 1e-11
    )


def test_indefinite_matrix_with_a_schur_complement_sign_is_solved():
    rng = np.random.default_rng(8)
    dense = -_matrix(rng, _graph(rng, 25, 3), 1)
    b = rng.standard_normal(25)
    x = level_solve(level_factor(sp.csr_matrix(dense)), jnp.asarray(b))
    np.testing.assert_allclose(x, np.linalg.solve(dense, b), 1e-11)


def test_single_precision_loses_six_digits_not_more():
    rng = np.random.default_rng(9)
    dense = _matrix(rng, _graph(rng, 60, 5), 3)
    b = rng.standard_normal(len(dense))
    x = level_solve(level_factor(sp.csr_matrix(dense), block=3, dtype=np.float32), jnp.asarray(b))
    exact = np.linalg.solve(dense, b)
    assert x.dtype == jnp.float64
    # float32 has 6e-8 of round-off; a sum of about 50 terms a level keeps it below 1e-5.
    assert np.linalg.norm(x - exact) <= 1e-5 * np.linalg.norm(exact)
    assert np.linalg.norm(x - exact) >= 1e-9 * np.linalg.norm(exact)


def test_levels_couple_only_to_their_neighbours_and_cover_all_nodes():
    rng = np.random.default_rng(10)
    adjacency = _graph(rng, 50, 4, (20,))
    level = breadth_first_levels(sp.csr_matrix(adjacency.astype(float)))
    i, j = np.nonzero(adjacency)
    assert np.max(np.abs(level[i] - level[j])) <= 1
    assert len(level) == 50
    assert level.min() == 0


def test_given_start_is_used_where_it_makes_narrower_levels():
    # A lattice with diagonals, drawn out along x: levels from a corner start 1, 3, 5, ... wide.
    nx, ny = 30, 6
    i, j = np.divmod(np.arange(nx * ny), ny)
    adjacency = np.maximum(np.abs(i[:, None] - i), np.abs(j[:, None] - j)) <= 1
    graph = sp.csr_matrix(adjacency.astype(float))
    sizes = [
        np.sum(np.bincount(breadth_first_levels(graph, starts)) ** 2)
        for starts in ((), (np.flatnonzero(i == 0),))
    ]
    assert sizes[1] == nx * ny**2
    assert sizes[1] < sizes[0]


def test_start_that_reaches_one_component_only_is_completed():
    rng = np.random.default_rng(11)
    dense = _matrix(rng, _graph(rng, 30, 2, (10,)), 1)
    b = rng.standard_normal(30)
    factor = level_factor(sp.csr_matrix(dense), starts=[np.array([0])])
    np.testing.assert_allclose(
        level_solve(factor, jnp.asarray(b)), np.linalg.solve(dense, b), 1e-11
    )


def test_empty_matrix_gives_an_empty_solution():
    factor = level_factor(sp.csr_matrix((0, 0)), block=3, dtype=np.float32)
    assert level_solve(factor, jnp.zeros(0)).shape == (0,)


def test_batch_equals_loop_and_jit_equals_eager():
    rng = np.random.default_rng(12)
    dense = _matrix(rng, _graph(rng, 20, 3), 1)
    factor = level_factor(sp.csr_matrix(dense))
    b = jnp.asarray(rng.standard_normal((4, 20)))
    loop = jnp.stack([level_solve(factor, row) for row in b])
    # The same products in another order of summation.
    np.testing.assert_allclose(jax.vmap(level_solve, (None, 0))(factor, b), loop, rtol=1e-13)
    np.testing.assert_allclose(jax.jit(level_solve)(factor, b[0]), loop[0], rtol=1e-13)


def test_singular_matrix_is_refused_with_advice():
    with pytest.raises(ValueError, match="fix enough nodes"):
        level_factor(sp.csr_matrix(np.zeros((3, 3)) + np.diag([1.0, 0.0, 1.0])))
