"""An exact unsteady solution of the Navier-Stokes equations in three dimensions.

With ν = μ/ρ, (i, j, k) running through the cyclic permutations of the axes and s = exp(−ν d² t)::

    u_i = −a s (e^(a x_i) sin(a x_j + d x_k) + e^(a x_k) cos(a x_i + d x_j))
    p   = −ρ a² s²/2 Σ_i (e^(2 a x_i) + 2 sin(a x_i + d x_j) cos(a x_k + d x_i) e^(a (x_j + x_k)))

Convection balances the pressure, viscosity the decay. The box is filled with tetrahedra whose
inner nodes are shifted at random, and carries the velocity on all sides.

Source: Ethier & Steinman 1994, Int. J. Numer. Methods Fluids 19:369, eqs. 14-17.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.velocity import AbstractVelocity, VelocityPort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.meshing import strip
from jaxfsi.meshing.labels import label_faces
from lumped.parameters import Parameter, parameter

SHIFT = 0.15
"""Largest shift of the inner nodes along each axis over the size of the elements."""

_CYCLES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


class EthierSteinman(AbstractVelocity):
    """Parameters of the solution.

    Attributes:
        a: decay of the velocity in space [1/cm].
        d: wave number [1/cm].
        rho_f: density [g/cm³].
        mu: viscosity [g/(cm·s)].
    """

    a: Parameter = parameter(default=np.pi / 4.0)
    d: Parameter = parameter(default=np.pi / 2.0)
    rho_f: Parameter = parameter(default=1.0)
    mu: Parameter = parameter(default=0.1)

    @property
    def rate(self) -> Parameter:
        """ν d², at which the velocity decays [1/s]."""
        return self.mu / self.rho_f * self.d**2

    def __call__(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
        """Velocity [cm/s]."""
        a, d = self.a, self.d
        components = [
            jnp.exp(a * x[i]) * jnp.sin(a * x[j] + d * x[k])
            + jnp.exp(a * x[k]) * jnp.cos(a * x[i] + d * x[j])
            for i, j, k in _CYCLES
        ]
        return -a * jnp.exp(-self.rate * t) * jnp.stack(components)

    def pressure(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, " nodes"]:
        """Pressure [dyn/cm²]."""
        a, d = self.a, self.d
        terms = sum(
            jnp.exp(2.0 * a * x[i])
            + 2.0
            * jnp.sin(a * x[i] + d * x[j])
            * jnp.cos(a * x[k] + d * x[i])
            * jnp.exp(a * (x[j] + x[k]))
            for i, j, k in _CYCLES
        )
        return -0.5 * self.rho_f * a**2 * jnp.exp(-2.0 * self.rate * t) * terms


class BalancedVelocity(AbstractVelocity):
    """A velocity whose flow through the triangles of a closed surface is zero.

    Between the nodes the velocity is linear, and the flow of a field without sources through
    triangles is zero to the second order of their size only. The rest is taken out as the field of
    a uniform source, (x − x̄) times a factor.

    Attributes:
        field: the velocity.
        faces: triangles of the closed surface.
    """

    field: AbstractVelocity
    faces: Int[Array, "3 faces"]

    def __call__(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
        """Velocity [cm/s]."""
        u = self.field(t, x)
        source = x - jnp.mean(x, axis=1)[:, None]
        return u - flux(u, x, self.faces) / flux(source, x, self.faces) * source


def box_mesh(n: int) -> Mesh:
    """The cube [−1, 1]³ with n elements along each side; all of its surface is ``interface``."""
    solid = strip(length=2.0, width=2.0, thickness=2.0, n_length=n, n_width=n, n_layers=n)
    points = solid.points - 1.0
    inner = np.all(np.abs(points) < 1.0 - 1e-9, axis=1)
    shift = np.random.default_rng(0).uniform(-SHIFT, SHIFT, points.shape) * 2.0 / n
    points = points + np.where(inner[:, None], shift, 0.0)
    return label_faces(points, solid.tets, np.full_like(solid.region, int(Region.FLUID)), ())


def ethier_steinman_model(mesh: Mesh, solution: EthierSteinman) -> Model:
    """The solution's velocity on the whole surface of a mesh."""
    faces = jnp.asarray(mesh.labelled(INTERFACE).T)
    port = VelocityPort(BalancedVelocity(solution, faces))
    blood = Blood(solution.rho_f, Newtonian(solution.mu))
    return build_model(mesh, {INTERFACE: port}, blood=blood)


def ethier_steinman_state(
    t: Parameter, dt: Parameter, model: Model, solution: EthierSteinman
) -> State:
    """The exact state at time t, that at t − dt before it."""
    u, p = solution(t, model.x), solution.pressure(t, model.x)
    level = jnp.where(model.in_fluid, 0.0, p).sum()

    def counted(p: Float[Array, " nodes"]) -> Float[Array, " nodes"]:
        return jnp.where(model.in_fluid, p - level, 0.0)

    return initial_state(model, t=t)._replace(
        u=u,
        a=-solution.rate * u,
        p=counted(p),
        u_before=solution(t - dt, model.x),
        p_before=counted(solution.pressure(t - dt, model.x)),
    )


@eqx.filter_jit
def velocity_error(state: State, model: Model, solution: EthierSteinman) -> Float[Array, ""]:
    """‖u − u_exact‖/‖u_exact‖ in L₂, u_exact interpolated linearly between the nodes."""
    exact = solution(state.t, model.x)
    return norm(state.u - exact, model) / norm(exact, model)


def norm(u: Float[Array, "3 nodes"], model: Model) -> Float[Array, ""]:
    """(∫ |u|² dV)^½ of a velocity that is linear on each element."""
    corner = u[:, model.fluid_tets]
    edges = model.x[:, model.fluid_tets[1:]] - model.x[:, model.fluid_tets[:1]]
    volume = jnp.abs(jnp.linalg.det(jnp.moveaxis(edges, 2, 0))) / 6.0
    square = jnp.sum(corner**2, axis=(0, 1)) + jnp.sum(jnp.sum(corner, axis=1) ** 2, axis=0)
    return jnp.sqrt(jnp.sum(volume * square / 20.0))


def decay_error(n: int, n_steps: int, solution: EthierSteinman, *, t_end: float) -> float:
    """Relative L₂ error of the velocity at t_end [s] with n elements a side and n_steps steps."""
    model = ethier_steinman_model(box_mesh(n), solution)
    dt = t_end / n_steps
    stepper = prepare(dt, model, tolerance=1e-5, max_iterations=100)
    end = march(model, ethier_steinman_state(0.0, dt, model, solution), stepper, n_steps)
    return float(velocity_error(end.state, model, solution))
