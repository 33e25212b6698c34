"""A share of a correction of Newton's method, where the whole one makes the residual grow.

A residual that is quadratic along the correction is, at the share s of it::

    r(s) = (1 − s) r₀ + s² q

q is known from the residual at one share, and the s that makes |r(s)| smallest is tried next.
Source: Dennis & Schnabel 1996, Numerical Methods for Unconstrained Optimization and Nonlinear
Equations, section 6.3, with this model in place of a cubic in |r|².
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

LEAST_SHARE = 0.1
"""Where so small a share, or a smaller one, is needed, the iteration is at a fold of the equations:
further corrections from there hardly change the residual."""

_SHARES = tuple(np.geomspace(0.04, 0.7, 32))
"""What may be taken of a share that was too large."""

Flat = Float[Array, " unknowns"]


class NewtonTrial(NamedTuple):
    """An iterate, and the correction that led to it.

    Attributes:
        y: the iterate.
        base: the one before the correction.
        r: residual there.
        norm: its weighted norm; infinite where there was no correction.
        share: which share of the correction was taken.
        goal: relative tolerance of the linear system that gave the correction.
        loose: whether that was looser than what the step asks for.
    """

    y: Flat
    base: Flat
    r: Flat
    norm: Float[Array, ""]
    share: Float[Array, ""]
    goal: Float[Array, ""]
    loose: Bool[Array, ""]


def first_trial(y: Flat) -> NewtonTrial:
    """An iterate that no correction led to."""
    one = jnp.ones(())
    return NewtonTrial(y, y, jnp.zeros_like(y), jnp.inf * one, one, 0.0 * one, jnp.asarray(False))


def shortened(trial: NewtonTrial, r: Flat, weight: Flat) -> NewtonTrial:
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
    share = s[jnp.argmin(size + 2.0 * linear * square * jnp.vdot(before, q))]
    y = trial.base + (share / trial.share) * (trial.y - trial.base)
    return trial._replace(y=y, share=share)
