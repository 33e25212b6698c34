"""Small linear systems inside compiled programs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped.elimination import (
    PANEL,
    schur_complement,
    solve_definite,
    solve_small,
    solve_with_log_det,
    square_root,
)


def definite(seed: int, n: int, batch: tuple[int, ...] = ()) -> np.ndarray:
    """Symmetric matrices with eigenvalues from 1 to 1e6, as those of the diagnosis have."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(*batch, n, n)))[0]
    values = np.logspace(0.0, 6.0, n)
    return (basis * values) @ basis.swapaxes(-1, -2)


# the last matrix has fewer rows than a panel, others end within one or at its edge
@pytest.mark.parametrize(
    ("n", "count"), [(30, 2 * PANEL), (29, 2 * PANEL + 3), (6, 6), (6, 0), (90, 62)]
)
def test_what_is_left_of_a_matrix_matches_numpy(n, count):
    A = definite(n, n)
    left, log_det = schur_complement(jnp.asarray(A), count)
    lead, side = A[:count, :count], A[:count, count:]
    exact = A[count:, count:] - side.T @ np.linalg.solve(lead, side)
    # round-off times the condition number
    np.testing.assert_allclose(left, exact, rtol=1e-10, atol=1e-10 * np.abs(A).max())
    assert float(log_det) == pytest.approx(np.linalg.slogdet(lead)[1], rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("largest", [1.0, 1e3, 1e10])
def test_a_root_squared_is_the_matrix(largest):
    basis = np.linalg.qr(np.random.default_rng(3).normal(size=(13, 13)))[0]
    values = np.append(np.ones(4), np.geomspace(1.0, largest, 9))
    root = np.asarray(square_root(jnp.asarray((basis * values) @ basis.T)))
    # round-off times the condition number of the root
    exact = (basis * np.sqrt(values)) @ basis.T
    np.testing.assert_allclose(root, exact, atol=1e-15 * max(largest, 100.0))
    assert np.array_equal(root, root.T)


def test_solution_and_determinant_match_numpy():
    A = definite(1, 15)
    skew = np.triu(np.random.default_rng(2).normal(size=(15, 15)), 1)
    A, B = A + skew - skew.T, np.random.default_rng(3).normal(size=(15, 4))
    X, log_det = solve_with_log_det(jnp.asarray(A), jnp.asarray(B))
    np.testing.assert_allclose(X, np.linalg.solve(A, B), rtol=1e-9, atol=1e-12)
    assert float(log_det) == pytest.approx(np.linalg.slogdet(A)[1], rel=1e-12)
    np.testing.assert_array_equal(solve_definite(jnp.asarray(A), jnp.asarray(B)), X)


def test_batch_of_eliminations_equals_the_loop_and_jit():
    A = jnp.asarray(definite(4, 20, (3,)))
    both = jax.jit(jax.vmap(lambda one: schur_complement(one, 11)))(A)
    for k in range(3):
        left, log_det = schur_complement(A[k], 11)
        np.testing.assert_allclose(both[0][k], left, rtol=1e-11, atol=1e-9)
        assert float(both[1][k]) == pytest.approx(float(log_det), rel=1e-14)


def test_derivative_of_the_determinant_is_the_inverse():
    A = definite(5, 12)
    slope = jax.grad(lambda A: schur_complement(A, 12)[1])(jnp.asarray(A))
    # d ln|A| = tr(A⁻¹ dA); the function reads one triangle or both, their sum is the same
    found = np.asarray(slope + slope.T) / 2.0
    np.testing.assert_allclose(found, np.linalg.inv(A), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("kind", [float, complex])
def test_small_systems_are_solved_as_by_the_library(kind):
    draw = np.random.default_rng(2)
    A = draw.normal(size=(4, 4, 30)).astype(kind)
    b = draw.normal(size=(4, 30)).astype(kind)
    A[0, 0] = 0.0  # needs a pivot
    if kind is complex:
        A = A + 1j * draw.normal(size=A.shape)
    x = jax.jit(solve_small)(jnp.asarray(A), jnp.asarray(b))
    expected = np.linalg.solve(np.moveaxis(A, 2, 0), b.T[..., None])[..., 0].T
    np.testing.assert_allclose(x, expected, rtol=1e-9, atol=1e-12)
