"""Navier-Stokes on moving linear tetrahedra with residual-based variational multiscales.

With the velocity relative to the mesh c = u − u_mesh, the unresolved velocity
u′ = −τ_M (ρ (a + c·∇u) + ∇p) and c* = c + u′, for all test functions v, q::

    ∫ v·ρ (a + c*·∇u) + ∫ ∇v : (2μ ε(u) − p I)
      − ∫ ∇v : ρ u′ ⊗ c* + ∫ τ_C ∇·v ∇·u                      = loads
    ∫ q ∇·u − ∫ ∇q·u′                                          = 0

    τ_M = 1/(ρ √(4/Δt² + c·G c + 36 (μ/ρ)² G:G)),  τ_C = 1/(τ_M tr G),  G = ∂ξ/∂xᵀ ∂ξ/∂x

Source: Bazilevs et al. 2007, eqs. 62-75, with the constants of svMultiPhysics. Here c, u′ in c*,
τ and μ are taken from a state extrapolated to the new time (`Frozen`), so that the equations are
linear in u, a and p; τ is constant on an element and all integrals are exact.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements import Geometry, added, corners, gradient, scatter, total, vector_corners
from jaxfsi.core.viscosity import AbstractViscosity, Newtonian
from lumped.parameters import Parameter, parameter


class Blood(eqx.Module):
    """What the blood is like.

    Attributes:
        rho_f: density [g/cm³].
        viscosity: viscosity law.
    """

    rho_f: Parameter = parameter(default=1.06)
    viscosity: AbstractViscosity = Newtonian()


class Frozen(NamedTuple):
    """Coefficients of the linearised equations.

    Attributes:
        c: velocity relative to the mesh at the nodes [cm/s].
        fine: unresolved velocity on each element [cm/s].
        tau_momentum: τ_M [cm³·s/g].
        tau_continuity: τ_C [g/(cm·s)].
        mu: viscosity on each element [g/(cm·s)].
    """

    c: Float[Array, "3 nodes"]
    fine: Float[Array, "3 tets"]
    tau_momentum: Float[Array, " tets"]
    tau_continuity: Float[Array, " tets"]
    mu: Float[Array, " tets"]


def _velocity_gradient(
    u: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"], shape: Geometry
) -> tuple[tuple[Float[Array, " tets"], ...], ...]:
    return tuple(gradient(component, shape) for component in vector_corners(u, tets))


def shear_rate(
    u: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"], shape: Geometry
) -> Float[Array, " tets"]:
    """√(2 ε:ε) on each element [1/s]."""
    g = _velocity_gradient(u, tets, shape)
    square = added((g[i][j] + g[j][i]) ** 2 / 2.0 for i in range(3) for j in range(3))
    # The square root has no derivative at rest.
    moving = square > 0.0
    return jnp.where(moving, jnp.sqrt(jnp.where(moving, square, 1.0)), 0.0)


def frozen(
    dt: Parameter,
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    u_mesh: Float[Array, "3 nodes"],
    blood: Blood,
    tets: Int[Array, "4 tets"],
    shape: Geometry,
) -> Frozen:
    """Coefficients of the linearised equations at an extrapolated state."""
    c = u - u_mesh
    mean = [total(component) / 4.0 for component in vector_corners(c, tets)]
    grad = shape.grad
    metric = [
        [added(grad[i, k] * grad[j, k] for k in (1, 2, 3)) for j in range(3)] for i in range(3)
    ]
    pairs = [(i, j) for i in range(3) for j in range(3)]
    mu = blood.viscosity(shear_rate(u, tets, shape))
    rate_square = (
        4.0 / dt**2
        + added(mean[i] * metric[i][j] * mean[j] for i, j in pairs)
        + 36.0 * (mu / blood.rho_f) ** 2 * added(metric[i][j] ** 2 for i, j in pairs)
    )
    tau_momentum = 1.0 / (blood.rho_f * jnp.sqrt(rate_square))
    tau_continuity = 1.0 / (tau_momentum * (metric[0][0] + metric[1][1] + metric[2][2]))
    slope = _velocity_gradient(u, tets, shape)
    acceleration = [total(component) / 4.0 for component in vector_corners(a, tets)]
    pressure = gradient(corners(p, tets), shape)
    fine = []
    for i in range(3):
        convection = added(mean[j] * slope[i][j] for j in range(3))
        strong = blood.rho_f * (acceleration[i] + convection) + pressure[i]
        fine.append(-tau_momentum * strong)
    return Frozen(c, jnp.stack(fine), tau_momentum, tau_continuity, mu)


def fluid_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    blood: Blood,
    coefficients: Frozen,
    tets: Int[Array, "4 tets"],
    shape: Geometry,
) -> tuple[Float[Array, "3 nodes"], Float[Array, " nodes"]]:
    """Residual of momentum [dyn] and of continuity [cm³/s] at each node.

    Args:
        u: velocity [cm/s].
        a: time derivative of the velocity at the nodes of the moving mesh [cm/s²].
        p: pressure [dyn/cm²].
        blood: what the blood is like.
        coefficients: see `frozen`.
        tets: elements of the blood.
        shape: their geometry at the time of evaluation.
    """
    n_nodes, V, grad = u.shape[1], shape.volume, shape.grad
    rho, tau, fine = blood.rho_f, coefficients.tau_momentum, coefficients.fine
    acceleration, pressure = vector_corners(a, tets), corners(p, tets)
    c = vector_corners(coefficients.c, tets)
    slope = _velocity_gradient(u, tets, shape)
    pressure_slope = gradient(pressure, shape)
    sum_c = [total(component) for component in c]
    sum_a = [total(component) for component in acceleration]
    divergence = slope[0][0] + slope[1][1] + slope[2][2]
    hydrostatic = V * (total(pressure) / 4.0 - coefficients.tau_continuity * divergence)

    def integral(f, g, sum_f, sum_g):
        """∫ f g over the element, exact for linear fields."""
        return V / 20.0 * (f[0] * g[0] + f[1] * g[1] + f[2] * g[2] + f[3] * g[3] + sum_f * sum_g)

    cc = [[integral(c[j], c[k], sum_c[j], sum_c[k]) for k in range(3)] for j in range(3)]
    momentum, fine_flux = [], []
    for i in range(3):
        convection = added(sum_c[j] * slope[i][j] for j in range(3))
        strong = V * (rho * (sum_a[i] + convection) / 4.0 + pressure_slope[i])
        fine_flux.append(tau * strong)
        stress = []
        for j in range(3):
            ca = integral(c[j], acceleration[i], sum_c[j], sum_a[i])
            upwind = rho * (ca + added(cc[j][k] * slope[i][k] for k in range(3)))
            upwind = upwind + V * sum_c[j] / 4.0 * pressure_slope[i] + fine[j] * strong
            stress.append(V * coefficients.mu * (slope[i][j] + slope[j][i]) + rho * tau * upwind)
        stress[i] = stress[i] - hydrostatic
        by_fine = 5.0 * added(fine[j] * slope[i][j] for j in range(3))
        force = []
        for b in range(4):
            through = added(c[j][b] * slope[i][j] for j in range(3)) + convection + by_fine
            inertia = rho * V / 20.0 * (acceleration[i][b] + sum_a[i] + through)
            force.append(inertia + added(grad[j, b] * stress[j] for j in range(3)))
        momentum.append(scatter(tuple(force), tets, n_nodes))
    continuity = tuple(
        V / 4.0 * divergence + added(grad[i, b] * fine_flux[i] for i in range(3)) for b in range(4)
    )
    return jnp.stack(momentum), scatter(continuity, tets, n_nodes)
