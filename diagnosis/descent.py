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
from jaxtyping import Array, Bool, Float, Int

from calibration.damping import FIRST_GROWTH, next_damping
from lumped.elimination import solve_definite

ATOL = 3e-3
"""Distance from the optimum, in posterior sd, that counts as none: evidence to 1e-5."""

MAX_STEPS = 40
"""Steps of a fit."""

START_DAMPING = 1e-3
"""First λ."""


class Optimum(NamedTuple):
    """Where a fit ended.

    Attributes:
        x: the optimum.
        value: f there.
        J: its derivative there.
    """

    x: Float[Array, " k"]
    value: Float[Array, "c d"]
    J: Float[Array, "c d k"]


class _State(NamedTuple):
    trial: Float[Array, " k"]
    best: Optimum
    cost: Float[Array, ""]
    gain: Float[Array, ""]
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def descend(
    slopes: Callable[[Array], tuple[Array, Array]],
    data: Float[Array, "c d"],
    start: Float[Array, " k"],
) -> Optimum:
    """The optimum of |data − f(x)|² + |x|², never above the start.

    Args:
        slopes: values of f, and their derivative, at x.
        data: what f should be.
        start: first x; f must be finite there.
    """

    def step(s: _State) -> _State:
        value, J = slopes(s.trial)
        cost = 0.5 * (jnp.sum((data - value) ** 2) + jnp.sum(s.trial**2))
        sound = jnp.isfinite(cost) & jnp.all(jnp.isfinite(J))
        taken = sound & (cost <= s.cost)
        best = jax.tree.map(
            lambda new, old: jnp.where(taken, new, old), Optimum(s.trial, value, J), s.best
        )
        first = s.steps == 0
        ratio = jnp.where(sound & ~first, (s.cost - cost) / jnp.maximum(s.gain, 1e-300), 0.5)
        following, growth = next_damping(s.damping, s.growth, taken, ratio)
        damping = jnp.where(first, s.damping, following)

        A = jnp.eye(start.shape[0]) + jnp.einsum("cdk,cdl->kl", best.J, best.J)
        g = jnp.einsum("cdk,cd->k", best.J, data - best.value) - best.x
        scale = jnp.diag(A)
        dx = solve_definite(A + jnp.diag(damping * scale), g[:, None])[:, 0]
        gain = 0.5 * jnp.sum(dx * (g + damping * scale * dx))
        return _State(
            trial=best.x + dx,
            best=best,
            cost=jnp.where(taken, cost, s.cost),
            gain=gain,
            damping=damping,
            growth=growth,
            steps=s.steps + 1,
            done=(gain <= 0.5 * ATOL**2) | (damping > 1e12) | (first & ~sound),
        )

    nothing = jnp.full(data.shape, jnp.nan)
    none = Optimum(start, nothing, jnp.full((*data.shape, start.shape[0]), jnp.nan))
    state = _State(
        trial=start,
        best=none,
        cost=jnp.asarray(jnp.inf),
        gain=jnp.ones(()),
        damping=jnp.asarray(START_DAMPING),
        growth=jnp.asarray(FIRST_GROWTH),
        steps=jnp.zeros((), int),
        done=jnp.asarray(False),
    )
    return jax.lax.while_loop(lambda s: ~s.done & (s.steps < MAX_STEPS), step, state).best
