"""Many small linear systems at once, without a library call for each.

LAPACK spends about a microsecond a call; a batch of 3 × 3 systems over frequencies and patients
is a hundred times faster as plain array arithmetic. The loop over rows is unrolled: sizes are
static and small.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Inexact


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
