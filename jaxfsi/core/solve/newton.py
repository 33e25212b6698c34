"""The equations of a step solved, and the derivative of their solution.

Newton's method with GMRES, started from the extrapolated state, on `tangent.StepTangent` in single
precision. One solve is often enough; the residual is evaluated again in double precision,
and a correction follows where it asks for one. In a slit, where steps of 2 ms cross ten elements,
a correction brings the residual down to a few thousandths with the whole derivative, to a fifth
with that of the advecting velocity alone, and to two thirds without either. Residuals are weighted
by the square root of the frozen diagonal, which makes momentum and continuity comparable (both
become the root of a power).

The derivative is that of the equations F(y, θ) = 0 (implicit function theorem)::

    ∂F/∂y dy = −∂F/∂θ dθ

whatever the solve took; in reverse mode the transposed system is solved, once a step. Either is
solved by corrections in single precision with the residual in double precision (iterative
refinement, Higham 2002, chapter 12).
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.solve.blood_tangent import blood_diagonal
from jaxfsi.core.solve.krylov import euclidean_norm, fgmres
from jaxfsi.core.solve.line_search import LEAST_SHARE, NewtonTrial, first_trial, shortened
from jaxfsi.core.solve.preconditioner import precondition, precondition_transposed, with_blood
from jaxfsi.core.solve.tangent import (
    apply_elements,
    apply_elements_transposed,
    step_tangent,
)
from jaxfsi.core.step.equations import Step, Unknowns, relinearised, residual
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import Start
from jaxfsi.core.step.stepper import Stepper
from lumped.parameters import Parameter

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

DERIVATIVE_SHARE, DERIVATIVE_TOLERANCES = 0.1, (1e-6, 1e-4)
"""Relative residual of the systems that give derivatives: its share of the tolerance of a step, and
its range. With 1e-4 a gradient through twenty steps of the elastic tube is exact to 8e-5; with 1e-5
it is to 1e-5 and takes four iterations more a step."""

LEAST_REFINEMENT = 5e-6
"""Furthest that one correction of such a system is asked to reduce its residual: below, single
precision takes twice the iterations; what is left takes a second, short correction."""

MOST_REFINEMENTS = 6
"""Corrections of such a system at most."""

Flat = Float[Array, " unknowns"]


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


class _Scaling(NamedTuple):
    """Weights of flat vectors, and what is solved with them in single precision.

    Attributes:
        weight: of the residuals, in double precision.
        prescribed: rows of prescribed unknowns.
    """

    weight: Flat
    prescribed: Bool[Array, " unknowns"]

    def norm(self, r: Flat) -> Float[Array, ""]:
        """Weighted norm of a residual."""
        return euclidean_norm(self.weight * r)

    def correction(
        self, product, inverse, r: Flat, tolerance, max_iterations: int, along: Flat | None = None
    ):
        """Solve product(x) = r in single precision to a relative tolerance.

        Args:
            product: with the operator.
            inverse: approximate inverse of it, for velocity and pressure.
            r: right-hand side.
            tolerance: relative.
            max_iterations: of GMRES.
            along: see `fgmres`.
        """
        weight = self.weight.astype(jnp.float32)
        n_u = 3 * (weight.size // 4)
        scale = self.norm(r)
        scale = jnp.where(scale > 0.0, scale, 1.0)

        def approximate(v: Flat) -> Flat:
            v = v / weight
            z = inverse(v[:n_u].reshape(3, -1), v[n_u:])
            return jnp.where(self.prescribed, v, ravel_pytree(z)[0])

        b = weight * (r / scale).astype(jnp.float32)
        goal = jnp.asarray(tolerance, jnp.float32) * euclidean_norm(b)
        found = fgmres(
            lambda v: weight * product(v),
            b,
            approximate,
            tolerance=goal,
            max_iterations=max_iterations,
            along=None if along is None else (along / scale).astype(jnp.float32),
        )
        return found.x.astype(r.dtype) * scale, found.n_iterations


def single(tree):
    """The same in single precision."""
    return jax.tree.map(lambda a: a.astype(jnp.float32) if eqx.is_inexact_array(a) else a, tree)


def _scaling(model: Model, stepper: Stepper) -> _Scaling:
    M = stepper.preconditioner
    weight = jnp.concatenate([M.velocity_scale.reshape(-1), M.pressure_scale])
    prescribed = jnp.concatenate([jnp.tile(model.prescribed, 3), ~model.in_fluid])
    return _Scaling(weight, prescribed)


def linearised(y: Unknowns, model: Model, step: Step, stepper: Stepper, kept: Parameter = 1.0):
    """Products with the Jacobian about y, plain and transposed, and a preconditioner for it.

    All in single precision; for `kept` see `blood_tangent`.
    """
    y, model, step, kept = single((y, model, step, jnp.asarray(kept)))
    about = step_tangent(y, model, step, stepper.method, kept)
    _, unravel = ravel_pytree(y)

    def product(flat: Flat) -> Flat:
        return ravel_pytree(apply_elements(about, unravel(flat), model, step, stepper.method))[0]

    def transposed(flat: Flat) -> Flat:
        v = unravel(flat)
        return ravel_pytree(apply_elements_transposed(about, v, model, step, stepper.method))[0]

    diagonal = blood_diagonal(about.blood, model, step.fluid_shape)
    return product, transposed, with_blood(stepper.preconditioner, diagonal, about.blood.A, step.Z)


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


def _forces(origin: Flat, step: Step, scaling: _Scaling, stepper: Stepper) -> Float[Array, ""]:
    """Forces that cancel, on the scale of the residuals.

    Where the extrapolated state is exact already, only their round-off is left to reduce.
    """
    w_d = stepper.method.weights(step.dt)[2]
    strain = step.state.d / w_d / stepper.preconditioner.velocity_scale
    return euclidean_norm(origin / scaling.weight) + euclidean_norm(strain.reshape(-1))


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
    """Solve the equations of a step; see `with_derivative`.

    A flow that accelerates leaves its linear extrapolation behind by about as much as it did in the
    step before, so each linear system is first solved along that correction.

    A first linear system, however exactly it is solved, leaves a share of the residual. Where that
    share is more than the step allows, a second system follows in any case, and the first is solved
    to half of the share only. The share is known from the step before (Eisenstat & Walker 1996,
    SIAM J. Sci. Comput. 17:16, choice 1).

    Where a correction makes the residual grow, a share of it is taken (`line_search`): in a slit
    that snaps shut, a whole one throws the vortex at its mouth far beyond the solution. From then
    on the linear systems are solved as far as the last correction reduced the residual, squared
    (choice 2). Where a tenth is still too much, there are two more attempts. The second starts from
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
    scaling = _scaling(model, stepper)
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
        n_newton = s.n_newton + 1
        floor = round_off / stepper.tolerance
        first = jnp.where(n_newton == 0, jnp.maximum(norm, floor), s.first)
        allowed = stepper.tolerance * first
        # a system solved loosely hides what it leaves below its own goal
        least = jnp.where(trial.loose, 0.5 * s.remainder, 0.0)
        left = jnp.maximum(norm / trial.norm - trial.goal, least)
        remainder = jnp.where((n_newton == 1) & (s.attempt == 0), left, s.remainder)
        asks = norm > jnp.where(trial.loose, LINEAR_SHARE, SLACK) * allowed
        restart = asks & (trial.share <= LEAST_SHARE) & (s.attempt < LAST_ATTEMPT)
        shorten = asks & (norm >= trial.norm) & (s.attempt < LAST_ATTEMPT) & ~restart
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
            return NewtonTrial(trial.y - dy, trial.y, r, norm, jnp.ones(()), goal, goal > tight), n

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


