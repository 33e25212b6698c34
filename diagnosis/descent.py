"""Levenberg-Marquardt on |r(x)|² + |x|² for batches of small fits.

With J the derivative of the prediction, the step solves (I + JᵀJ + λ D) dx = Jᵀr − x, D being the
diagonal of I + JᵀJ. The priors bound the matrix from below, so that elimination is safe where
`calibration.DampedGaussNewton`, made for undetermined fits, needs a QR and an SVD a step: those go
through LAPACK, whose threads fight over the cores in batches of fits this small (25 times slower on
two busy cores). The rule of the damping and the end of the fit are the same as there.

Source: Madsen, Nielsen & Tingleff 2004, Methods for Non-Linear Least Squares Problems, alg. 3.16.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from calibration.damping import FIRST_GROWTH, next_damping
from lumped.elimination import solve_definite

ATOL = 3e-2
"""Distance from the optimum, in posterior sd, that counts as none: evidence to 1e-3."""

MAX_STEPS = 40
"""Steps of a fit."""

START_DAMPING = 1e-3
"""First λ."""


class Descent(NamedTuple):
    """How far a fit has come: it can be continued from here.

    Attributes:
        x: the best point yet.
        cost: ½ (|data − f(x)|² + |x|²) there; infinite before the first step.
        damping: λ of the next step.
        growth: factor by which λ grows where that step is refused.
        done: whether x is the optimum, or no step leads below it.
    """

    x: Float[Array, "*b k"]
    cost: Float[Array, "*b"]
    damping: Float[Array, "*b"]
    growth: Float[Array, "*b"]
    done: Bool[Array, "*b"]


def at_start(start: Float[ArrayLike, "*b k"]) -> Descent:
    """A fit, or many, before the first step."""
    start = jnp.asarray(start)
    one = jnp.ones(start.shape[:-1])
    return Descent(start, jnp.inf * one, START_DAMPING * one, FIRST_GROWTH * one, one < 0.0)


class _State(NamedTuple):
    trial: Float[Array, " k"]
    best: Float[Array, " k"]
    value: Float[Array, "c d"]
    J: Float[Array, "c d k"]
    cost: Float[Array, ""]
    gain: Float[Array, ""]
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def descend(
    slopes: Callable[[Array], tuple[Array, Array]],
    data: Float[Array, "c d"],
    begun: Descent,
    steps: Int[ArrayLike, ""] = MAX_STEPS,
) -> Descent:
    """Go towards the optimum of |data − f(x)|² + |x|², never above the start.

    Args:
        slopes: values of f, and their derivative, at x.
        data: what f should be.
        begun: where the fit stands; f must be finite there.
        steps: evaluations of f, the first of them at the start.
    """

    def step(s: _State) -> _State:
        value, J = slopes(s.trial)
        cost = 0.5 * (jnp.sum((data - value) ** 2) + jnp.sum(s.trial**2))
        sound = jnp.isfinite(cost) & jnp.all(jnp.isfinite(J))
        taken = sound & (cost <= s.cost)
        best, value, J = jax.tree.map(
            lambda new, old: jnp.where(taken, new, old),
            (s.trial, value, J),
            (s.best, s.value, s.J),
        )
        first = s.steps == 0
        ratio = jnp.where(sound & ~first, (s.cost - cost) / jnp.maximum(s.gain, 1e-300), 0.5)
        damping, growth = next_damping(s.damping, s.growth, taken, ratio)
        damping, growth = jax.tree.map(
            lambda new, old: jnp.where(first, old, new), (damping, growth), (s.damping, s.growth)
        )

        A = jnp.eye(best.shape[0]) + jnp.einsum("cdk,cdl->kl", J, J)
        g = jnp.einsum("cdk,cd->k", J, data - value) - best
        scale = jnp.diag(A)
        dx = solve_definite(A + jnp.diag(damping * scale), g[:, None])[:, 0]
        gain = 0.5 * jnp.sum(dx * (g + damping * scale * dx))
        return _State(
            trial=best + dx,
            best=best,
            value=value,
            J=J,
            cost=jnp.where(taken, cost, s.cost),
            gain=gain,
            damping=damping,
            growth=growth,
            steps=s.steps + 1,
            done=(gain <= 0.5 * ATOL**2) | (damping > 1e12) | (first & ~sound),
        )

    state = _State(
        trial=begun.x,
        best=begun.x,
        value=jnp.full(data.shape, jnp.nan),
        J=jnp.full((*data.shape, begun.x.shape[0]), jnp.nan),
        cost=jnp.asarray(jnp.inf),
        gain=jnp.ones(()),
        damping=jnp.asarray(begun.damping),
        growth=jnp.asarray(begun.growth),
        steps=jnp.zeros((), int),
        done=jnp.asarray(False),
    )
    end = jax.lax.while_loop(lambda s: ~s.done & (s.steps < steps), step, state)
    return Descent(end.best, end.cost, end.damping, end.growth, end.done)
