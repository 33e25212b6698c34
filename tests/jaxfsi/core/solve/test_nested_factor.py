"""The direct solver by nested dissection against dense solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from jaxfsi.core.solve.nested_factor import (
    CPU_SIZES,
    nested_factor,
    nested_solve,
    nested_solve_once,
)


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
@pytest.mark.parametrize("gaps", [(), (63,), (9, 27, 28)], ids=["one", "two", "four"])
def test_factor_solves_like_a_dense_solver(block, gaps):
    rng = np.random.default_rng(7)
    dense = _matrix(rng, _graph(rng, 140, 4, gaps), block)
    factor = nested_factor(sp.csr_matrix(dense), block=block)
    b = rng.standard_normal(len(dense))
    # Diagonally dominant: a condition number below 1e3, so round-off stays below 1e-12.
    np.testing.assert_allclose(
        nested_solve(factor, jnp.asarray(b)), np.linalg.solve(dense, b), 1e-11
    )


def test_indefinite_matrix_with_a_schur_complement_sign_is_solved():
    rng = np.random.default_rng(8)
    dense = -_matrix(rng, _graph(rng, 150, 3), 1)
    b = rng.standard_normal(150)
    x = nested_solve(nested_factor(sp.csr_matrix(dense)), jnp.asarray(b))
    np.testing.assert_allclose(x, np.linalg.solve(dense, b), 1e-11)


def test_single_precision_loses_six_digits_not_more():
    rng = np.random.default_rng(9)
    dense = _matrix(rng, _graph(rng, 60, 5), 3)
    b = rng.standard_normal(len(dense))
    x = nested_solve(nested_factor(sp.csr_matrix(dense), block=3, dtype=np.float32), jnp.asarray(b))
    exact = np.linalg.solve(dense, b)
    assert x.dtype == jnp.float64
    # float32 has 6e-8 of round-off; sums of about 100 terms a front keep it below 1e-5.
    assert np.linalg.norm(x - exact) <= 1e-5 * np.linalg.norm(exact)
    assert np.linalg.norm(x - exact) >= 1e-9 * np.linalg.norm(exact)


def test_lattice_is_dissected_with_little_fill():
    # A square lattice of n² nodes: nested dissection fills about 31/4 n² log₂ n numbers of the
    # triangular factor (George 1973); whole fronts and padding cost at most four times that, and
    # the leaves are dense.
    n = 48
    i, j = np.divmod(np.arange(n * n), n)
    near = np.abs(i[:, None] - i) + np.abs(j[:, None] - j) <= 1
    laplace = sp.csr_matrix(np.where(near, -1.0, 0.0) + 6.0 * np.eye(n * n))
    points = np.column_stack([i, j, np.zeros(n * n)]).astype(float)
    b = np.random.default_rng(11).standard_normal(n * n)
    for given in (None, points):
        factor = nested_factor(laplace, points=given)
        kept = sum(batch.inverse.size + batch.coupling.size for batch in factor.batches)
        assert kept <= 4 * 31 / 4 * n**2 * np.log2(n) + CPU_SIZES.leaf * n**2
        # A condition number below 10: nothing but round-off.
        np.testing.assert_allclose(
            laplace @ np.asarray(nested_solve(factor, jnp.asarray(b))), b, atol=1e-12
        )


def test_separators_part_their_halves():
    rng = np.random.default_rng(10)
    adjacency = sp.csr_matrix(_graph(rng, 200, 6, (80,)).astype(float))
    factor = nested_factor(adjacency + 40.0 * sp.eye(200))
    own = np.concatenate([np.asarray(batch.own).ravel() for batch in factor.batches])
    assert sorted(own[own < 200]) == list(range(200))  # each unknown in one front


def test_empty_matrix_gives_an_empty_solution():
    factor = nested_factor(sp.csr_matrix((0, 0)), block=3, dtype=np.float32)
    assert nested_solve(factor, jnp.zeros(0)).shape == (0,)


def test_batch_equals_loop_and_jit_equals_eager():
    rng = np.random.default_rng(12)
    dense = _matrix(rng, _graph(rng, 150, 3), 1)
    factor = nested_factor(sp.csr_matrix(dense))
    b = jnp.asarray(rng.standard_normal((4, 150)))
    loop = jnp.stack([nested_solve(factor, row) for row in b])
    # The same products in another order of summation.
    np.testing.assert_allclose(jax.vmap(nested_solve, (None, 0))(factor, b), loop, rtol=1e-13)
    np.testing.assert_allclose(jax.jit(nested_solve)(factor, b[0]), loop[0], rtol=1e-13)
    np.testing.assert_allclose(nested_solve_once(factor, np.asarray(b[0])), loop[0], rtol=1e-12)


def test_singular_matrix_is_refused_with_advice():
    with pytest.raises(ValueError, match="fix enough nodes"):
        nested_factor(sp.csr_matrix(np.zeros((3, 3)) + np.diag([1.0, 0.0, 1.0])))
