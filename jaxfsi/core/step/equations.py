"""The coupled equations of one step, as a residual in the new velocity and pressure.

The coefficients of the blood's equations (advecting velocity, unresolved velocity, stabilisation,
viscosity) belong to the iterate, see `relinearised`. Extrapolated they save a correction where flow
is slow; in a slit of 0.7 mm their error made a septum flutter apart at a drop of 20 mmHg and
Δt = 2 ms, which stays calm without it.

Only the geometry is explicit: the interface's displacement at the end of the step is extrapolated
from the last two, with second order, and moves the blood's mesh. To extrapolate by velocity and
acceleration is of the same order, but exaggerates the displacement fifty times, instead of
fourfold, where the wall's velocity alternates from step to step; the pressures on both sides of a
septum a millimetre thick then made it flutter at Δt = 2 ms.

Velocity of the wall and of the blood on it are one unknown, and the wall's displacement follows
from it by the rule of the method, so that the added mass of the blood is implicit.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import (
    Geometry,
    derivative_barrier,
    flux,
    fusion_barrier,
    geometry,
)
from jaxfsi.core.laws.contact import contact_force
from jaxfsi.core.laws.fluid import LaggedCoefficients, fluid_residual, lagged_coefficients
from jaxfsi.core.laws.interface import mid_edge_flux, mid_edge_load
from jaxfsi.core.laws.mesh_motion import MeshMotion, mesh_displacement
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.laws.wall_balance import WallShape, wall_geometry, wall_residual
from jaxfsi.core.ports.port import PortMotion, Traction
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from lumped.device import on_cpu
from lumped.parameters import Parameter


class Unknowns(NamedTuple):
    """Unknowns of a step, or residuals in their place.

    Attributes:
        u: velocity at the end of the step [cm/s]; residual of momentum [dyn].
        p: pressure at the end of the step [dyn/cm²]; residual of continuity [cm³/s].
    """

    u: Float[Array, "3 nodes"]
    p: Float[Array, " nodes"]


class Step(NamedTuple):
    """What stays the same while the equations of a step are solved.

    Attributes:
        dt: length of the step [s].
        state: state at its start.
        d_mesh: displacement of the mesh at its end [cm].
        x: node positions at t + α_f dt [cm].
        fluid_shape: geometry of the blood there.
        solid_shape: geometry of the wall in the reference configuration.
        coefficients: of the linearised fluid equations; at the extrapolated state where a step
            begins.
        u_prescribed: velocity of the prescribed nodes at the end of the step [cm/s].
        P_offset: pressure of each port at t + α_f dt without its flow [dyn/cm²].
        Z: derivative of that pressure with respect to the new flow [dyn·s/cm⁵].
    """

    dt: Parameter
    state: State
    d_mesh: Float[Array, "3 nodes"]
    x: Float[Array, "3 nodes"]
    fluid_shape: Geometry
    solid_shape: WallShape
    coefficients: LaggedCoefficients
    u_prescribed: Float[Array, "3 nodes"]
    P_offset: Float[Array, " ports"]
    Z: Float[Array, " ports"]


def prescribed_velocity(t: Parameter, model: Model) -> Float[Array, "3 nodes"]:
    """Velocity of the prescribed nodes at time t [cm/s]."""
    u = jnp.zeros((3, model.n_nodes))
    for port, surface in zip(model.ports, model.surfaces, strict=True):
        u = port.add_velocity(t, u, model.x, surface)
    return u


def extrapolated(t: Parameter, model: Model, state: State) -> Unknowns:
    """Velocity and pressure one step ahead, linear in time, with the prescribed velocity at t."""
    u = jnp.where(model.prescribed, prescribed_velocity(t, model), 2.0 * state.u - state.u_before)
    return Unknowns(u, 2.0 * state.p - state.p_before)


def begin_step(
    dt: Parameter, model: Model, state: State, method: GeneralizedAlpha, motion: MeshMotion | None
) -> Step:
    """Extrapolate the geometry and linearise the ports."""
    guess = extrapolated(state.t + dt, model, state)
    with jax.named_scope("mesh_motion"):
        d_mesh = _moved_mesh(dt, model, state, motion)
    alpha = method.alpha_f
    x = model.x + (state.d_mesh + alpha * (d_mesh - state.d_mesh))
    fluid_shape = geometry(x, model.fluid_tets)
    fluid_shape = fusion_barrier(fluid_shape, fluid_shape)
    solid_shape = wall_geometry(model.x, model.element)
    solid_shape = derivative_barrier(solid_shape, solid_shape)
    with jax.named_scope("ports"):
        tractions = _linearised_ports(dt, model, state, guess.u, x, method)
        u_prescribed = prescribed_velocity(state.t + dt, model)
    return Step(
        dt,
        state,
        d_mesh,
        x,
        fluid_shape,
        solid_shape,
        _coefficients(guess, dt, model, state, d_mesh, fluid_shape, method),
        u_prescribed,
        jnp.array([traction.P_offset for traction in tractions], float),
        jnp.array([traction.Z for traction in tractions], float),
    )


def _moved_mesh(
    dt: Parameter, model: Model, state: State, motion: MeshMotion | None
) -> Float[Array, "3 nodes"]:
    """Displacement of the mesh at the end of a step [cm]."""
    d_guess = 2.0 * state.d - state.d_before
    if motion is not None:
        moved = 0.0
        ports = zip(model.ports, state.port_states, model.surfaces, strict=True)
        for port, at_start, surface in ports:
            moved = port.add_displacement(state.t, dt, moved, at_start, surface)
        return mesh_displacement(motion, jnp.where(model.in_solid, d_guess, moved))
    if model.is_dry:  # loads on the wall follow it
        return jnp.where(model.in_solid, d_guess, 0.0)
    return state.d_mesh


def _linearised_ports(
    dt: Parameter,
    model: Model,
    state: State,
    u: Float[Array, "3 nodes"],
    x: Float[Array, "3 nodes"],
    method: GeneralizedAlpha,
) -> list[Traction]:
    """Pressure of each port in a step, linearised at the extrapolated velocity."""
    ports = zip(model.ports, state.port_states, model.surfaces, strict=True)
    return [
        port.linearise(state.t, dt, at_start, u, x, surface, method)
        for port, at_start, surface in ports
    ]


def relinearised(y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha) -> Step:
    """The step with the coefficients of the blood's equations at y."""
    known = (step.dt, model, step.state, step.d_mesh, step.fluid_shape)
    return step._replace(coefficients=_coefficients(y, *known, method))


