"""One step in time: solve the coupled equations, then bring state and ports up to date.

Newton's method with GMRES, started from the extrapolated state, on the tangent of `operator`. The
fluid is linear in the unknowns, so that one solve is often enough; the residual is evaluated
again, and a correction follows where it asks for one. Residuals are weighted by the square root
of the frozen diagonal, which makes momentum and continuity comparable (both become the root of a
power).

The derivative of a step is that of its equations (implicit function theorem): one linear solve
with the Jacobian, or with its transpose in reverse mode, whatever the forward solve took.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements import flux, geometry
from jaxfsi.core.equations import Step, Unknowns, begin_step, extrapolated, residual
from jaxfsi.core.generalized_alpha import GeneralizedAlpha, generalized_alpha
from jaxfsi.core.krylov import fgmres
from jaxfsi.core.mesh_motion import MeshMotion, mesh_motion
from jaxfsi.core.model import Model
from jaxfsi.core.operator import (
    WallStencil,
    apply_elements,
    wall_stencil,
)
from jaxfsi.core.ports import BlockPort
from jaxfsi.core.preconditioner import (
    Preconditioner,
    precondition,
    precondition_transposed,
    preconditioner,
)
from jaxfsi.core.state import State
from lumped.views import advance

LEAST_REDUCTION = 1e-4
"""Furthest that one linear solve in single precision is asked to reduce its residual."""


class RESULTS(eqx.Enumeration):
    """How a step ended."""

    successful = ""
    not_converged = (
        "The equations of a step were not solved to the tolerance. Take a smaller dt, or more"
        " iterations."
    )
    inverted = (
        "An element of the blood's mesh has turned inside out. Take a smaller dt, a finer mesh"
        " where the lumen is narrow, or a stiffer wall."
    )
    not_finite = (
        "The state is no longer finite. Take a smaller dt and check the units of pressures, flows"
        " and moduli."
    )


class Stepper(eqx.Module):
    """Everything prepared for steps of one length with one model.

    Attributes:
        dt: length of a step [s].
        motion: of the blood's mesh; None where the wall is rigid.
        preconditioner: of the linear systems.
        wall_stencil: tangent of the wall; None without one.
        method: coefficients in time (static).
        tolerance: by how much the residual of the extrapolated state is reduced (static).
        max_linear: iterations of GMRES at most (static).
        max_nonlinear: linear systems a step at most (static).
    """

    dt: Float[Array, ""]
    motion: MeshMotion | None
    preconditioner: Preconditioner
    wall_stencil: WallStencil | None
    method: GeneralizedAlpha = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)
    max_linear: int = eqx.field(static=True)
    max_nonlinear: int = eqx.field(static=True)


class StepReport(NamedTuple):
    """How a step went.

    Attributes:
        result: see `RESULTS`.
        n_linear: iterations of GMRES in all.
        n_nonlinear: linear systems solved.
        residual: weighted residual at the end over that of the extrapolated state.
        least_volume: smallest volume of a fluid element over its reference volume.
    """

    result: RESULTS
    n_linear: Int[Array, ""]
    n_nonlinear: Int[Array, ""]
    residual: Float[Array, ""]
    least_volume: Float[Array, ""]


def prepare(
    dt: float,
    model: Model,
    *,
    rho_infinity: float = 0.5,
    tolerance: float = 1e-3,
    max_linear: int = 40,
    max_nonlinear: int = 3,
) -> Stepper:
    """Make the factors for steps of length dt [s]; the model's numbers must be concrete.

    Args:
        dt: length of a step [s].
        model: the model.
        rho_infinity: damping of the highest frequency, see `generalized_alpha`.
        tolerance: by how much the residual of the extrapolated state is reduced. At 1e-3 the
            fields of the elastic tube differ by 2e-5 from those of an exact solve.
        max_linear: iterations of GMRES at most.
        max_nonlinear: linear systems a step at most.

    Raises:
        ValueError: dt or an option is out of range.
    """
    if not dt > 0.0:
        raise ValueError(f"dt = {dt} s is not positive; a cardiac cycle takes about 1000 steps")
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance = {tolerance} is not between 0 and 1; 1e-3 is usual")
    method = generalized_alpha(rho_infinity)
    moves = not (model.is_rigid or model.is_dry)
    return Stepper(
        jnp.asarray(dt, float),
        mesh_motion(model) if moves else None,
        preconditioner(dt, model, method),
        wall_stencil(dt, model, method),
        method,
        tolerance,
        max_linear,
        max_nonlinear,
    )


def advance_step(model: Model, state: State, stepper: Stepper) -> tuple[State, StepReport]:
    """Advance a state by one step."""
    dt, method = stepper.dt, stepper.method
    frozen_stepper = jax.lax.stop_gradient(stepper)
    step = begin_step(dt, model, state, method, stepper.motion)
    guess = extrapolated(state.t + dt, model, state)
    y, (n_linear, n_nonlinear, remainder) = _solve(guess, model, step, frozen_stepper)
    new = _updated(y, model, step, method)
    shrunk = step.fluid_shape.volume / geometry(model.x, model.fluid_tets).volume
    least = jnp.min(shrunk, initial=jnp.inf)
    finite = jnp.all(jnp.isfinite(y.u)) & jnp.all(jnp.isfinite(y.p))
    result = RESULTS.where(
        remainder <= 10.0 * stepper.tolerance, RESULTS.successful, RESULTS.not_converged
    )
    result = RESULTS.where(least > 0.0, result, RESULTS.inverted)
    result = RESULTS.where(finite, result, RESULTS.not_finite)
    return new, StepReport(result, n_linear, n_nonlinear, remainder, least)


def _updated(y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha) -> State:
    dt, old = step.dt, step.state
    a = method.acceleration(dt, old.u, old.a, y.u)
    d = method.displacement(dt, old.d, old.u, old.a, a)
    Q = jnp.array([flux(y.u, step.x, faces) for faces in model.port_faces], float)
    blocks, P = [], []
    for i, port in enumerate(model.ports):
        if isinstance(port, BlockPort):
            after = advance(old.t, dt, old.blocks[i], port.block, old.Q_port[i], Q[i])
            blocks.append(after.x)
            P.append(after.P)
        else:
            blocks.append(old.blocks[i])
            P.append(_mean_pressure(y.p, step, model.port_faces[i]))
    return State(
        old.t + dt,
        y.u,
        a,
        jnp.where(model.in_solid, d, 0.0),
        y.p,
        step.d_mesh,
        old.u,
        old.p,
        tuple(blocks),
        jnp.array(P, float),
        Q,
    )


def _mean_pressure(
    p: Float[Array, " nodes"], step: Step, faces: Int[Array, "3 faces"]
) -> Float[Array, ""]:
    corner = step.x[:, faces]
    normal = jnp.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], axis=0)
    area = jnp.sqrt(jnp.sum(normal**2, axis=0))
    return jnp.sum(jnp.mean(p[faces], axis=0) * area) / jnp.sum(area)


def _single(tree):
    """The same in single precision."""
    return jax.tree.map(lambda a: a.astype(jnp.float32) if eqx.is_inexact_array(a) else a, tree)


def _solve(guess: Unknowns, model: Model, step: Step, stepper: Stepper):
    """Solve the equations of a step, with the derivative of the implicit function theorem."""
    flat_guess, unravel = ravel_pytree(jax.lax.stop_gradient(guess))
    M, n_u = stepper.preconditioner, guess.u.size
    weight = jnp.concatenate([M.velocity_scale.reshape(-1), M.pressure_scale])
    held = jnp.concatenate([jnp.tile(model.held, 3), ~model.in_fluid])

    def equations(flat):
        return ravel_pytree(residual(unravel(flat), model, step, stepper.method))[0]

    def split(flat):
        return flat[:n_u].reshape(3, -1), flat[n_u:]

    def inverse(flat):
        z = jnp.concatenate([q.reshape(-1) for q in precondition(M, *split(flat))])
        return jnp.where(held, flat, z)

    def inverse_transposed(flat):
        z = jnp.concatenate([q.reshape(-1) for q in precondition_transposed(M, *split(flat))])
        return jnp.where(held, flat, z)

    def linear_solve(matvec, b, solve_with, weight, tolerance):
        scaled = fgmres(
            lambda v: weight * matvec(v),
            weight * b,
            lambda v: solve_with(v / weight),
            tolerance=tolerance * jnp.linalg.norm(weight * b),
            max_iterations=stepper.max_linear,
        )
        return scaled.x, scaled.n_iterations

    def newton(function, start):
        # Corrections need few digits; what is left is measured in double precision.
        model_32, step_32, weight_32 = _single((model, step, weight))
        wall_32 = _single(stepper.wall_stencil)
        _, unravel_32 = ravel_pytree(_single(guess))

        def tangent(flat):
            v = unravel_32(flat)
            product = apply_elements(v, model_32, step_32, stepper.method, wall_32)
            return ravel_pytree(product)[0]

        def correction(r, tolerance):
            scale = jnp.linalg.norm(weight * r)
            scaled = (r / scale).astype(jnp.float32)
            dy, n = linear_solve(tangent, scaled, inverse, weight_32, tolerance)
            return dy.astype(r.dtype) * scale, n

        r = function(start)
        first = jnp.linalg.norm(weight * r)

        def proceed(s):
            _, norm, k, _, _ = s
            return (k < stepper.max_nonlinear) & (norm > stepper.tolerance * first)

        def correct(s):
            y, norm, k, n_linear, r = s
            # only as far as this step's tolerance asks for
            goal = jnp.maximum(0.5 * stepper.tolerance * first / norm, LEAST_REDUCTION)
            dy, n = correction(r, goal)
            y = y - dy
            r = function(y)
            return y, jnp.linalg.norm(weight * r), k + 1, n_linear + n, r

        zero = jnp.zeros((), int)
        y, norm, k, n_linear, _ = jax.lax.while_loop(
            proceed, correct, (start, first, zero, zero, r)
        )
        return y, (n_linear, k, norm / jnp.where(first > 0.0, first, 1.0))

    def tangent_solve(matvec, b):
        def solve(matvec, b):
            return linear_solve(matvec, b, inverse, weight, 1e-8)[0]

        def transposed(vecmat, b):
            return linear_solve(vecmat, b, inverse_transposed, weight, 1e-8)[0]

        return jax.lax.custom_linear_solve(matvec, b, solve, transposed)

    flat, report = jax.lax.custom_root(equations, flat_guess, newton, tangent_solve, has_aux=True)
    return unravel(flat), report
