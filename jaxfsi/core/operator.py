"""The linearised step: applied element by element, or as stencils assembled once a step.

Element by element the blood's part is its residual without the state at the start of the step,
which is linear. As stencils,

the rows of momentum are the same scalar operator for each component (inertia, convection and its
stabilisation, viscosity), to which come what couples the components: the transposed part of the
viscous stress and the least-squares term on the divergence, element by element, and the wall.
With the weights w_a, w_u of acceleration and velocity in the step::

    A_ab = ∫ ρ N_a (w_a N_b + w_u c*·∇N_b) + ρτ ∇N_a·∫ c* ρ (w_a N_b + w_u c·∇N_b)
           + w_u ∫ μ ∇N_a·∇N_b
    G_ab = w_u (−∫ ∇N_a N_b + ρτ ∫ c*·∇N_a ∇N_b)
    D_ab = w_u ∫ N_a ∇N_b + ∫ τρ ∇N_a (w_a N_b + w_u c·∇N_b),   C_ab = w_u ∫ τ ∇N_a·∇N_b

On the elastic tube of 60 000 elements an assembly takes as long as seven products of elements,
and each product saves a quarter of one: stencils pay where a step takes many iterations.

The wall enters element by element with its tangent about a given motion.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.assembly import MASS
from jaxfsi.core.elements import (
    added,
    area_vectors,
    face_load,
    flux,
    gradient,
    scatter,
    total,
    vector_corners,
)
from jaxfsi.core.equations import BACKFLOW, Step, Unknowns, outer_share
from jaxfsi.core.fluid import fluid_residual
from jaxfsi.core.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.model import Model
from jaxfsi.core.ports import HeldPort
from jaxfsi.core.solid import WallMotion, solid_tangent
from jaxfsi.core.stencil import Pattern, Values, apply, assemble, pattern
from jaxfsi.core.wall_elements import Weights
from lumped.parameters import Parameter


class StepOperator(eqx.Module):
    """The linearised step.

    Attributes:
        pattern: of the blood's elements.
        A: momentum, the same for each component.
        G: pressure in the momentum of each direction.
        D: velocity of each direction in continuity.
        C: pressure in continuity.
    """

    pattern: Pattern
    A: Values
    G: tuple[Values, Values, Values]
    D: tuple[Values, Values, Values]
    C: Values


def fluid_pattern(model: Model) -> Pattern:
    """Pattern of the blood's elements of a concrete model."""
    return pattern(np.asarray(model.fluid_tets).T, model.n_nodes)


def assemble_step(
    model: Model,
    step: Step,
    method: GeneralizedAlpha,
    fluid: Pattern,
) -> StepOperator:
    """Assemble the blood's part of the linearised equations of a step."""
    w_a, w_u, _ = method.weights(step.dt)
    grad, V = step.fluid_shape
    k = step.coefficients
    rho, tau, mu = model.blood.rho_f, k.tau_momentum, k.mu
    c = vector_corners(k.c, model.fluid_tets)
    sum_c = [total(component) for component in c]
    # ∫ c_j N_b, ∫ c_j c_k and ∫ (c + u′)_j over the element
    c_value = [[V / 20.0 * (c[j][b] + sum_c[j]) for b in range(4)] for j in range(3)]
    cc = [
        [
            V / 20.0 * (added(c[i][b] * c[j][b] for b in range(4)) + sum_c[i] * sum_c[j])
            for j in range(3)
        ]
        for i in range(3)
    ]
    advected = [V * (sum_c[j] / 4.0 + k.fine[j]) for j in range(3)]
    # c·∇N_b per unit volume with the mean c, and ∫ ρ c* (w_a N_b + w_u c·∇N_b)
    along = [added(sum_c[j] / 4.0 * grad[j, b] for j in range(3)) for b in range(4)]
    inertia = [
        [
            rho * w_a * (c_value[i][b] + V / 4.0 * k.fine[i])
            + rho
            * w_u
            * (added(cc[i][j] * grad[j, b] for j in range(3)) + V * k.fine[i] * along[b])
            for b in range(4)
        ]
        for i in range(3)
    ]
    A, G, D, C = [], ([], [], []), ([], [], []), []
    for a in range(4):
        test = [c_value[j][a] + V / 4.0 * k.fine[j] for j in range(3)]
        upwind = added(grad[j, a] * advected[j] for j in range(3))
        for b in range(4):
            galerkin = w_a * MASS[a, b] * V + w_u * added(test[j] * grad[j, b] for j in range(3))
            stabilised = tau * added(grad[j, a] * inertia[j][b] for j in range(3))
            laplace = added(grad[j, a] * grad[j, b] for j in range(3)) * V * w_u
            A.append(rho * (galerkin + stabilised) + mu * laplace)
            C.append(tau * laplace)
            strong = tau * rho * V * (w_a / 4.0 + w_u * along[b])
            for i in range(3):
                G[i].append(w_u * (rho * tau * upwind * grad[i, b] - V / 4.0 * grad[i, a]))
                D[i].append(w_u * V / 4.0 * grad[i, b] + strong * grad[i, a])

    a, g_x, g_y, g_z, d_x, d_y, d_z, c_p = assemble([A, *G, *D, C], fluid)
    return StepOperator(fluid, a, (g_x, g_y, g_z), (d_x, d_y, d_z), c_p)


