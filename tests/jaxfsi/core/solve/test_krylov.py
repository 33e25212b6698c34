"""Flexible GMRES against dense solutions and in its corner cases."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.solve.krylov import fgmres

N = 40


def _system() -> tuple[jnp.ndarray, jnp.ndarray]:
    rng = np.random.default_rng(3)
    A = np.eye(N) + 0.4 * rng.standard_normal((N, N)) / np.sqrt(N)
    return jnp.asarray(A), jnp.asarray(rng.standard_normal(N))


@functools.partial(jax.jit, static_argnames="max_iterations")
def solve(A, b, M=None, *, tolerance=1e-14, max_iterations=N):
    M = jnp.eye(len(b)) if M is None else M
    return fgmres(
        lambda v: A @ v, b, lambda v: M @ v, tolerance=tolerance, max_iterations=max_iterations
    )


@pytest.mark.parametrize("tolerance", [1e-3, 1e-8, 1e-12])
def test_residual_reported_is_the_true_one_and_below_the_tolerance(tolerance):
    A, b = _system()
    solution = solve(A, b, tolerance=tolerance)
    true = float(jnp.linalg.norm(b - A @ solution.x))
    assert true <= 1.01 * tolerance + 1e-14
    # Both are norms of the same vector, computed with a basis orthogonal to round-off.
    assert abs(true - float(solution.residual)) <= 1e-13 + 1e-6 * true
    assert 0 < int(solution.n_iterations) < N


def test_solution_is_that_of_a_dense_solver():
    A, b = _system()
    # A condition number of about ten leaves a digit of the tolerance.
    np.testing.assert_allclose(solve(A, b).x, jnp.linalg.solve(A, b), rtol=1e-11, atol=1e-12)


def test_residual_is_the_least_over_the_krylov_space():
    A, b = _system()
    k = 5
    powers = np.stack([np.linalg.matrix_power(A, i) @ b for i in range(k)], axis=1)
    y = np.linalg.lstsq(A @ powers, b, rcond=None)[0]
    least = np.linalg.norm(b - A @ powers @ y)
    found = solve(A, b, tolerance=0.0, max_iterations=k)
    # The basis of powers has a condition number of about 1e4.
    assert float(found.residual) == pytest.approx(least, rel=1e-9)
    assert int(found.n_iterations) == k


def test_zero_right_hand_side_gives_zero_without_an_iteration():
    A, b = _system()
    solution = solve(A, 0.0 * b, tolerance=0.0)
    assert int(solution.n_iterations) == 0
    assert not np.any(solution.x)


def test_exact_preconditioner_needs_one_iteration():
    A, b = _system()
    solution = solve(A, b, jnp.linalg.inv(A), tolerance=1e-10)
    assert int(solution.n_iterations) == 1
    np.testing.assert_allclose(solution.x, jnp.linalg.solve(A, b), rtol=1e-11, atol=1e-12)


def test_iterating_beyond_exact_convergence_is_harmless():
    # Two distinct eigenvalues: the space is exhausted after two iterations, 40 are forced.
    D = jnp.where(jnp.arange(N) < N // 2, 1.0, 3.0)
    b = _system()[1]
    solution = solve(jnp.diag(D), b, tolerance=-1.0)
    assert int(solution.n_iterations) == N
    np.testing.assert_allclose(solution.x, b / D, rtol=1e-12)


def test_preconditioner_may_change_from_iteration_to_iteration():
    A, b = _system()

    def unsteady(v):
        return v.astype(jnp.float32).astype(jnp.float64) * (1.5 + jnp.sin(1e3 * v[0]))

    solution = fgmres(lambda v: A @ v, b, unsteady, tolerance=1e-11, max_iterations=N)
    # Single precision and a changing factor in the preconditioner leave the solution exact.
    np.testing.assert_allclose(solution.x, jnp.linalg.solve(A, b), rtol=1e-9, atol=1e-10)


def test_not_a_number_ends_at_once():
    A, b = _system()
    solution = solve(A, b.at[3].set(jnp.nan))
    assert int(solution.n_iterations) == 0
    assert np.isnan(solution.residual)


def test_batch_equals_loop():
    A, b = _system()
    scales = jnp.asarray([0.5, 1.0, 2.0])

    def scaled(scale):
        return solve(scale * A + jnp.eye(N), b, tolerance=1e-12).x

    # Lanes that are done wait; the arithmetic differs by the order of sums only.
    np.testing.assert_allclose(
        jax.vmap(scaled)(scales), jnp.stack([scaled(s) for s in scales]), rtol=1e-9, atol=1e-11
    )


@pytest.mark.parametrize("length", [0.0, 0.3])
def test_a_guess_is_taken_at_its_best_length_and_what_is_left_is_solved(length):
    A, b = _system()
    exact = jnp.linalg.solve(A, b)
    guess = length * (exact + 0.1 * jnp.ones(N))
    image = A @ guess
    share = float(image @ b) / max(float(image @ image), 1e-300)
    rest = solve(A, b - share * image, tolerance=1e-8)
    found = jax.jit(
        lambda guess: fgmres(
            lambda v: A @ v, b, lambda v: v, tolerance=1e-8, max_iterations=N, along=guess
        )
    )(guess)
    assert int(found.n_iterations) == int(rest.n_iterations)
    assert np.allclose(found.x, share * guess + rest.x, rtol=0.0, atol=1e-12)
    assert float(jnp.linalg.norm(b - A @ found.x)) == pytest.approx(float(found.residual), rel=1e-5)


def test_an_exact_guess_needs_no_iteration():
    A, b = _system()
    found = fgmres(
        lambda v: A @ v,
        b,
        lambda v: v,
        tolerance=1e-10,
        max_iterations=N,
        along=-3.0 * jnp.linalg.solve(A, b),
    )
    assert int(found.n_iterations) == 0
    assert np.allclose(A @ found.x, b, atol=1e-12)
