"""The equations of a step solved.

Newton's method with GMRES, started from the extrapolated state, on `tangent.StepTangent` in single
precision. One solve is often enough; the residual is evaluated again in double precision,
and a correction follows where it asks for one. In a slit, where steps of 2 ms cross ten elements,
a correction brings the residual down to a few thousandths with the whole derivative, to a fifth
with that of the advecting velocity alone, and to two thirds without either. Residuals are weighted
by the square root of the frozen diagonal, which makes momentum and continuity comparable (both
become the root of a power).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.solve.krylov import euclidean_norm
from jaxfsi.core.solve.line_search import (
    LEAST_FALL,
    LEAST_SHARE,
    NewtonTrial,
    first_trial,
    shortened,
)
from jaxfsi.core.solve.linear_system import Flat, Scaling, linearised, scaling_of
from jaxfsi.core.solve.preconditioner import precondition
from jaxfsi.core.step.equations import Step, Unknowns, relinearised, residual
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import Start
from jaxfsi.core.step.stepper import Stepper

LEAST_REDUCTION = 1e-4
"""Smallest relative tolerance requested of a float32 linear solve."""

ROUND_OFF = 1e-14
"""Share of the forces on a node below which their sum cannot be told from zero."""

SLACK = 10.0
"""A nonlinear residual of at most SLACK × tolerance is accepted without linearising again."""

DIVERGED = 2.0
"""A residual of that multiple of the extrapolated state's ends the last attempt and the step."""

LAST_ATTEMPT = 2
"""Number of the last attempt at a step, the first being 0; see `solve_step`."""

LINEAR_SHARE = 0.25
"""Share of the tolerance that the last linear system of a step may leave. What a start along the
last correction leaves is alike from step to step: with half of the tolerance the volume that a
tube holds drifts by 5e-5 of what passes it, with a quarter by 2e-5."""

LOOSEST = 0.1
"""Largest relative tolerance of a linear system."""


class Convergence(NamedTuple):
    """How a solve went.

    Attributes:
        n_gmres: iterations of GMRES in all.
        n_newton: linear systems solved.
        residual: weighted residual at the end over that of the extrapolated state, or over a
            multiple of the round-off of the forces where that is larger.
    """

    n_gmres: Int[Array, ""]
    n_newton: Int[Array, ""]
    residual: Float[Array, ""]


class _Iterate(NamedTuple):
    """State of Newton's method.

    Attributes:
        trial: what is tried next.
        attempt: which of the attempts this is, see `solve_step`.
        hard: whether a correction made the residual grow.
        norm: weighted residual of the last trial.
        first: that of the extrapolated state.
        remainder: see `Start`.
        asks: whether the residual asked for a correction.
        n_newton: corrections so far; -1 before the first residual.
        n_gmres: iterations of GMRES so far.
    """

    trial: NewtonTrial
    attempt: Int[Array, ""]
    hard: Bool[Array, ""]
    norm: Float[Array, ""]
    first: Float[Array, ""]
    remainder: Float[Array, ""]
    asks: Bool[Array, ""]
    n_newton: Int[Array, ""]
    n_gmres: Int[Array, ""]


def _forces(origin: Flat, step: Step, scaling: Scaling, stepper: Stepper) -> Float[Array, ""]:
    """Forces that cancel, on the scale of the residuals.

    Where the extrapolated state is exact already, only their round-off is left to reduce.
    """
    w_d = stepper.method.weights(step.dt)[2]
    strain = step.state.d / w_d / stepper.preconditioner.velocity_scale
    return euclidean_norm(origin / scaling.weight) + euclidean_norm(strain.reshape(-1))


def _judged(
    s: _Iterate,
    norm: Float[Array, ""],
    allowed: Float[Array, ""],
    n_newton: Int[Array, ""],
    stepper: Stepper,
) -> tuple[Float[Array, ""], Bool[Array, ""], Bool[Array, ""], Bool[Array, ""]]:
    """What the residual of a trial says.

    Returns:
        The share of the residual that a first system leaves, whether anything is left to do, and
        whether that is to shorten the correction or to start again.
    """
    trial = s.trial
    # a system solved loosely hides what it leaves below its own goal
    least = jnp.where(trial.loose, 0.5 * s.remainder, 0.0)
    left = jnp.maximum(norm / trial.norm - trial.goal, least)
    whole = (n_newton == 1) & (s.attempt == 0) & (trial.share == 1.0) & jnp.isfinite(norm)
    remainder = jnp.where(whole, left, s.remainder)
    asks = norm > jnp.where(trial.loose, LINEAR_SHARE, SLACK) * allowed
    bad = asks & (norm > SLACK * allowed) & (s.attempt < LAST_ATTEMPT)
    short = trial.share <= LEAST_SHARE
    shorten = bad & ~short & (norm >= trial.norm)
    restart = bad & short & (norm > LEAST_FALL * trial.norm) & (n_newton < stepper.max_systems)
    return remainder, asks, shorten, restart