def apply_elements(
    v: Unknowns,
    model: Model,
    step: Step,
    method: GeneralizedAlpha,
    motion: WallMotion | None,
) -> Unknowns:
    """Product of the linearised equations and a change of velocity and pressure, by elements.

    Args:
        v: the change.
        model: the model.
        step: the step.
        method: coefficients in time.
        motion: of the wall, about which its forces are linearised; None without a wall.
    """
    w_a, w_u, _ = method.weights(step.dt)
    r_u, r_p = fluid_residual(
        w_u * v.u,
        w_a * v.u,
        w_u * v.p,
        model.blood,
        step.coefficients,
        model.fluid_tets,
        step.fluid_shape,
    )
    return _closed(v, r_u, r_p, model, step, method, motion)


def apply_step(
    operator: StepOperator,
    v: Unknowns,
    model: Model,
    step: Step,
    method: GeneralizedAlpha,
    motion: WallMotion | None,
) -> Unknowns:
    """The product of `apply_elements`, the blood's part by stencils."""
    _, w_u, _ = method.weights(step.dt)
    P = operator.pattern.neighbour
    coupled = _coupling(v.u, model, step, w_u)
    rows = [
        apply(operator.A, P, v.u[i]) + apply(operator.G[i], P, v.p) + coupled[i] for i in range(3)
    ]
    r_p = apply(operator.C, P, v.p)
    for i in range(3):
        r_p = r_p + apply(operator.D[i], P, v.u[i])
    return _closed(v, jnp.stack(rows), r_p, model, step, method, motion)


def _closed(
    v: Unknowns,
    r_u: Float[Array, "3 nodes"],
    r_p: Float[Array, " nodes"],
    model: Model,
    step: Step,
    method: GeneralizedAlpha,
    motion: WallMotion | None,
) -> Unknowns:
    """The blood's product with that of wall and ports, and the rows of held unknowns."""
    if model.wall is not None and motion is not None:
        weights = Weights(*method.weights(step.dt))
        r_u = r_u + solid_tangent(
            v.u, weights, motion, model.wall, model.element, step.solid_shape, model.prestress
        )
        support = weights.d * model.wall.support_stiffness + weights.u * model.wall.support_damping
        r_u = r_u + support * outer_share(model) * v.u
    r_u = r_u - _port_slope(v.u, model, step, method)
    return Unknowns(jnp.where(model.held, v.u, r_u), jnp.where(model.in_fluid, r_p, v.p))


def _coupling(
    u: Float[Array, "3 nodes"], model: Model, step: Step, w_u: Parameter
) -> list[Float[Array, " nodes"]]:
    """Terms between components: ∫ ∂_jN_a (μ ∂_i u_j + δ_ij τ_C ∇·u)."""
    tets, (grad, V) = model.fluid_tets, step.fluid_shape
    slope = [gradient(component, step.fluid_shape) for component in vector_corners(u, tets)]
    divergence = slope[0][0] + slope[1][1] + slope[2][2]
    spread = step.coefficients.tau_continuity * divergence
    rows = []
    for i in range(3):
        stress = [step.coefficients.mu * slope[j][i] for j in range(3)]
        stress[i] = stress[i] + spread
        pull = [w_u * V * s for s in stress]
        force = tuple(added(grad[j, b] * pull[j] for j in range(3)) for b in range(4))
        rows.append(scatter(force, tets, model.n_nodes))
    return rows


def _port_slope(
    u: Float[Array, "3 nodes"], model: Model, step: Step, method: GeneralizedAlpha
) -> Float[Array, "3 nodes"]:
    """Derivative of the ports' forces along a change of velocity."""
    _, w_u, _ = method.weights(step.dt)
    load = jnp.zeros_like(u)
    for i, (port, faces) in enumerate(zip(model.ports, model.port_faces, strict=True)):
        if isinstance(port, HeldPort):
            continue
        area = area_vectors(step.x, faces)
        P = step.Z[i] * flux(u, step.x, faces)
        c = jnp.mean(step.coefficients.c[:, faces], axis=1)
        inflow = jnp.minimum(jnp.sum(c * area, axis=0), 0.0)
        backflow = 0.5 * BACKFLOW * model.blood.rho_f * inflow
        push = w_u * backflow * jnp.mean(u[:, faces], axis=1) - P * area
        load = load + face_load(push, faces, model.n_nodes)
    return load
