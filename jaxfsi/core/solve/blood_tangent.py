"""The linearised equations of the blood, applied element by element.

The rows of momentum are the same scalar operator for each component (inertia, convection and its
stabilisation, viscosity), to which come what couples the components: the transposed part of the
viscous stress and the least-squares term on the divergence. With the weights w_a, w_u of
acceleration and velocity in the step::

    A_ab = ∫ ρ N_a (w_a N_b + w_u c*·∇N_b) + ρτ ∇N_a·∫ c* ρ (w_a N_b + w_u c·∇N_b)
           + w_u ∫ μ ∇N_a·∇N_b
    G_ab = w_u (−∫ ∇N_a N_b + ρτ ∫ c*·∇N_a ∇N_b)
    D_ab = w_u ∫ N_a ∇N_b + ∫ τρ ∇N_a (w_a N_b + w_u c·∇N_b),   C_ab = w_u ∫ τ ∇N_a·∇N_b

A change v of the velocity changes what advects and what stabilises as well. With the strong
residual s = ρ (a + c·∇u) + ∇p and c = u − u_mesh::

    + w_u ∫ N_a ρ (v·∇)u + ∫ N_a ρ (δu′·∇)u + ∫ ρτ (w_u v + δu′)·∇N_a s
    + w_u ∫ ρτ c*·∇N_a ρ (v·∇)u + ∫ (δτ/τ) ρτ c*·∇N_a s + ∫ δτ_C ∇N_a ∇·u
    δτ/τ = −w_u (ρτ)² v·G c,   δτ_C/τ_C = w_u v·G c/s²,   δu′ = −δ(τ s)

Without these, corrections in a slit where steps cross ten elements diverge; with all, one brings
the residual down to a few thousandths. The derivative of the viscosity is neglected, and of what
δτ multiplies all but the mean on each element.

Element by element the sixteen entries of A and the factors of all else are stored. A field f that
varies over an element, c or s, is kept as its mean and, of the last three corners, the differences
f′_b to the mean::

    ∫ f g = V (f̄ ḡ + Σ_b f′_b (g_b − g_1)/20),   b = 2, 3, 4

The same equations stand in `laws.fluid.fluid_residual`, in `solve.step_blocks` (at rest, as
matrices) and in `verification.reference_residual` (as on the page): a term that is changed here
is changed there, and ``test_one_equation.py`` compares them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.assembly import MASS
from jaxfsi.core.elements.linear import (
    Corners,
    Geometry,
    added,
    corners,
    fusion_barrier,
    gradient,
    scatter,
    total,
    vector_corners,
)
from jaxfsi.core.laws.fluid import velocity_gradient
from jaxfsi.core.step.equations import Step, Unknowns
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model
from lumped.parameters import Parameter

LAST = (1, 2, 3)
"""Corners whose difference to the first tells how a field varies over an element."""


class CoefficientTangent(NamedTuple):
    """Derivative of the coefficients of the blood's equations, element by element.

    Attributes:
        crossing: w_u ρτ V/20 ∇N_a·c′_b, a and b the last three corners.
        mean_strong: ρτ s̄_i.
        strong: w_u ρτ V/20 s′_ib.
        slowing: δτ/τ along a mean velocity v̄ is w_u ρτ `slowing`·v̄; it is −ρτ G c.
        swelling: w_u V δτ_C ∇·u is `swelling` times `slowing`·v̄.
    """

    crossing: tuple[tuple[Float[Array, " tets"], ...], ...]
    mean_strong: tuple[Float[Array, " tets"], ...]
    strong: tuple[tuple[Float[Array, " tets"], ...], ...]
    slowing: tuple[Float[Array, " tets"], ...]
    swelling: Float[Array, " tets"]


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
        coefficients: what the change of the coefficients adds.
    """

    A: tuple[Float[Array, " tets"], ...]
    upwind: Corners
    strong_residual: Corners
    shear: Float[Array, " tets"]
    spread: Float[Array, " tets"]
    mean: Float[Array, " tets"]
    least: Float[Array, " tets"]
    reaction: tuple[tuple[Float[Array, " tets"], ...], ...]
    coefficients: CoefficientTangent


