"""Small linear systems by Gaussian elimination inside compiled programs, without LAPACK.

Three ways, each where it is the fastest (2 cores, jaxlib 0.10):

`solve_small` unrolls elimination with partial pivoting, matrix indices first: a batch of 3 × 3
complex systems over frequencies and patients is a hundred times faster than LAPACK, which spends
about a microsecond a call. From 15 unknowns on the unrolled program takes minutes to compile.

`solve_definite` loops over the pivots, without exchanges of rows: stable where the symmetric part
of the matrix is positive definite (up to a diagonal scaling).

`schur_complement` eliminates rows of a symmetric matrix by blocks, three times faster than that
loop for 62 of 90 rows. With A = [[A_11, A_12], [A_21, A_22]],

    S = A_22 − A_21 A_11⁻¹ A_12,      ln|A_11| = Σ ln(pivots).

`square_root` takes an iteration of such eliminations, in place of eigenvalues.

Some versions of jaxlib (0.10 is one) cut a batch of LAPACK's factorisations and eigenvalues into
tasks for XLA's threads and let the thread that asked wait for them: where as many batches are asked
for at once as there are threads, all wait and none works, for ever. Two are enough on two cores.

Source: Golub & Van Loan 2013, Matrix Computations, sections 3.2, 3.4 and 4.2 (block Cholesky);
Higham 2008, Functions of Matrices, section 6.3 (product form of Denman & Beavers' iteration).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Inexact

PANEL = 8
"""Rows of the factor made at a time: the loop over pivots sees these alone."""

ROOT_STEPS = 28
"""Iterations of `square_root`: enough for a ratio of 1e10 between the largest eigenvalue and 1."""


def solve_small(
    A: Inexact[Array, "n n *batch"], b: Inexact[Array, "n *batch"]
) -> Inexact[Array, "n *batch"]:
    """Solve A x = b by Gaussian elimination with partial pivoting; matrix indices come first.

    Args:
        A: matrices, shape (n, n, ...).
        b: right-hand sides, shape (n, ...).

    Returns:
        x, shape (n, ...). A singular matrix gives infinities, as `jnp.linalg.solve` does.
    """
    n = b.shape[0]
    rows = [[A[i, j] for j in range(n)] + [b[i]] for i in range(n)]
    pivots: list[Array] = []
    for k in range(n):
        for i in range(k + 1, n):
            swap = modulus_bound(rows[i][k]) > modulus_bound(rows[k][k])
            upper = [jnp.where(swap, p, q) for p, q in zip(rows[i], rows[k], strict=True)]
            lower = [jnp.where(swap, q, p) for p, q in zip(rows[i], rows[k], strict=True)]
            rows[k], rows[i] = upper, lower
        pivots.append(_reciprocal(rows[k][k]))
        for i in range(k + 1, n):
            factor = rows[i][k] * pivots[k]
            rows[i] = [p - factor * q for p, q in zip(rows[i], rows[k], strict=True)]
    x: list[Array] = [rows[0][n]] * n
    for k in reversed(range(n)):
        known = rows[k][n]
        for j in range(k + 1, n):
            known = known - rows[k][j] * x[j]
        x[k] = known * pivots[k]
    return jnp.stack(x)


def modulus_bound(value: Array) -> Array:
    """|Re| + |Im|, between the modulus and √2 of it, without the square root."""
    if jnp.iscomplexobj(value):
        return jnp.abs(value.real) + jnp.abs(value.imag)
    return jnp.abs(value)


def _reciprocal(value: Array) -> Array:
    """1/value; the plain formula, since circuit matrices are far from overflow."""
    if jnp.iscomplexobj(value):
        scale = 1.0 / (value.real**2 + value.imag**2)
        return jax.lax.complex(value.real * scale, -value.imag * scale)
    return 1.0 / value


def solve_definite(A: Float[Array, "n n"], B: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """X with A X = B.

    Args:
        A: matrix with a positive definite symmetric part.
        B: right-hand sides.
    """
    return solve_with_log_det(A, B)[0]


def solve_with_log_det(
    A: Float[Array, "n n"], B: Float[Array, "n m"]
) -> tuple[Float[Array, "n m"], Float[Array, ""]]:
    """X with A X = B by Gauss-Jordan elimination, and ln|A|.

    Args:
        A: matrix with a positive definite symmetric part.
        B: right-hand sides.
    """
    n = A.shape[0]

    def step(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        M, log_det = state
        row = M[k] / M[k, k]
        eliminated = (M - M[:, k][:, None] * row[None, :]).at[k].set(row)
        return eliminated, log_det + jnp.log(M[k, k])

    start = jnp.concatenate([A, B], axis=1), jnp.zeros(())
    M, log_det = jax.lax.fori_loop(0, n, step, start)
    return M[:, n:], log_det


def square_root(A: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Symmetric root of a symmetric matrix whose eigenvalues lie between 1 and 1e10.

    Args:
        A: the matrix.

    Returns:
        X with X X = A.
    """
    eye = jnp.eye(A.shape[0])

    def step(_: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        X, M = state
        inverse = solve_definite(M, eye)
        inverse = 0.5 * (inverse + inverse.T)
        X = 0.5 * X @ (eye + inverse)
        return 0.5 * (X + X.T), 0.5 * eye + 0.25 * (M + inverse)

    return jax.lax.fori_loop(0, ROOT_STEPS, step, (A, A))[0]


def schur_complement(
    A: Float[Array, "n n"], count: int
) -> tuple[Float[Array, "r r"], Float[Array, ""]]:
    """Schur complement of a symmetric matrix after elimination of its leading rows and columns.

    With A_11 = UᵀU and V = U⁻ᵀ A_12 what is left is A_22 − VᵀV; rows of [U, V] are made by blocks.

    Args:
        A: symmetric matrix whose leading block A_11 is positive definite.
        count: rows of that block (static).

    Returns:
        S, and ln|A_11|.
    """
    log_det, U = jnp.zeros(()), jnp.zeros((0, A.shape[0]))
    for first in range(0, count, PANEL):
        p = min(PANEL, count - first)
        rows = A[first : first + p, first:] - U[:, :p].T @ U
        both = _cholesky_rows(jnp.concatenate([rows[:, :p], jnp.eye(p)], axis=1))
        log_det = log_det + 2.0 * jnp.sum(jnp.log(jnp.diagonal(both)))
        U = jnp.concatenate([U, both[:, p:] @ rows])[:, p:]
    return A[count:, count:] - U.T @ U, log_det


def _cholesky_rows(rows: Float[Array, "p n"]) -> Float[Array, "p n"]:
    """[U, U⁻ᵀB] from [A, B], where UᵀU = A; entries below the diagonal of U are undefined."""
    p = rows.shape[0]
    place = jnp.arange(p)

    def step(k: Array, rows: Array) -> Array:
        row = rows[k] / jnp.sqrt(rows[k, k])
        below = jnp.where(place > k, row[:p], 0.0)
        return (rows - below[:, None] * row[None, :]).at[k].set(row)

    return jax.lax.fori_loop(0, p, step, rows)
