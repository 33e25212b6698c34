"""Linear systems inside compiled loops, by plain elimination.

Gauss-Jordan elimination without exchanges of rows, stable where the symmetric part of the matrix is
positive definite (up to a diagonal scaling). It stands in for LAPACK because batched LAPACK calls
inside a compiled loop can wait forever for XLA's own thread pool on machines with two cores.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def solve_definite(A: Float[Array, "n n"], B: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """X with A X = B.

    Args:
        A: matrix with a positive definite symmetric part.
        B: right-hand sides.
    """
    n = A.shape[0]

    def step(k: Array, M: Array) -> Array:
        row = M[k] / M[k, k]
        return (M - M[:, k][:, None] * row[None, :]).at[k].set(row)

    return jax.lax.fori_loop(0, n, step, jnp.concatenate([A, B], axis=1))[:, n:]