def _coefficients(
    y: Unknowns,
    dt: Parameter,
    model: Model,
    state: State,
    d_mesh: Float[Array, "3 nodes"],
    shape: Geometry,
    method: GeneralizedAlpha,
) -> LaggedCoefficients:
    u, a, _, p = _between(y, dt, state, method)
    u_mesh = (d_mesh - state.d_mesh) / dt
    with jax.named_scope("stabilisation"):
        found = lagged_coefficients(dt, u, a, p, u_mesh, model.blood, model.fluid_tets, shape)
    return fusion_barrier(found, shape)


def residual(y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha) -> Unknowns:
    """Residual of the equations of a step; rows of prescribed unknowns hold their error."""
    if on_cpu():
        # As a branch, so that XLA does not repeat these sums at every corner of every element.
        u, a, d, p = jax.lax.cond(
            step.dt > 0.0,
            lambda: midpoint(y, step, method),
            lambda: (y.u, step.state.a, step.state.d, y.p),
        )
    else:
        u, a, d, p = midpoint(y, step, method)
    with jax.named_scope("blood"):
        r_u, r_p = fluid_residual(
            u,
            a,
            p - model.P_ambient,
            model.blood,
            step.coefficients,
            model.fluid_tets,
            step.fluid_shape,
        )
    if model.wall is not None:
        with jax.named_scope("wall"):
            r_u = r_u + wall_residual(
                u, a, d, model.wall, model.element, step.solid_shape, model.prestress
            )
            r_u = r_u + _support(u, d, model.wall, model)
    if model.contact is not None:
        with jax.named_scope("contact"):
            r_u = r_u + contact_force(d, model.x, model.contact)
    if model.mid_edge is not None:
        with jax.named_scope("interface"):
            r_u = r_u - mid_edge_load(p - model.P_ambient, step.x, model.mid_edge)
            r_p = r_p + mid_edge_flux(u, step.x, model.mid_edge)
    with jax.named_scope("ports"):
        r_u = r_u - _port_load(y, u, model, step)
    return Unknowns(
        jnp.where(model.prescribed, y.u - step.u_prescribed, r_u),
        jnp.where(model.in_fluid, r_p, y.p),
    )


_Midpoint = tuple[
    Float[Array, "3 nodes"],
    Float[Array, "3 nodes"],
    Float[Array, "3 nodes"],
    Float[Array, " nodes"],
]


def midpoint(y: Unknowns, step: Step, method: GeneralizedAlpha) -> _Midpoint:
    """Velocity, acceleration, displacement and pressure at which a step's equations hold."""
    return _between(y, step.dt, step.state, method)


def _between(y: Unknowns, dt: Parameter, old: State, method: GeneralizedAlpha) -> _Midpoint:
    a_new = method.acceleration(dt, old.u, old.a, y.u)
    d_new = method.displacement(dt, old.d, old.u, old.a, a_new)
    u = old.u + method.alpha_f * (y.u - old.u)
    a = old.a + method.alpha_m * (a_new - old.a)
    d = old.d + method.alpha_f * (d_new - old.d)
    p = old.p + method.alpha_f * (y.p - old.p)
    return u, a, d, p


def port_motion(u: Float[Array, "3 nodes"], model: Model, step: Step) -> PortMotion:
    """What the tractions of the ports depend on, with a velocity u at t + α_f dt [cm/s]."""
    return PortMotion(u, step.coefficients.c, step.x, model.blood.rho_f)


def _port_load(
    y: Unknowns, u: Float[Array, "3 nodes"], model: Model, step: Step
) -> Float[Array, "3 nodes"]:
    """Forces of all ports on the nodes [dyn]."""
    load = jnp.zeros_like(u)
    motion = port_motion(u, model, step)
    for i, (port, surface) in enumerate(zip(model.ports, model.surfaces, strict=True)):
        P = step.P_offset[i] + step.Z[i] * flux(y.u, step.x, surface.faces) - model.P_ambient
        load = port.add_load(load, P, motion, surface)
    return load


def _support(
    u: Float[Array, "3 nodes"], d: Float[Array, "3 nodes"], wall: Wall, model: Model
) -> Float[Array, "3 nodes"]:
    """Forces with which the wall pushes the tissue outside [dyn]."""
    return tissue_force(wall.support_stiffness * d + wall.support_damping * u, model)