@eqx.filter_custom_jvp
def with_derivative(y: Unknowns, model: Model, step: Step, stepper: Stepper) -> Unknowns:
    """A solution y of the equations of a step, with their derivative by model and step.

    A derivative whose linear system is not solved is NaN: better none than a wrong one.
    """
    del model, step, stepper
    return y


@with_derivative.def_jvp
def _(primals, tangents):
    y, model, step, stepper = primals
    _, model_change, step_change, _ = tangents

    def equations(model: Model, step: Step, y: Unknowns = y):
        return residual(y, model, relinearised(y, model, step, stepper.method), stepper.method)

    r, change = eqx.filter_jvp(equations, (model, step), (model_change, step_change))
    # a row that does not depend on what is changed has no tangent
    change = jax.tree.map(lambda r, dr: jnp.zeros_like(r) if dr is None else dr, r, change)
    b, unravel = ravel_pytree(change)
    scaling = _scaling(model, stepper)
    here = relinearised(y, model, step, stepper.method)
    forward, backward, M = linearised(y, model, here, stepper)

    # outside of the loops, which would evaluate the equations again with every product
    _, along = jax.linearize(lambda y: equations(model, step, y), y)

    def matvec(flat: Flat) -> Flat:
        return ravel_pytree(along(unravel(flat)))[0]

    tolerance = jnp.clip(DERIVATIVE_SHARE * stepper.tolerance, *DERIVATIVE_TOLERANCES)

    def refined(product, correct, b: Flat) -> Flat:
        def proceed(s):
            _, r, k = s
            return (k < MOST_REFINEMENTS) & (scaling.norm(r) > tolerance * scaling.norm(b))

        def refine(s):
            x, r, k = s
            goal = 0.5 * tolerance * scaling.norm(b) / scaling.norm(r)
            x = x + correct(r, jnp.maximum(goal, LEAST_REFINEMENT))
            return x, b - product(x), k + 1

        x, r, _ = jax.lax.while_loop(proceed, refine, (jnp.zeros_like(b), b, 0))
        solved = scaling.norm(r) <= 10.0 * tolerance * scaling.norm(b)
        return jnp.where(solved, x, jnp.nan)

    def correction(product, inverse):
        def correct(r: Flat, goal: Float[Array, ""]) -> Flat:
            return scaling.correction(product, inverse, r, goal, stepper.max_iterations)[0]

        return correct

    def solve(matvec, b: Flat) -> Flat:
        return refined(matvec, correction(forward, partial(precondition, M)), b)

    def transposed_solve(vecmat, b: Flat) -> Flat:
        return refined(vecmat, correction(backward, partial(precondition_transposed, M)), b)

    dy = jax.lax.custom_linear_solve(matvec, b, solve, transposed_solve)
    return y, jax.tree.map(jnp.negative, unravel(dy))
