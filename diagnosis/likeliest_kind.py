"""Evidence of a hypothesis over what its equations may be, and its fit with the likeliest."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float, Int

from diagnosis.evidence import Posterior, Whitened, log_prior_of_sizes, posterior
from diagnosis.form_columns import KINDS, Freedom

SETTLED = 10.0
"""Fall of the squares |r|² + |x|² that a linear model may promise beyond its point: a one-sided
size stays at zero, and models are curved."""


def in_units_of(width: Float[Array, " k"], linear: Whitened) -> Whitened:
    """A linear model of unknowns in units of other prior standard deviations."""
    return Whitened(linear.e, linear.J * width[None, None])


class LikeliestKind(NamedTuple):
    """A hypothesis with the likeliest kind of equations.

    Attributes:
        at: position of its point.
        after: posterior there, of unknowns in units of their prior standard deviations.
        residual: whitened residuals there.
        misfit: see `hypothesis.Fitted`.
        log_Z: evidence, the mean over the kinds.
        kinds: probabilities of all kinds, of `KINDS`.
    """

    at: Int[Array, ""]
    after: Posterior
    residual: Float[Array, "c d"]
    misfit: Float[Array, ""]
    log_Z: Float[Array, ""]
    kinds: Float[Array, " 3"]


def likeliest_kind(
    points: Float[Array, "t k"],
    linears: Whitened,
    freedoms: Freedom,
    width: Float[Array, " k"],
    pair: Int[Array, " 2"],
    sided: Float[Array, " k"],
) -> LikeliestKind:
    """Evidence of a hypothesis over the kinds of its equations.

    Guessed equations alone would count against a strong effect: the volume of their freedom grows
    with it, though the record shows that the form fits. Exact ones alone would count a bed of
    another structure as an effect. Where a fit has not settled, the linear model promises squares
    that no point has: those of the point itself count.

    Args:
        points: the optimum of exact equations, then posterior means of guessed ones.
        linears: the model about each.
        freedoms: of both kinds of guessed equations.
        width: prior standard deviations of the unknowns in both.
        pair: positions of the effects, −1 for none.
        sided: 1 for unknowns that only exist above zero.
    """
    residuals = jax.vmap(lambda x, linear: linear.e - linear.J @ x)(points, linears)

    def evidence(after: Posterior, misfit: Array, square: Array) -> Array:
        log_Z = after.log_evidence + log_prior_of_sizes(after, pair, sided)
        promised = misfit + square - after.misfit - jnp.sum(after.mean**2)
        log_Z = log_Z - 0.5 * jnp.maximum(promised - SETTLED, 0.0)
        return jnp.where(jnp.isfinite(log_Z), log_Z, -jnp.inf)

    def about(at: Array | int) -> Whitened:
        return jax.tree.map(lambda a: a[at], linears)

    def guessed(freedom: Freedom) -> tuple[Array, Posterior, Array, Array]:
        misfits, squares = freedom.misfits(residuals), jnp.sum((points / width[None]) ** 2, axis=1)
        at = jnp.argmin(jnp.where(jnp.isfinite(misfits), misfits + squares, jnp.inf))
        after = freedom.posterior(in_units_of(width, about(at)), sided)
        return at, after, misfits[at], squares[at]

    exact = (
        jnp.asarray(0), posterior(about(0), None, sided), jnp.sum(residuals[0] ** 2),
        jnp.sum(points[0] ** 2),
    )  # fmt: skip
    ats, afters, misfits, squares = jax.tree.map(
        lambda one, more: jnp.concatenate([one[None], more]),
        exact,
        jax.lax.map(guessed, freedoms),
    )
    log_Z = jax.vmap(evidence)(afters, misfits, squares)
    best = jnp.argmax(log_Z)
    at, after, misfit = jax.tree.map(lambda a: a[best], (ats, afters, misfits))
    total = logsumexp(log_Z)
    kinds = jnp.exp(log_Z - total)
    return LikeliestKind(at, after, residuals[at], misfit, total - jnp.log(len(KINDS)), kinds)
