"""The linearised step, applied element by element.

The blood's share is that of `solve.blood_tangent`, the wall's that of `solve.wall_tangent`; to them
come what acts on surfaces: tissue outside, contact, mid-edge modes and ports. The derivative of the
advecting velocity in the backflow stabilisation of a port is neglected.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.contact import contact_product, contact_slope
from jaxfsi.core.laws.interface import mid_edge_flux, mid_edge_load
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.solve.blood_tangent import (
    BloodTangent,
    apply_blood,
    apply_blood_transposed,
    blood_tangent,
)
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
from lumped.parameters import Parameter


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


def step_tangent(
    y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha, kept: Parameter = 1.0
) -> StepTangent:
    """Linearise the equations of a step about y; for `kept` see `blood_tangent`."""
    wall = None
    u, a, d, _ = midpoint(y, step, method)
    if model.wall is not None:
        weights = Weights(*method.weights(step.dt))
        wall = wall_tangent(
            u, d, weights, model.wall, model.element, step.solid_shape, model.prestress
        )
    contact = None
    if model.contact is not None:
        contact = contact_slope(d, model.x, model.contact)
    return StepTangent(blood_tangent(u, a, model, step, method, kept), wall, contact)


def apply_elements(
    tangent: StepTangent, v: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> Unknowns:
    """Product of the linearised step and a change of velocity and pressure, by elements."""
    blood = apply_blood(tangent.blood, v, model, step.fluid_shape)
    r_u, r_p = _at_surfaces(tangent, v, model, step, method)
    if tangent.wall is not None:
        r_u = r_u + apply_wall(tangent.wall, v.u, model.element, step.solid_shape)
    r = Unknowns(r_u + blood.u, r_p + blood.p)
    return Unknowns(jnp.where(model.prescribed, v.u, r.u), jnp.where(model.in_fluid, r.p, v.p))


def apply_elements_transposed(
    tangent: StepTangent, v: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> Unknowns:
    """Product of the transposed linearised step and v, by elements.

    Written out, since the transpose that JAX derives takes three times as long as the product. A_ab
    becomes A_ba, the reaction's matrix is transposed, and G and D change places: upwinding with the
    strong residual, and the mean with its sign.
    """
    # rows of prescribed unknowns are those of the identity
    own = Unknowns(jnp.where(model.prescribed, v.u, 0.0), jnp.where(model.in_fluid, 0.0, v.p))
    v = Unknowns(jnp.where(model.prescribed, 0.0, v.u), jnp.where(model.in_fluid, v.p, 0.0))
    blood = apply_blood_transposed(tangent.blood, v, model, step.fluid_shape)
    surfaces = jax.linear_transpose(lambda v: _at_surfaces(tangent, v, model, step, method), v)
    (r,) = surfaces(v)
    r_u = own.u + r.u + blood.u
    if tangent.wall is not None:
        r_u = r_u + apply_wall_transposed(tangent.wall, v.u, model.element, step.solid_shape)
    return Unknowns(r_u, own.p + r.p + blood.p)


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
