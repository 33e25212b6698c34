"""The linearised step, applied element by element.

The rows of momentum are the same scalar operator for each component (inertia, convection and its
stabilisation, viscosity), to which come what couples the components: the transposed part of the
viscous stress and the least-squares term on the divergence. With the weights w_a, w_u of
acceleration and velocity in the step::

    A_ab = ∫ ρ N_a (w_a N_b + w_u c*·∇N_b) + ρτ ∇N_a·∫ c* ρ (w_a N_b + w_u c·∇N_b)
           + w_u ∫ μ ∇N_a·∇N_b
    G_ab = w_u (−∫ ∇N_a N_b + ρτ ∫ c*·∇N_a ∇N_b)
    D_ab = w_u ∫ N_a ∇N_b + ∫ τρ ∇N_a (w_a N_b + w_u c·∇N_b),   C_ab = w_u ∫ τ ∇N_a·∇N_b

The full Newton tangent adds w_u ρ (v·∇)u, the derivative of the advecting velocity along a change
v; it couples the components. Derivatives of the stabilisation parameters, of the viscosity and of
the advecting velocity in the weights of the stabilisation are neglected.

Element by element the sixteen entries of A and the factors of G, D and C are stored; the wall has
its own tangent. On the elastic tube of 60 000 elements, in a compiled loop on two cores, a product
of the blood takes 1.0 ms and one of the wall 1.1 ms.

The same equations stand in `laws.fluid.fluid_residual`, in `solve.preconditioner._blocks` (at rest,
as matrices) and in `verification.reference_residual` (as on the page): a term that is changed here
is changed there, and ``test_one_equation.py`` compares them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.assembly import MASS
from jaxfsi.core.elements.linear import (
    Corners,
    added,
    corners,
    fusion_barrier,
    gradient,
    scatter,
    total,
    vector_corners,
)
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.contact import contact_product, contact_slope
from jaxfsi.core.laws.fluid import velocity_gradient
from jaxfsi.core.laws.interface import mid_edge_flux, mid_edge_load
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.solve.wall_tangent import (
    BendingTangent,
    WallTangent,
    apply_wall,
    apply_wall_transposed,
    wall_tangent,
)
from jaxfsi.core.step.equations import Step, Unknowns, midpoint, port_motion
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model


class BloodTangent(NamedTuple):
    """Derivative of the blood's equations, element by element.

    Attributes:
        A: entries A_ab of momentum, row by row, the same for each component.
        upwind: w_u ρτ ∫ c*·∇N_a.
        strong_residual: τρ ∫ (w_a N_b + w_u c·∇N_b).
        shear: w_u μ V.
        spread: w_u τ_C V.
        mean: w_u V/4.
        least: w_u τ V.
        reaction: convective reaction ρ ∂u_i/∂x_j.
    """

    A: tuple[Float[Array, " tets"], ...]
    upwind: Corners
    strong_residual: Corners
    shear: Float[Array, " tets"]
    spread: Float[Array, " tets"]
    mean: Float[Array, " tets"]
    least: Float[Array, " tets"]
    reaction: tuple[tuple[Float[Array, " tets"], ...], ...]


class StepTangent(NamedTuple):
    """The linearised step, element by element.

    Attributes:
        blood: derivative of the blood's equations.
        wall: that of the wall's forces; None without a wall.
        contact: stiffness of each pair of opposite sides; None where they do not see each other.
    """

    blood: BloodTangent
    wall: WallTangent | BendingTangent | None
    contact: Float[Array, " pairs"] | None


def step_tangent(y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha) -> StepTangent:
    """Linearise the equations of a step about y."""
    wall = None
    u, _, d, _ = midpoint(y, step, method)
    if model.wall is not None:
        weights = Weights(*method.weights(step.dt))
        wall = wall_tangent(
            u, d, weights, model.wall, model.element, step.solid_shape, model.prestress
        )
    contact = None
    if model.contact is not None:
        contact = contact_slope(d, model.x, model.contact)
    return StepTangent(_blood_tangent(u, model, step, method), wall, contact)


def _blood_tangent(
    u: Float[Array, "3 nodes"], model: Model, step: Step, method: GeneralizedAlpha
) -> BloodTangent:
    w_a, w_u, _ = method.weights(step.dt)
    shape, k = step.fluid_shape, step.coefficients
    grad, V = shape
    rho, tau, mu = model.blood.rho_f, k.tau_momentum, k.mu
    c = vector_corners(k.c, model.fluid_tets)
    sum_c = [total(component) for component in c]
    # ∫ c_j N_b, ∫ c_j c_k, ∫ (c + u′)_j over the element, and c·∇N_b with the mean c
    c_value = [[V / 20.0 * (c[j][b] + sum_c[j]) for b in range(4)] for j in range(3)]
    cc = [
        [
            V / 20.0 * (added(c[i][b] * c[j][b] for b in range(4)) + sum_c[i] * sum_c[j])
            for j in range(3)
        ]
        for i in range(3)
    ]
    advected = [V * (sum_c[j] / 4.0 + k.subscale[j]) for j in range(3)]
    along = [added(sum_c[j] / 4.0 * grad[j][b] for j in range(3)) for b in range(4)]
    c_value, cc, advected, along = fusion_barrier((c_value, cc, advected, along), shape)
    # ∫ ρ c* (w_a N_b + w_u c·∇N_b)
    inertia = [
        [
            rho * w_a * (c_value[i][b] + V / 4.0 * k.subscale[i])
            + rho
            * w_u
            * (added(cc[i][j] * grad[j][b] for j in range(3)) + V * k.subscale[i] * along[b])
            for b in range(4)
        ]
        for i in range(3)
    ]
    inertia = fusion_barrier(inertia, shape)
    A, upwind = [], []
    for a in range(4):
        test = [c_value[j][a] + V / 4.0 * k.subscale[j] for j in range(3)]
        upwind.append(w_u * rho * tau * added(grad[j][a] * advected[j] for j in range(3)))
        for b in range(4):
            share = float(MASS[a, b])
            galerkin = w_a * share * V + w_u * added(test[j] * grad[j][b] for j in range(3))
            stabilised = tau * added(grad[j][a] * inertia[j][b] for j in range(3))
            laplace = w_u * V * added(grad[j][a] * grad[j][b] for j in range(3))
            A.append(rho * (galerkin + stabilised) + mu * laplace)
    strong_residual = tuple(tau * rho * V * (w_a / 4.0 + w_u * along[b]) for b in range(4))
    gradients = velocity_gradient(u, model.fluid_tets, shape)
    found = BloodTangent(
        tuple(A),
        tuple(upwind),
        strong_residual,
        shear=w_u * V * mu,
        spread=w_u * V * k.tau_continuity,
        mean=0.25 * w_u * V,
        least=w_u * V * tau,
        reaction=tuple(tuple(rho * entry for entry in row) for row in gradients),
    )
    return fusion_barrier(found, shape)


def apply_elements(
    tangent: StepTangent, v: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> Unknowns:
    """Product of the linearised step and a change of velocity and pressure, by elements."""
    blood, tets, n, shape = tangent.blood, model.fluid_tets, model.n_nodes, step.fluid_shape
    grad = shape.grad
    velocity, pressure = vector_corners(v.u, tets), corners(v.p, tets)
    gradients = [gradient(component, shape) for component in velocity]
    grad_p = gradient(pressure, shape)
    divergence = gradients[0][0] + gradients[1][1] + gradients[2][2]
    hydrostatic = blood.spread * divergence - blood.mean * total(pressure)
    reaction = _reaction(blood, velocity)
    forcing = [grad_p[i] + reaction[i] for i in range(3)]
    strong_residual = [
        added(blood.strong_residual[b] * velocity[i][b] for b in range(4))
        + blood.least * forcing[i]
        for i in range(3)
    ]
    volume_rate = blood.mean * divergence
    gradients, forcing, reaction, hydrostatic, strong_residual, volume_rate = fusion_barrier(
        (gradients, forcing, reaction, hydrostatic, strong_residual, volume_rate), shape
    )
    rows = []
    for i in range(3):
        stress = [blood.shear * gradients[j][i] for j in range(3)]
        stress[i] = stress[i] + hydrostatic
        force = tuple(
            added(blood.A[4 * a + b] * velocity[i][b] for b in range(4))
            + blood.upwind[a] * forcing[i]
            + added(grad[j][a] * stress[j] for j in range(3))
            + 0.2 * blood.mean * (4.0 * reaction[i] + _reaction_at(blood, velocity, i, a))
            for a in range(4)
        )
        rows.append(scatter(force, tets, n))
    continuity = tuple(
        volume_rate + added(grad[i][a] * strong_residual[i] for i in range(3)) for a in range(4)
    )
    r_u, r_p = _at_surfaces(tangent, v, model, step, method)
    if tangent.wall is not None:
        r_u = r_u + apply_wall(tangent.wall, v.u, model.element, step.solid_shape)
    r = Unknowns(r_u + jnp.stack(rows), r_p + scatter(continuity, tets, n))
    return Unknowns(jnp.where(model.prescribed, v.u, r.u), jnp.where(model.in_fluid, r.p, v.p))


def apply_elements_transposed(
    tangent: StepTangent, v: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> Unknowns:
    """Product of the transposed linearised step and v, by elements.

    Written out, since the transpose that JAX derives takes three times as long as the product. A_ab
    becomes A_ba, the reaction's matrix is transposed, and G and D change places: upwinding with the
    strong residual, and the mean with its sign.
    """
    blood, tets, n, shape = tangent.blood, model.fluid_tets, model.n_nodes, step.fluid_shape
    grad = shape.grad
    # rows of prescribed unknowns are those of the identity
    own = Unknowns(jnp.where(model.prescribed, v.u, 0.0), jnp.where(model.in_fluid, 0.0, v.p))
    v = Unknowns(jnp.where(model.prescribed, 0.0, v.u), jnp.where(model.in_fluid, v.p, 0.0))
    velocity, pressure = vector_corners(v.u, tets), corners(v.p, tets)
    gradients = [gradient(component, shape) for component in velocity]
    grad_p = gradient(pressure, shape)
    divergence = gradients[0][0] + gradients[1][1] + gradients[2][2]
    hydrostatic = blood.spread * divergence + blood.mean * total(pressure)
    forcing = [
        added(blood.upwind[a] * velocity[i][a] for a in range(4)) + blood.least * grad_p[i]
        for i in range(3)
    ]
    pull = [0.25 * forcing[i] + 0.2 * blood.mean * total(velocity[i]) for i in range(3)]
    reaction = [added(blood.reaction[i][j] * pull[i] for i in range(3)) for j in range(3)]
    volume_rate = blood.mean * divergence
    gradients, grad_p, forcing, reaction, hydrostatic, volume_rate = fusion_barrier(
        (gradients, grad_p, forcing, reaction, hydrostatic, volume_rate), shape
    )
    rows = []
    for j in range(3):
        stress = [blood.shear * gradients[i][j] for i in range(3)]
        stress[j] = stress[j] + hydrostatic
        force = tuple(
            added(blood.A[4 * a + b] * velocity[j][a] for a in range(4))
            + blood.strong_residual[b] * grad_p[j]
            + added(grad[i][b] * stress[i] for i in range(3))
            + reaction[j]
            + 0.2 * blood.mean * added(blood.reaction[i][j] * velocity[i][b] for i in range(3))
            for b in range(4)
        )
        rows.append(scatter(force, tets, n))
    continuity = tuple(
        added(grad[i][b] * forcing[i] for i in range(3)) - volume_rate for b in range(4)
    )
    surfaces = jax.linear_transpose(lambda v: _at_surfaces(tangent, v, model, step, method), v)
    (r,) = surfaces(v)
    r_u = own.u + r.u + jnp.stack(rows)
    if tangent.wall is not None:
        r_u = r_u + apply_wall_transposed(tangent.wall, v.u, model.element, step.solid_shape)
    return Unknowns(r_u, own.p + r.p + scatter(continuity, tets, n))


def blood_diagonal(
    tangent: StepTangent, model: Model, step: Step
) -> tuple[Float[Array, " nodes"], ...]:
    """Diagonal of the blood's share of momentum, of each component; zero in the wall.

    The convective reaction is left out: the velocity gradient has either sign.
    """
    blood, grad = tangent.blood, step.fluid_shape.grad
    stress = blood.shear + blood.spread
    own = [tuple(blood.A[5 * a] + stress * grad[i][a] ** 2 for a in range(4)) for i in range(3)]
    own = fusion_barrier(own, step.fluid_shape)
    return tuple(scatter(corner, model.fluid_tets, model.n_nodes) for corner in own)


def _reaction(blood: BloodTangent, v: Sequence[Corners]) -> list[Float[Array, " tets"]]:
    """ρ (v·∇)u with the mean of a change v on each element [dyn/cm³]."""
    mean = [total(component) / 4.0 for component in v]
    return [added(blood.reaction[i][j] * mean[j] for j in range(3)) for i in range(3)]


def _reaction_at(
    blood: BloodTangent, v: Sequence[Corners], i: int, a: int
) -> Float[Array, " tets"]:
    """Component i of ρ (v·∇)u at corner a."""
    return added(blood.reaction[i][j] * v[j][a] for j in range(3))


def _at_surfaces(
    tangent: StepTangent, v: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> Unknowns:
    """Product of what acts on surfaces: tissue outside, contact, mid-edge modes and ports."""
    _, w_u, w_d = method.weights(step.dt)
    r_u, r_p = jnp.zeros_like(v.u), jnp.zeros_like(v.p)
    if model.wall is not None:
        support = w_d * model.wall.support_stiffness + w_u * model.wall.support_damping
        r_u = r_u + tissue_force(support * v.u, model)
    if model.contact is not None and tangent.contact is not None:
        r_u = r_u + contact_product(w_d * tangent.contact, v.u, model.contact)
    if model.mid_edge is not None:
        r_u = r_u - w_u * mid_edge_load(v.p, step.x, model.mid_edge)
        r_p = r_p + w_u * mid_edge_flux(v.u, step.x, model.mid_edge)
    return Unknowns(r_u - _port_slope(v.u, model, step, method), r_p)


def _port_slope(
    u: Float[Array, "3 nodes"], model: Model, step: Step, method: GeneralizedAlpha
) -> Float[Array, "3 nodes"]:
    """Derivative of the ports' forces along a change of velocity."""
    _, w_u, _ = method.weights(step.dt)
    load = jnp.zeros_like(u)
    motion = port_motion(u, model, step)
    for i, (port, surface) in enumerate(zip(model.ports, model.surfaces, strict=True)):
        load = port.add_load_tangent(load, step.Z[i], w_u, motion, surface)
    return load