def blood_tangent(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    model: Model,
    step: Step,
    method: GeneralizedAlpha,
    kept: Parameter = 1.0,
) -> BloodTangent:
    """Linearise the equations of the blood.

    Args:
        u: velocity at which they hold [cm/s].
        a: acceleration there [cm/s²].
        model: the model.
        step: the step, with the coefficients of that state.
        method: coefficients in time.
        kept: share of what the change of the coefficients adds that is kept.
    """
    acceleration = vector_corners(a, model.fluid_tets)
    w_a, w_u, _ = method.weights(step.dt)
    shape, k = step.fluid_shape, step.coefficients
    grad, V = shape
    rho, tau, mu = model.blood.rho_f, k.tau_momentum, k.mu
    c = vector_corners(k.c, model.fluid_tets)
    c_value, cc, advected, along = _advection(c, step)
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
    for m in range(4):
        test = [c_value[j][m] + V / 4.0 * k.subscale[j] for j in range(3)]
        upwind.append(w_u * rho * tau * added(grad[j][m] * advected[j] for j in range(3)))
        for b in range(4):
            share = float(MASS[m, b])
            galerkin = w_a * share * V + w_u * added(test[j] * grad[j][b] for j in range(3))
            stabilised = tau * added(grad[j][m] * inertia[j][b] for j in range(3))
            laplace = w_u * V * added(grad[j][m] * grad[j][b] for j in range(3))
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
        coefficients=_coefficient_tangent(
            c, along, acceleration, gradients, model, step, w_u, kept
        ),
    )
    return fusion_barrier(found, shape)


def _advection(c: Sequence[Corners], step: Step):
    """∫ c_j N_b, ∫ c_j c_k, ∫ (c + u′)_j over the element, and c·∇N_b with the mean c."""
    shape, subscale = step.fluid_shape, step.coefficients.subscale
    grad, V = shape
    sum_c = [total(component) for component in c]
    c_value = [[V / 20.0 * (c[j][b] + sum_c[j]) for b in range(4)] for j in range(3)]
    cc = [
        [
            V / 20.0 * (added(c[i][b] * c[j][b] for b in range(4)) + sum_c[i] * sum_c[j])
            for j in range(3)
        ]
        for i in range(3)
    ]
    advected = [V * (sum_c[j] / 4.0 + subscale[j]) for j in range(3)]
    along = [added(sum_c[j] / 4.0 * grad[j][b] for j in range(3)) for b in range(4)]
    return fusion_barrier((c_value, cc, advected, along), shape)


def _coefficient_tangent(
    c: Sequence[Corners],
    along: Sequence[Float[Array, " tets"]],
    acceleration: Sequence[Corners],
    grad_u: Sequence[Sequence[Float[Array, " tets"]]],
    model: Model,
    step: Step,
    w_u: Parameter,
    kept: Parameter,
) -> CoefficientTangent:
    k, (grad, V) = step.coefficients, step.fluid_shape
    rho, tau = model.blood.rho_f, k.tau_momentum
    apart_c = [_apart(component) for component in c]
    # the gradient of p is the same all over an element
    apart_s = [
        [
            rho * (apart_a[b] + added(apart_c[j][b] * grad_u[i][j] for j in range(3)))
            for b in range(3)
        ]
        for i, apart_a in enumerate(_apart(component) for component in acceleration)
    ]
    scale = kept * w_u * rho * tau * V / 20.0
    metric_c = [added(grad[j][b] * along[b] for b in LAST) for j in range(3)]
    # s² by τ_C = ρ s/tr G; zero where blood without viscosity is at rest
    rate = k.tau_continuity * added(grad[j][b] ** 2 for j in range(3) for b in LAST) / rho
    rate = jnp.where(rate > 0.0, rate, 1.0)
    divergence = grad_u[0][0] + grad_u[1][1] + grad_u[2][2]
    return CoefficientTangent(
        crossing=tuple(
            tuple(scale * added(grad[j][a] * apart_c[j][b] for j in range(3)) for b in range(3))
            for a in LAST
        ),
        mean_strong=tuple(-kept * rho * subscale for subscale in k.subscale),
        strong=tuple(tuple(scale * entry for entry in row) for row in apart_s),
        slowing=tuple(-rho * tau * entry for entry in metric_c),
        swelling=-kept * w_u * V * k.tau_continuity * divergence / (rho * tau * rate**2),
    )


