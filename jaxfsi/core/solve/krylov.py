"""Flexible GMRES for an operator and a preconditioner given as functions.

Right preconditioned, without restart: the basis has room for as many vectors as iterations are
allowed. Gram-Schmidt keeps the basis orthogonal to round-off times the factor by which the residual
was reduced: enough for what single precision can reduce it. On a CPU its modified form reads the
rows in use alone; on an accelerator, where each row would cost two kernels and a wait for the host,
its classical form runs twice over all rows.

The least residual comes without solving for the solution. The unit vector ν that is orthogonal to
the columns of the Hessenberg matrix H gains one entry with each column h of k + 2 numbers::

    min |β e₁ − H y| = β |ν₀|,    ν ← (h_{k+1} ν, −ν·h) / norm

Source: Saad 1993, A flexible inner-outer preconditioned GMRES algorithm, algorithm 2.2; Giraud,
Langou & Rozložník 2005, Comput. Math. Appl. 50:1069, for the classical form run twice.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lumped.device import on_cpu

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
    return jnp.sqrt(jnp.vdot(v, v, precision="highest"))


class _Arnoldi(NamedTuple):
    """Basis so far.

    Attributes:
        k: iterations done; −1 while the multiple of a guess is yet to be found.
        share: that multiple.
        norm: of the residual from which the basis begins.
        basis: orthonormal rows.
        directions: rows whose combination is the solution.
        hessenberg: products of the operator with the directions, in the basis.
        normal: ν.
        residual: norm of what is left.
    """

    k: Int[Array, ""]
    share: Float[Array, ""]
    norm: Float[Array, ""]
    basis: Float[Array, "rows n"]
    directions: Float[Array, "m n"]
    hessenberg: Float[Array, "rows m"]
    normal: Float[Array, " rows"]
    residual: Float[Array, ""]


def _orthogonal(
    w: Vector, basis: Float[Array, "rows n"], k: Int[Array, ""]
) -> tuple[Vector, Float[Array, " rows"]]:
    """What is left of w without its part along the first k rows, and that part's coefficients."""
    h = jnp.zeros(basis.shape[0], w.dtype)
    if not on_cpu():
        for _ in range(2):  # rows that are not in use are 0
            overlap = jnp.matmul(basis, w, precision="highest")
            w, h = w - jnp.matmul(overlap, basis, precision="highest"), h + overlap
        return w, h

    def orthogonalise(i, carry):
        w, h = carry
        overlap = jnp.vdot(basis[i], w)
        return w - overlap * basis[i], h.at[i].set(overlap)

    return jax.lax.fori_loop(0, k, orthogonalise, (w, h))


def _combination(y: Float[Array, " m"], rows: Float[Array, "m n"], k: Int[Array, ""]) -> Vector:
    """Sum of the first k rows times their coefficients, which are 0 beyond."""
    if not on_cpu():
        return jnp.matmul(y, rows, precision="highest")
    return jax.lax.fori_loop(0, k, lambda i, x: x + y[i] * rows[i], jnp.zeros_like(rows[0]))


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


def _started(b: Vector, norm: Float[Array, ""], m: int, *, guessed: bool) -> _Arnoldi:
    """Before the first iteration, or before the multiple of a guess is found."""
    n = b.shape[0]
    return _Arnoldi(
        jnp.zeros((), int) - int(guessed),
        jnp.zeros((), b.dtype),
        norm,
        jnp.zeros((m + 1, n), b.dtype).at[0].set(jnp.where(norm > 0.0, b / norm, 0.0)),
        jnp.zeros((m, n), b.dtype),
        jnp.zeros((m + 1, m), b.dtype),
        jnp.zeros(m + 1, b.dtype).at[0].set(1.0),
        norm,
    )


def fgmres(
    operator: Callable[[Vector], Vector],
    b: Vector,
    preconditioner: Callable[[Vector], Vector],
    *,
    tolerance: Float[Array, ""] | float,
    max_iterations: int,
    along: Vector | None = None,
) -> KrylovSolution:
    """Solve operator(x) = b.

    Args:
        operator: linear.
        b: right-hand side.
        preconditioner: approximate inverse of the operator.
        tolerance: the norm of the residual at which to stop.
        max_iterations: at most so many iterations.
        along: from which multiple of it to start, the one that leaves least; None starts from 0.
    """
    norm = euclidean_norm(b)

    def proceed(s: _Arnoldi):
        return (s.k < max_iterations) & (s.residual > tolerance)

    def beginning(s: _Arnoldi, image: Vector) -> tuple[Array, Vector, Array]:
        square = jnp.vdot(image, image)
        share = jnp.vdot(image, b) / jnp.where(square > 0.0, square, 1.0)
        return share, b - share * image, jnp.zeros_like(s.normal)

    def further(s: _Arnoldi, image: Vector) -> tuple[Array, Vector, Array]:
        return s.share, *_orthogonal(image, s.basis, s.k + 1)

    def extend(s: _Arnoldi) -> _Arnoldi:
        # The guess shares the loop, so that the operator is compiled once.
        begins, k = s.k < 0, jnp.maximum(s.k, 0)
        if along is None:
            z = preconditioner(s.basis[k])
        else:
            z = jax.lax.cond(begins, lambda: along, lambda: preconditioner(s.basis[k]))
        image = operator(z)
        if along is None:
            share, w, h = further(s, image)
        else:
            share, w, h = jax.lax.cond(begins, beginning, further, s, image)
        rest = euclidean_norm(w)
        basis = s.basis.at[s.k + 1].set(jnp.where(rest > 0.0, w / rest, 0.0))
        h = h.at[s.k + 1].set(rest)
        normal = (rest * s.normal).at[s.k + 1].set(-jnp.vdot(s.normal, h))
        normal = jnp.where(begins, s.normal, normal / euclidean_norm(normal))
        norm = jnp.where(begins, rest, s.norm)
        return _Arnoldi(
            s.k + 1,
            share,
            norm,
            basis,
            s.directions.at[k].set(z),
            s.hessenberg.at[:, k].set(jnp.where(begins, 0.0, h)),
            normal,
            norm * jnp.abs(normal[0]),
        )

    start = _started(b, norm, max_iterations, guessed=along is not None)
    end = jax.lax.while_loop(proceed, extend, start)
    n_iterations = jnp.maximum(end.k, 0)
    y, residual = _least_squares(end.hessenberg, n_iterations, end.norm)
    x = _combination(y, end.directions, n_iterations)
    return KrylovSolution(x if along is None else x + end.share * along, n_iterations, residual)