def _goals(
    norm: Float[Array, ""],
    allowed: Float[Array, ""],
    remainder: Float[Array, ""],
    trial: NewtonTrial,
    begins: Bool[Array, ""],
    hard: Bool[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """What a step asks of a linear system, and the tolerance that it gets; see `solve_step`."""
    tight = jnp.maximum(LINEAR_SHARE * allowed / norm, LEAST_REDUCTION)
    again = begins & (remainder * norm > SLACK * allowed)
    fall = jnp.where(jnp.isinf(trial.norm), 1.0, norm / trial.norm)
    wanted = jnp.where(hard, fall**2, jnp.where(again, 0.5 * remainder, tight))
    return tight, jnp.clip(wanted, tight, jnp.maximum(tight, LOOSEST))


def _starts(guess: Unknowns, model: Model, step: Step) -> Float[Array, "attempts unknowns"]:
    """Where each attempt at a step starts."""
    origin = ravel_pytree(guess)[0]
    u_before = jnp.where(model.prescribed, guess.u, step.state.u)
    return jnp.stack([origin, ravel_pytree((u_before, step.state.p))[0], origin])


def solve_step(
    guess: Unknowns, start: Start, model: Model, step: Step, stepper: Stepper
) -> tuple[Unknowns, Start, Convergence]:
    """Solve the equations of a step; see `solution_derivative`.

    A flow that accelerates leaves its linear extrapolation behind by about as much as it did in the
    step before, so each linear system is first solved along that correction.

    A first linear system, however exactly it is solved, leaves a share of the residual. Where that
    share is more than the step allows, a second system follows in any case, and the first is solved
    to half of the share only. The share is known from the step before (Eisenstat & Walker 1996,
    SIAM J. Sci. Comput. 17:16, choice 1).

    Where a correction makes the residual grow, a share of it is taken (`line_search`): in a slit
    that snaps shut, a whole one throws the vortex at its mouth far beyond the solution. From then
    on the linear systems are solved as far as the last correction reduced the residual, squared
    (choice 2). Where a tenth or less had to be taken and gained little, there are two more
    attempts. The second starts from
    the velocity and pressure of the step before: where a vortex is born, extrapolation doubles what
    is wrong. The third holds the coefficients of each correction, as at a sudden start, where the
    extrapolated strong residual means nothing.

    Args:
        guess: linear extrapolation, by whose residual convergence is judged.
        start: what the last step tells.
        model: the model.
        step: what stays the same.
        stepper: see `prepare`.

    Returns:
        The solution, what it tells the next step, and how the solve went.
    """
    scaling = scaling_of(model, stepper)
    starts, (origin, unravel) = _starts(guess, model, step), ravel_pytree(guess)
    along = jnp.where(scaling.prescribed, 0.0, ravel_pytree((start.u, start.p))[0])
    round_off = ROUND_OFF * _forces(origin, step, scaling, stepper)

    def proceed(s: _Iterate):
        return s.asks & (s.n_newton < stepper.max_systems)

    def evaluate(s: _Iterate) -> _Iterate:
        trial, y = s.trial, unravel(s.trial.y)
        here = relinearised(y, model, step, stepper.method)
        r = ravel_pytree(residual(y, model, here, stepper.method))[0]
        norm = scaling.norm(r)
        norm = jnp.where(jnp.isnan(norm), jnp.inf, norm)  # a wall turned inside out
        n_newton = s.n_newton + 1
        floor = round_off / stepper.tolerance
        first = jnp.where(n_newton == 0, jnp.maximum(norm, floor), s.first)
        allowed = stepper.tolerance * first
        remainder, asks, shorten, restart = _judged(s, norm, allowed, n_newton, stepper)
        attempt = s.attempt + restart.astype(int)
        hard = s.hard | shorten | restart
        asks &= (s.attempt < LAST_ATTEMPT) | (norm <= DIVERGED * first)
        n_newton -= (shorten | restart).astype(int)  # nothing was solved

        def correct():
            tight, goal = _goals(norm, allowed, remainder, trial, n_newton == 0, hard)
            kept = jnp.where(attempt < LAST_ATTEMPT, 1.0, 0.0)
            with jax.named_scope("tangent"):
                product, _, M = linearised(y, model, here, stepper, kept)
            with jax.named_scope("linear_solve"):
                inverse = partial(precondition, M)
                dy, n = scaling.correction(product, inverse, r, goal, stepper.max_iterations, along)
            loose = (goal > tight) & ~hard
            return NewtonTrial(trial.y - dy, trial.y, r, norm, jnp.ones(()), goal, loose), n

        def stay():
            other = first_trial(starts[attempt])
            chosen = jax.lax.cond(shorten, shortened, lambda t, _, __: t, trial, r, scaling.weight)
            return jax.tree.map(partial(jnp.where, restart), other, chosen), jnp.zeros((), int)

        more = asks & ~restart & ~shorten & (n_newton < stepper.max_systems)
        trial, n = jax.lax.cond(more, correct, stay)
        return _Iterate(trial, attempt, hard, norm, first, remainder, asks, n_newton, s.n_gmres + n)

    zero, one, yes = jnp.zeros((), int), jnp.ones(()), jnp.asarray(True)
    begun = first_trial(origin), zero, ~yes, one, one, start.remainder, yes, zero - 1, zero
    end = jax.lax.while_loop(proceed, evaluate, _Iterate(*begun))
    y = unravel(end.trial.y)
    told = Start(y.u - guess.u, y.p - guess.p, end.remainder)
    remainder = end.norm / jnp.where(end.first > 0.0, end.first, 1.0)
    return y, told, Convergence(end.n_gmres, end.n_newton, remainder)