def _apart(values: Corners) -> list[Float[Array, " tets"]]:
    """Differences of the last three corners to the mean."""
    mean = total(values) / 4.0
    return [values[b] - mean for b in LAST]


def _on_elements(v: Unknowns, tets: Int[Array, "4 tets"], shape: Geometry):
    """Velocity and pressure at the corners, their gradients, and the divergence."""
    velocity, pressure = vector_corners(v.u, tets), corners(v.p, tets)
    gradients = [gradient(component, shape) for component in velocity]
    grad_p = gradient(pressure, shape)
    divergence = gradients[0][0] + gradients[1][1] + gradients[2][2]
    return velocity, pressure, gradients, grad_p, divergence


def apply_blood(blood: BloodTangent, v: Unknowns, model: Model, shape: Geometry) -> Unknowns:
    """Product of the blood's tangent and a change of velocity and pressure."""
    change = blood.coefficients
    tets, n, grad = model.fluid_tets, model.n_nodes, shape.grad
    velocity, pressure, gradients, grad_p, divergence = _on_elements(v, tets, shape)
    sums = [total(component) for component in velocity]
    slower = 0.25 * added(change.slowing[j] * sums[j] for j in range(3))
    hydrostatic = blood.spread * divergence - blood.mean * total(pressure)
    hydrostatic = hydrostatic + change.swelling * slower
    reaction = [0.25 * added(blood.reaction[i][j] * sums[j] for j in range(3)) for i in range(3)]
    forcing = [grad_p[i] + reaction[i] + change.mean_strong[i] * slower for i in range(3)]
    strong_residual = [
        added(blood.strong_residual[b] * velocity[i][b] for b in range(4))
        + blood.least * forcing[i]
        for i in range(3)
    ]
    # of c*, over the element
    carried = [blood.mean * sums[j] - strong_residual[j] for j in range(3)]
    apart = [[component[b] - component[0] for b in LAST] for component in velocity]
    stress = [
        [
            blood.shear * gradients[j][i]
            + change.mean_strong[i] * carried[j]
            + added(change.strong[i][b] * apart[j][b] for b in range(3))
            for j in range(3)
        ]
        for i in range(3)
    ]
    for i in range(3):
        stress[i][i] = stress[i][i] + hydrostatic
    uniform = [
        0.8 * blood.mean * reaction[i]
        - 0.25 * added(blood.reaction[i][j] * strong_residual[j] for j in range(3))
        for i in range(3)
    ]
    volume_rate = blood.mean * divergence
    known = (stress, forcing, uniform, strong_residual, volume_rate)
    stress, forcing, uniform, strong_residual, volume_rate = fusion_barrier(known, shape)
    rows = []
    for i in range(3):
        carries = [added(blood.reaction[i][j] * velocity[j][b] for j in range(3)) for b in range(4)]
        varying = [carries[b] - carries[0] for b in LAST]
        crossed = [added(change.crossing[a][b] * varying[b] for b in range(3)) for a in range(3)]
        crossed = [-added(crossed), *crossed]
        force = tuple(
            added(blood.A[4 * a + b] * velocity[i][b] for b in range(4))
            + blood.upwind[a] * forcing[i]
            + added(grad[j][a] * stress[i][j] for j in range(3))
            + crossed[a]
            + uniform[i]
            + 0.2 * blood.mean * carries[a]
            for a in range(4)
        )
        rows.append(scatter(force, tets, n))
    continuity = tuple(
        volume_rate + added(grad[i][a] * strong_residual[i] for i in range(3)) for a in range(4)
    )
    return Unknowns(jnp.stack(rows), scatter(continuity, tets, n))


