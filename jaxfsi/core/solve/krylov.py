"""Flexible GMRES for an operator and a preconditioner given as functions.

Right preconditioned, without restart: the basis has room for as many vectors as iterations are
allowed. Gram-Schmidt in its modified form keeps the basis orthogonal to round-off times the factor
by which the residual was reduced: enough for what single precision can reduce it.

Source: Saad 1993, A flexible inner-outer preconditioned GMRES algorithm, algorithm 2.2.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

Vector = Float[Array, " n"]


class KrylovSolution(NamedTuple):
    """Solution of a linear system.

    Attributes:
        x: solution.
        n_iterations: iterations done.
        residual: norm of the residual.
    """

    x: Vector
    n_iterations: Int[Array, ""]
    residual: Float[Array, ""]


def euclidean_norm(v: Vector) -> Float[Array, ""]:
    """Euclidean norm, as a product: XLA on a CPU takes three times as long for the sum."""
    return jnp.sqrt(jnp.vdot(v, v))


class _Arnoldi(NamedTuple):
    k: Int[Array, ""]
    basis: Float[Array, "rows n"]
    directions: Float[Array, "m n"]
    hessenberg: Float[Array, "rows m"]
    residual: Float[Array, ""]


def _least_squares(
    hessenberg: Float[Array, "rows m"], k: Int[Array, ""], norm: Float[Array, ""]
) -> tuple[Float[Array, " m"], Float[Array, ""]]:
    """Coefficients that minimise |norm e₁ − H y| over the first k columns, and that minimum."""
    used = jnp.arange(hessenberg.shape[1]) < k
    H = jnp.where(used, hessenberg, 0.0)
    q, r = jnp.linalg.qr(H)
    right = norm * q[0]
    r = r + jnp.diag(jnp.where(used, 0.0, 1.0))
    y = jnp.where(used, jax.scipy.linalg.solve_triangular(r, jnp.where(used, right, 0.0)), 0.0)
    remainder = jnp.zeros(H.shape[0], H.dtype).at[0].set(norm) - H @ y
    return y, euclidean_norm(remainder)


def fgmres(
    operator: Callable[[Vector], Vector],
    b: Vector,
    preconditioner: Callable[[Vector], Vector],
    *,
    tolerance: Float[Array, ""] | float,
    max_iterations: int,
) -> KrylovSolution:
    """Solve operator(x) = b from x = 0.

    Args:
        operator: linear.
        b: right-hand side.
        preconditioner: approximate inverse of the operator.
        tolerance: the norm of the residual at which to stop.
        max_iterations: at most so many iterations.
    """
    norm = euclidean_norm(b)
    m = max_iterations

    def proceed(s: _Arnoldi):
        return (s.k < m) & (s.residual > tolerance)

    def extend(s: _Arnoldi) -> _Arnoldi:
        z = preconditioner(s.basis[s.k])
        w = operator(z)

        def orthogonalise(i, carry):  # row by row, so that unused rows are not read
            w, h = carry
            overlap = jnp.vdot(s.basis[i], w)
            return w - overlap * s.basis[i], h.at[i].set(overlap)

        w, h = jax.lax.fori_loop(0, s.k + 1, orthogonalise, (w, jnp.zeros(m + 1, b.dtype)))
        rest = euclidean_norm(w)
        basis = s.basis.at[s.k + 1].set(jnp.where(rest > 0.0, w / rest, 0.0))
        hessenberg = s.hessenberg.at[:, s.k].set(h.at[s.k + 1].set(rest))
        _, residual = _least_squares(hessenberg, s.k + 1, norm)
        return _Arnoldi(s.k + 1, basis, s.directions.at[s.k].set(z), hessenberg, residual)

    n = b.shape[0]
    start = _Arnoldi(
        jnp.zeros((), int),
        jnp.zeros((m + 1, n), b.dtype).at[0].set(jnp.where(norm > 0.0, b / norm, 0.0)),
        jnp.zeros((m, n), b.dtype),
        jnp.zeros((m + 1, m), b.dtype),
        norm,
    )
    end = jax.lax.while_loop(proceed, extend, start)
    y, residual = _least_squares(end.hessenberg, end.k, norm)

    def combine(i, x):  # row by row, like above
        return x + y[i] * end.directions[i]

    x = jax.lax.fori_loop(0, end.k, combine, jnp.zeros_like(b))
    return KrylovSolution(x, end.k, residual)
