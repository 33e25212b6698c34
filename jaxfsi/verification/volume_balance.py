"""Volume of blood that enters, leaves and fills the wall's room.

The continuity equations of a step, added up over all nodes, leave the divergence alone: what
stabilises the pressure has a gradient of the test function in it, and their sum is uniform. Hence,
exactly but for the tolerance of the solve, with u and the mesh at t + α_f Δt::

    Σ_ports ∫ u·n + ∫_wall u·n = 0

The room that the wall encloses is that of its displacement d. It changes at the rate ∫_wall u·n to
the second order in Δt, the order of the method. With the net outflow Q at the ends of N steps the
sum over the inner times is the integral to that order::

    ∫ Q dt = Δt Σ Q(t_n + α_f Δt) − Δt (α_f − ½) (Q_N − Q_0) + O(Δt²)
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import area_vectors, flux
from jaxfsi.core.laws.interface import mid_edge_flux
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.step import StepReport, advance_step
from jaxfsi.core.step.stepper import Stepper
from jaxfsi.mesh import INTERFACE, Mesh


class Balance(NamedTuple):
    """Volume flows of a step at t + α_f Δt.

    Attributes:
        ports: out of all openings [cm³/s].
        wall: into the room that the wall gives way to [cm³/s].
        through: Σ |Q| of the ports [cm³/s].
    """

    ports: Float[Array, "*steps"]
    wall: Float[Array, "*steps"]
    through: Float[Array, "*steps"]


def wet_wall(mesh: Mesh) -> Int[Array, "3 faces"]:
    """Triangles between blood and wall, out of the blood."""
    return jnp.asarray(mesh.labelled(INTERFACE).T)


def wet_ports(model: Model) -> Float[Array, " ports"]:
    """1 for each port that is an opening of the blood, 0 where a pressure acts on the wall."""
    wet = [jnp.mean(model.in_fluid[faces].astype(float)) > 0.5 for faces in model.port_faces]
    return jnp.stack(wet).astype(float)


def balance(
    before: State,
    after: State,
    model: Model,
    method: GeneralizedAlpha,
    wall: Int[Array, "3 faces"],
) -> Balance:
    """Volume flows between two successive states.

    Args:
        before: state at t.
        after: state at t + Δt.
        model: the model.
        method: coefficients of the step.
        wall: see `wet_wall`.
    """
    alpha = method.alpha_f
    x = model.x + before.d_mesh + alpha * (after.d_mesh - before.d_mesh)
    u = before.u + alpha * (after.u - before.u)
    Q = jnp.stack([flux(u, x, faces) for faces in model.port_faces]) * wet_ports(model)
    given = flux(u, x, wall)
    if model.mid_edge is not None:
        given = given + jnp.sum(mid_edge_flux(u, x, model.mid_edge))
    return Balance(jnp.sum(Q), given, jnp.sum(jnp.abs(Q)))


def lumen_volume(state: State, model: Model, wall: Int[Array, "3 faces"]) -> Float[Array, ""]:
    """Volume that wall and openings enclose [cm³], by ⅓ ∫ x·n over their triangles, and the bows.

    The bows' volume is right to the first order in their height.
    """
    x = model.x + jnp.where(model.in_solid, state.d, state.d_mesh)

    def share(faces: Int[Array, "3 faces"]) -> Float[Array, ""]:
        return jnp.sum(jnp.mean(x[:, faces], axis=1) * area_vectors(x, faces)) / 3.0

    openings = jnp.stack([share(faces) for faces in model.port_faces])
    volume = share(wall) + jnp.sum(wet_ports(model) * openings)
    if model.mid_edge is not None:
        volume = volume + jnp.sum(mid_edge_flux(state.d, x, model.mid_edge))
    return volume


class Bookkeeping(NamedTuple):
    """What went in, out and stayed over a number of steps.

    Attributes:
        state: at the end.
        balance: of each step.
        volume: change of the lumen's volume [cm³].
        outflow: net volume that left by the ports [cm³].
        report: of each step.
        passed: volume that passed the ports, half of what went through all of them [cm³].
    """

    state: State
    balance: Balance
    volume: Float[Array, ""]
    outflow: Float[Array, ""]
    report: StepReport
    passed: Float[Array, ""]


@eqx.filter_jit
def keep_books(
    model: Model, state: State, stepper: Stepper, wall: Int[Array, "3 faces"], n_steps: int
) -> Bookkeeping:
    """March and write down the volume flows of every step."""

    def one(before: State, _):
        after, report = advance_step(model, before, stepper)
        return after, (balance(before, after, model, stepper.method, wall), report)

    end, (flows, report) = jax.lax.scan(one, state, None, length=n_steps)
    change = lumen_volume(end, model, wall) - lumen_volume(state, model, wall)
    ends = jnp.sum(wet_ports(model) * (end.Q_port - state.Q_port))
    outflow = stepper.dt * (jnp.sum(flows.ports) - (stepper.method.alpha_f - 0.5) * ends)
    passed = stepper.dt * jnp.sum(flows.through) / 2.0
    return Bookkeeping(end, flows, change, outflow, report, passed)


class VolumeErrors(NamedTuple):
    """Volumes that are unaccounted for, over the volume that passed the ports.

    Attributes:
        equation: largest |ports + wall| of a step, over the mean throughput.
        cycle: |change of the lumen + net outflow| at the end.
    """

    equation: float
    cycle: float


def volume_errors(books: Bookkeeping) -> VolumeErrors:
    """Relative errors of the balance over all steps."""
    ports, through = np.asarray(books.balance.ports), np.asarray(books.balance.through)
    leak = np.abs(ports + np.asarray(books.balance.wall))
    return VolumeErrors(
        float(np.max(leak) / np.mean(through / 2.0)),
        float(abs(books.volume + books.outflow) / books.passed),
    )
