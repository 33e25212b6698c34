"""A share of a correction of Newton's method, where the whole one makes the residual grow.

A residual that is quadratic along the exact correction is, at the share s of it::

    r(s) = (1 − s) r₀ + s² q

q, with what the linear system left, is known from the residual at one share, and the s that makes
|r(s)| smallest is tried next.
Source: Dennis & Schnabel 1996, Numerical Methods for Unconstrained Optimization and Nonlinear
Equations, section 6.3, with this model in place of a cubic in |r|².
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxfsi.core.solve.krylov import Vector

LEAST_SHARE = 0.1
"""A share that is small: where it, or a smaller one, leaves more than `LEAST_FALL` of the residual,
the iteration is at a fold of the equations, and further corrections hardly change anything."""

LEAST_FALL = 0.9
"""See `LEAST_SHARE`."""

_NOT_FINITE = 0.25
"""What is taken of a share at which the residual is not finite."""

_SHARES = tuple(np.geomspace(0.04, 0.7, 32))
"""What may be taken of a share that was too large."""


class NewtonTrial(NamedTuple):
    """An iterate, and the correction that led to it.

    Attributes:
        y: the iterate.
        base: the one before the correction.
        r: residual there.
        norm: its weighted norm; infinite where there was no correction.
        share: which share of the correction was taken.
        goal: relative tolerance of the linear system that gave the correction.
        loose: whether a further system was to follow in any case.
    """

    y: Vector
    base: Vector
    r: Vector
    norm: Float[Array, ""]
    share: Float[Array, ""]
    goal: Float[Array, ""]
    loose: Bool[Array, ""]


def first_trial(y: Vector) -> NewtonTrial:
    """An iterate that no correction led to."""
    one = jnp.ones(())
    return NewtonTrial(y, y, jnp.zeros_like(y), jnp.inf * one, one, 0.0 * one, jnp.asarray(False))


def shortened(trial: NewtonTrial, r: Vector, weight: Vector) -> NewtonTrial:
    """A trial with a smaller share of the same correction.

    Args:
        trial: the one before.
        r: its residual.
        weight: of the residuals in their norm.
    """
    before, after = weight * trial.r, weight * r
    q = (after - (1.0 - trial.share) * before) / trial.share**2
    s = trial.share * jnp.asarray(_SHARES)
    linear, square = 1.0 - s, s**2
    size = linear**2 * jnp.vdot(before, before) + square**2 * jnp.vdot(q, q)
    size += 2.0 * linear * square * jnp.vdot(before, q)
    best = s[jnp.argmin(size)]
    share = jnp.where(jnp.all(jnp.isfinite(size)), best, _NOT_FINITE * trial.share)
    y = trial.base + (share / trial.share) * (trial.y - trial.base)
    return trial._replace(y=y, share=share)