def apply_blood_transposed(
    blood: BloodTangent, v: Unknowns, model: Model, shape: Geometry
) -> Unknowns:
    """Product of the transposed tangent of the blood and v."""
    change = blood.coefficients
    tets, n, grad = model.fluid_tets, model.n_nodes, shape.grad
    velocity, pressure, gradients, grad_p, divergence = _on_elements(v, tets, shape)
    hydrostatic = blood.spread * divergence + blood.mean * total(pressure)
    strong_residual, forcing, uniform = _strong_transposed(
        blood, velocity, grad_p, gradients, divergence
    )
    volume_rate = blood.mean * divergence
    known = (gradients, strong_residual, forcing, uniform, hydrostatic, volume_rate)
    known = fusion_barrier(known, shape)
    gradients, strong_residual, forcing, uniform, hydrostatic, volume_rate = known
    apart = [[component[a] - component[0] for a in LAST] for component in velocity]
    crossed = [
        [added(change.crossing[a][b] * apart[i][a] for a in range(3)) for b in range(3)]
        for i in range(3)
    ]
    rows = []
    for j in range(3):
        stress = [blood.shear * gradients[i][j] for i in range(3)]
        stress[j] = stress[j] + hydrostatic
        varying = [
            added(
                change.strong[i][b] * gradients[i][j] + blood.reaction[i][j] * crossed[i][b]
                for i in range(3)
            )
            for b in range(3)
        ]
        varying = [-added(varying), *varying]
        force = tuple(
            added(blood.A[4 * a + b] * velocity[j][a] for a in range(4))
            + blood.strong_residual[b] * strong_residual[j]
            + added(grad[i][b] * stress[i] for i in range(3))
            + varying[b]
            + uniform[j]
            + 0.2 * blood.mean * added(blood.reaction[i][j] * velocity[i][b] for i in range(3))
            for b in range(4)
        )
        rows.append(scatter(force, tets, n))
    continuity = tuple(
        added(grad[i][b] * forcing[i] for i in range(3)) - volume_rate for b in range(4)
    )
    return Unknowns(jnp.stack(rows), scatter(continuity, tets, n))


def _strong_transposed(
    blood: BloodTangent,
    velocity: Sequence[Corners],
    grad_p: Sequence[Float[Array, " tets"]],
    gradients: Sequence[Sequence[Float[Array, " tets"]]],
    divergence: Float[Array, " tets"],
):
    """What reaches the strong residual, the forcing, and all corners alike."""
    change = blood.coefficients
    sums = [total(component) for component in velocity]
    carried = [added(change.mean_strong[i] * gradients[i][j] for i in range(3)) for j in range(3)]
    strong_residual = [
        grad_p[j] - carried[j] - 0.25 * added(blood.reaction[i][j] * sums[i] for i in range(3))
        for j in range(3)
    ]
    forcing = [
        added(blood.upwind[a] * velocity[i][a] for a in range(4)) + blood.least * strong_residual[i]
        for i in range(3)
    ]
    slower = added(change.mean_strong[i] * forcing[i] for i in range(3))
    slower = 0.25 * (slower + change.swelling * divergence)
    pull = [0.25 * forcing[i] + 0.2 * blood.mean * sums[i] for i in range(3)]
    uniform = [
        added(blood.reaction[i][j] * pull[i] for i in range(3))
        + change.slowing[j] * slower
        + blood.mean * carried[j]
        for j in range(3)
    ]
    return strong_residual, forcing, uniform


def blood_diagonal(
    blood: BloodTangent, model: Model, shape: Geometry
) -> tuple[Float[Array, " nodes"], ...]:
    """Diagonal of the blood's share of momentum, of each component; zero in the wall.

    What the advecting velocity and the coefficients add is left out: it has either sign.
    """
    grad = shape.grad
    stress = blood.shear + blood.spread
    own = [tuple(blood.A[5 * a] + stress * grad[i][a] ** 2 for a in range(4)) for i in range(3)]
    own = fusion_barrier(own, shape)
    return tuple(scatter(corner, model.fluid_tets, model.n_nodes) for corner in own)
