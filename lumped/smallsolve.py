"""Many small linear systems at once, without a library call for each.

LAPACK spends about a microsecond a call; a batch of 3 × 3 systems over frequencies and patients
is a hundred times faster as plain array arithmetic. The loop over rows is unrolled: sizes are
static and small.
"""

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
    for k in range(n):
        for i in range(k + 1, n):
            swap = jnp.abs(rows[i][k]) > jnp.abs(rows[k][k])
            upper = [jnp.where(swap, p, q) for p, q in zip(rows[i], rows[k], strict=True)]
            lower = [jnp.where(swap, q, p) for p, q in zip(rows[i], rows[k], strict=True)]
            rows[k], rows[i] = upper, lower
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [p - factor * q for p, q in zip(rows[i], rows[k], strict=True)]
    x: list[Array] = [rows[0][n]] * n
    for k in reversed(range(n)):
        known = rows[k][n]
        for j in range(k + 1, n):
            known = known - rows[k][j] * x[j]
        x[k] = known / rows[k][k]
    return jnp.stack(x)
