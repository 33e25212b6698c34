"""The equations of blood and wall as they stand on the page, slow and short.

One function an element: the weak form with corner values of the test functions v, q as arguments.
It is linear in them, so that its derivative by them is the residual. The kernels of `core.laws`
do the same sums in an order that XLA compiles well.

Linear elements; four quadrature points (Hammer, Marlowe & Stroud 1956), exact for quadratic fields.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.quadratic import FAR, NEAR
from jaxfsi.core.laws.fluid import Blood, LaggedCoefficients
from jaxfsi.core.laws.solid import Wall

Points = Float[Array, "4 3"]
Scalars = Float[Array, "4"]

POINTS = FAR + (NEAR - FAR) * jnp.eye(4)
"""Shape functions N_a at the quadrature points, which have equal weights."""

_I = jnp.eye(3)


def _shape(x: Points) -> tuple[Float[Array, "4 3"], Float[Array, ""]]:
    """∇N_a and volume of an element with corners x."""
    edges = x[1:] - x[0]
    others = jnp.linalg.inv(edges).T
    return jnp.concatenate([-jnp.sum(others, 0)[None], others]), jnp.linalg.det(edges) / 6.0


def _ddot(a: Float[Array, "3 3"], b: Float[Array, "3 3"]) -> Float[Array, ""]:
    return jnp.sum(a * b)


def blood_weak_form(v, q, u, a, p, c, fine, tau_M, tau_C, mu, rho, x) -> Float[Array, ""]:
    """Weak form of one element; equations as in `core.laws.fluid`."""
    dN, V = _shape(x)
    grad = lambda f: f.T @ dN  # noqa: E731  ∂f_i/∂x_j
    div = lambda f: jnp.trace(grad(f))  # noqa: E731
    form = jnp.zeros(())
    for N in POINTS:
        strong = rho * (N @ a + grad(u) @ (N @ c)) + grad(p)
        subscale = -tau_M * strong
        c_full = N @ c + fine
        sigma = mu * (grad(u) + grad(u).T) - (N @ p) * _I
        momentum = (
            (N @ v) @ (rho * (N @ a + grad(u) @ c_full))
            + _ddot(grad(v), sigma)
            - _ddot(grad(v), rho * jnp.outer(subscale, c_full))
            + tau_C * div(v) * div(u)
        )
        continuity = (N @ q) * div(u) - grad(q) @ subscale
        form = form + V / 4.0 * (momentum + continuity)
    return form


def wall_weak_form(v, u, a, d, S_0, wall: Wall, x) -> Float[Array, ""]:
    """Weak form of one linear element; equations as in `core.laws.solid`."""
    dN, V = _shape(x)
    F, F_rate = _I + d.T @ dN, u.T @ dN
    E_rate = (F.T @ F_rate + F_rate.T @ F) / 2.0
    PK1 = jnp.asarray(wall.material.stress(F)) + F @ (S_0 + 2.0 * wall.damping * E_rate)
    inertia = sum((N @ v) @ (wall.rho_s * (N @ a)) for N in POINTS) / 4.0
    return V * (inertia + _ddot(v.T @ dN, PK1))


def reference_blood_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    blood: Blood,
    coefficients: LaggedCoefficients,
    tets: Int[Array, "4 tets"],
    x: Float[Array, "3 nodes"],
) -> tuple[Float[Array, "3 nodes"], Float[Array, " nodes"]]:
    """Residual of momentum [dyn] and of continuity [cm³/s], as `core.laws.fluid.fluid_residual`."""
    k = coefficients

    def element(tet, fine, tau_M, tau_C, mu):
        fields = (u.T[tet], a.T[tet], p[tet], k.c.T[tet])
        zero = jnp.zeros((4, 3)), jnp.zeros(4)
        return jax.grad(blood_weak_form, (0, 1))(
            *zero, *fields, fine, tau_M, tau_C, mu, blood.rho_f, x.T[tet]
        )

    fine = jnp.stack(list(k.subscale), axis=1)
    r_v, r_q = jax.vmap(element)(tets.T, fine, k.tau_momentum, k.tau_continuity, k.mu)
    momentum = jnp.zeros_like(u.T).at[tets.T].add(r_v).T
    return momentum, jnp.zeros_like(p).at[tets.T].add(r_q)


def reference_wall_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    tets: Int[Array, "4 tets"],
    x: Float[Array, "3 nodes"],
    prestress: Float[Array, "3 3 tets"],
) -> Float[Array, "3 nodes"]:
    """Forces of the wall on each node [dyn], as `core.laws.solid.solid_residual`."""

    def element(tet, S_0):
        fields = (u.T[tet], a.T[tet], d.T[tet])
        return jax.grad(wall_weak_form)(jnp.zeros((4, 3)), *fields, S_0, wall, x.T[tet])

    forces = jax.vmap(element)(tets.T, jnp.moveaxis(prestress, 2, 0))
    return jnp.zeros_like(u.T).at[tets.T].add(forces).T
