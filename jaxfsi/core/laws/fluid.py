"""Navier-Stokes on moving linear tetrahedra with residual-based variational multiscales.

With the velocity relative to the mesh c = u − u_mesh, the unresolved velocity
u′ = −τ_M (ρ (a + c·∇u) + ∇p) and c* = c + u′, for all test functions v, q::

    ∫ v·ρ (a + c*·∇u) + ∫ ∇v : (2μ ε(u) − p I)
      − ∫ ∇v : ρ u′ ⊗ c* + ∫ τ_C ∇·v ∇·u                      = loads
    ∫ q ∇·u − ∫ ∇q·u′                                          = 0

    τ_M = 1/(ρ √(4/Δt² + s²)),  τ_C = ρ s/tr G,  s² = c·G c + 36 (μ/ρ)² G:G,  G = ∂ξ/∂xᵀ ∂ξ/∂x

Source: Bazilevs et al. 2007, eqs. 62-75, with the constants of svMultiPhysics, but for τ_C. There
it is 1/(τ_M tr G), which grows like 1/Δt and locks: it asks each linear element for no divergence,
and they have not enough freedom for that. A tube of 13 000 elements widens by 0.0113 cm under a
pulse with it, 0.0131 without, 0.0155 to 0.0159 being right, and takes more iterations.

Here c, u′ in c*, τ and μ are lagged: they are taken from a known state (`LaggedCoefficients`), so
that the equations are linear in u, a and p. τ is constant on an element; integrals are exact.
"""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import (
    Geometry,
    added,
    corners,
    derivative_barrier,
    fusion_barrier,
    gradient,
    scatter,
    total,
    vector_corners,
)
from jaxfsi.core.laws.viscosity import AbstractViscosity, Newtonian
from jaxfsi.nominal import BLOOD_DENSITY
from lumped.parameters import Parameter, Range, check_range, parameter


class Blood(eqx.Module):
    """What the blood is like.

    Attributes:
        rho_f: density [g/cm³].
        viscosity: viscosity law.
        transient_continuity: whether τ_C = 1/(τ_M tr G), to compare with other codes (static).
    """

    ranges: ClassVar[Range] = Range(above=("rho_f",))
    rho_f: Parameter = parameter(default=BLOOD_DENSITY)
    viscosity: AbstractViscosity = Newtonian()
    transient_continuity: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        """Refuse a density that is not positive; a traced one passes.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)


class LaggedCoefficients(NamedTuple):
    """Coefficients of the linearised equations.

    Attributes:
        c: advecting velocity, relative to the mesh, at the nodes [cm/s].
        subscale: unresolved velocity u′ on each element [cm/s].
        tau_momentum: τ_M [cm³·s/g].
        tau_continuity: τ_C [g/(cm·s)].
        mu: viscosity on each element [g/(cm·s)].
    """

    c: Float[Array, "3 nodes"]
    subscale: tuple[Float[Array, " tets"], ...]
    tau_momentum: Float[Array, " tets"]
    tau_continuity: Float[Array, " tets"]
    mu: Float[Array, " tets"]


def velocity_gradient(
    u: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"], shape: Geometry
) -> tuple[tuple[Float[Array, " tets"], ...], ...]:
    """∂u_i/∂x_j on each element [1/s]."""
    return tuple(gradient(component, shape) for component in vector_corners(u, tets))


def shear_rate(
    g: Sequence[Sequence[Float[Array, " tets"]]] | Float[Array, "3 3 tets"],
) -> Float[Array, " tets"]:
    """√(2 ε:ε) on each element or at each node [1/s], of the velocity's gradient there."""
    square = added((g[i][j] + g[j][i]) ** 2 / 2.0 for i in range(3) for j in range(3))
    # The square root has no derivative at rest.
    moving = square > 0.0
    return jnp.where(moving, jnp.sqrt(jnp.where(moving, square, 1.0)), 0.0)


def viscous_rate_squared(mu: Any, rho_f: Any, square: Any) -> Any:
    """Viscous part of s², 36 (μ/ρ)² G:G [1/s²], of JAX or NumPy arrays.

    Args:
        mu: viscosity [g/(cm·s)].
        rho_f: density [g/cm³].
        square: G:G [1/cm⁴].
    """
    return 36.0 * (mu / rho_f) ** 2 * square


def stabilisation_parameters(
    dt: Any, steady: Any, trace: Any, rho_f: Any, transient_continuity: bool, *, xp: Any = jnp
) -> tuple[Any, Any]:
    """τ_M [cm³·s/g] and τ_C [g/(cm·s)] of each element.

    Args:
        dt: length of the step [s].
        steady: s² [1/s²].
        trace: tr G [1/cm²].
        rho_f: density [g/cm³].
        transient_continuity: see `Blood`.
        xp: ``jax.numpy``, or ``numpy`` for matrices that are made once.
    """
    rate = xp.sqrt(4.0 / dt**2 + steady)
    spread = rate if transient_continuity else xp.sqrt(steady)
    return 1.0 / (rho_f * rate), rho_f * spread / trace


