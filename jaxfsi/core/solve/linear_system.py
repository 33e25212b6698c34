"""A linear system of a step, in single precision: operator, preconditioner and weights."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from jaxfsi.core.solve.blood_tangent import blood_diagonal
from jaxfsi.core.solve.krylov import euclidean_norm, fgmres
from jaxfsi.core.solve.preconditioner import with_blood
from jaxfsi.core.solve.tangent import (
    apply_elements,
    apply_elements_transposed,
    step_tangent,
)
from jaxfsi.core.step.equations import Step, Unknowns
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.stepper import Stepper
from lumped.parameters import Parameter

Flat = Float[Array, " unknowns"]


class Scaling(NamedTuple):
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


def scaling_of(model: Model, stepper: Stepper) -> Scaling:
    """Weights of the systems of a stepper."""
    M = stepper.preconditioner
    weight = jnp.concatenate([M.velocity_scale.reshape(-1), M.pressure_scale])
    prescribed = jnp.concatenate([jnp.tile(model.prescribed, 3), ~model.in_fluid])
    return Scaling(weight, prescribed)


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
