"""Derivative of the solution of a step.

The derivative is that of the equations F(y, θ) = 0 (implicit function theorem)::

    ∂F/∂y dy = −∂F/∂θ dθ

whatever the solve took; in reverse mode the transposed system is solved, once a step. Either is
solved by corrections in single precision with the residual in double precision (iterative
refinement, Higham 2002, chapter 12).
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxfsi.core.solve.linear_system import Flat, linearised, scaling_of
from jaxfsi.core.solve.preconditioner import precondition, precondition_transposed
from jaxfsi.core.step.equations import Step, Unknowns, relinearised, residual
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.stepper import Stepper

DERIVATIVE_SHARE, DERIVATIVE_TOLERANCES = 0.1, (1e-6, 1e-4)
"""Relative residual of the systems that give derivatives: its share of the tolerance of a step, and
its range. With 1e-4 a gradient through twenty steps of the elastic tube is exact to 8e-5; with 1e-5
it is to 1e-5 and takes four iterations more a step."""

LEAST_REFINEMENT = 5e-6
"""Furthest that one correction of such a system is asked to reduce its residual: below, single
precision takes twice the iterations; what is left takes a second, short correction."""

MOST_REFINEMENTS = 6
"""Corrections of such a system at most."""


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
    scaling = scaling_of(model, stepper)
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