def lagged_coefficients(
    dt: Parameter,
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    u_mesh: Float[Array, "3 nodes"],
    blood: Blood,
    tets: Int[Array, "4 tets"],
    shape: Geometry,
) -> LaggedCoefficients:
    """Coefficients of the linearised equations at a known state."""
    c = u - u_mesh
    grad = shape.grad
    metric = [
        [added(grad[i][k] * grad[j][k] for k in (1, 2, 3)) for j in range(3)] for i in range(3)
    ]
    pairs = [(i, j) for i in range(3) for j in range(3)]
    mean = [total(component) / 4.0 for component in vector_corners(c, tets)]
    acceleration = [total(component) / 4.0 for component in vector_corners(a, tets)]
    mean, acceleration, grad_u, pressure, metric = derivative_barrier(
        (
            mean,
            acceleration,
            velocity_gradient(u, tets, shape),
            gradient(corners(p, tets), shape),
            metric,
        ),
        shape,
    )
    mu = blood.viscosity(shear_rate(grad_u))
    square = added(metric[i][j] ** 2 for i, j in pairs)
    steady = added(mean[i] * metric[i][j] * mean[j] for i, j in pairs)
    steady = steady + viscous_rate_squared(mu, blood.rho_f, square)
    steady, mu = derivative_barrier((steady, mu), shape)
    trace = metric[0][0] + metric[1][1] + metric[2][2]
    tau_momentum, tau_continuity = stabilisation_parameters(
        dt, steady, trace, blood.rho_f, blood.transient_continuity
    )
    tau_momentum, tau_continuity = derivative_barrier((tau_momentum, tau_continuity), shape)
    subscale = []
    for i in range(3):
        convection = added(mean[j] * grad_u[i][j] for j in range(3))
        strong_residual = blood.rho_f * (acceleration[i] + convection) + pressure[i]
        subscale.append(-tau_momentum * strong_residual)
    return LaggedCoefficients(c, tuple(subscale), tau_momentum, tau_continuity, mu)


def fluid_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    blood: Blood,
    coefficients: LaggedCoefficients,
    tets: Int[Array, "4 tets"],
    shape: Geometry,
) -> tuple[Float[Array, "3 nodes"], Float[Array, " nodes"]]:
    """Residual of momentum [dyn] and of continuity [cm³/s] at each node.

    `verification.reference_residual` is the same as on the page; `solve.blood_tangent` is the
    derivative.

    Args:
        u: velocity [cm/s].
        a: time derivative of the velocity at the nodes of the moving mesh [cm/s²].
        p: pressure [dyn/cm²].
        blood: what the blood is like.
        coefficients: see `lagged_coefficients`.
        tets: elements of the blood.
        shape: their geometry at the time of evaluation.
    """
    n_nodes, V = u.shape[1], shape.volume
    rho, tau, subscale = blood.rho_f, coefficients.tau_momentum, coefficients.subscale
    c, acceleration, velocity, pressure = derivative_barrier(
        (
            vector_corners(coefficients.c, tets),
            vector_corners(a, tets),
            vector_corners(u, tets),
            corners(p, tets),
        ),
        shape,
    )
    grad_u = tuple(gradient(component, shape) for component in velocity)
    grad_p = gradient(pressure, shape)
    sum_c = [total(component) for component in c]
    sum_a = [total(component) for component in acceleration]
    divergence = grad_u[0][0] + grad_u[1][1] + grad_u[2][2]
    hydrostatic = V * (total(pressure) / 4.0 - coefficients.tau_continuity * divergence)
    grad_u, grad_p, divergence, hydrostatic, sum_c, sum_a = fusion_barrier(
        (grad_u, grad_p, divergence, hydrostatic, sum_c, sum_a), shape
    )

    def integral(f, g, sum_f, sum_g):
        """∫ f g over the element, exact for linear fields."""
        return V / 20.0 * (f[0] * g[0] + f[1] * g[1] + f[2] * g[2] + f[3] * g[3] + sum_f * sum_g)

    cc = [[integral(c[j], c[k], sum_c[j], sum_c[k]) for k in range(3)] for j in range(3)]
    ca = [[integral(c[j], acceleration[i], sum_c[j], sum_a[i]) for j in range(3)] for i in range(3)]
    convection = [added(sum_c[j] * grad_u[i][j] for j in range(3)) for i in range(3)]
    strong_residual = [V * (rho * (sum_a[i] + convection[i]) / 4.0 + grad_p[i]) for i in range(3)]
    cc, ca, convection, strong_residual = derivative_barrier(
        (cc, ca, convection, strong_residual), shape
    )
    stresses, by_subscale = [], []
    for i in range(3):
        stress = []
        for j in range(3):
            upwind = rho * (ca[i][j] + added(cc[j][k] * grad_u[i][k] for k in range(3)))
            upwind = upwind + V * sum_c[j] / 4.0 * grad_p[i] + subscale[j] * strong_residual[i]
            stress.append(V * coefficients.mu * (grad_u[i][j] + grad_u[j][i]) + rho * tau * upwind)
        stress[i] = stress[i] - hydrostatic
        stresses.append(stress)
        by_subscale.append(5.0 * added(subscale[j] * grad_u[i][j] for j in range(3)))
    stresses, by_subscale = fusion_barrier((stresses, by_subscale), shape)
    momentum = []
    for i in range(3):
        force = []
        for b in range(4):
            through = (
                added(c[j][b] * grad_u[i][j] for j in range(3)) + convection[i] + by_subscale[i]
            )
            inertia = rho * V / 20.0 * (acceleration[i][b] + sum_a[i] + through)
            pull = added(shape.grad[j][b] * stresses[i][j] for j in range(3))
            force.append(inertia + pull)
        force = derivative_barrier(tuple(force), shape)
        momentum.append(scatter(force, tets, n_nodes))
    continuity = tuple(
        V / 4.0 * divergence + added(shape.grad[i][b] * tau * strong_residual[i] for i in range(3))
        for b in range(4)
    )
    return jnp.stack(momentum), scatter(continuity, tets, n_nodes)
