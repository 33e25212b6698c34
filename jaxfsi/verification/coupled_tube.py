"""A short elastic tube between a pulsating inflow and a Windkessel: small, and with everything.

It serves for what any model must do, whatever its size: conserve volume, have correct derivatives,
run in a batch, and fail with a cause.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.stepper import Stepper
from jaxfsi.mesh import Mesh
from jaxfsi.meshing import tube
from lumped.blocks import RCR
from lumped.parameters import Parameter
from lumped.waveforms import Sinusoid

RADIUS, THICKNESS, LENGTH = 0.5, 0.1, 2.0
"""Inner radius, wall thickness and length of the tube [cm]."""

POISSON = 0.45
"""Poisson's ratio of the wall."""

PERIOD = 0.1
"""Period of the inflow [s]."""


class TubeParameters(NamedTuple):
    """Numbers of the problem that are differentiated.

    Attributes:
        R_proximal: of the outlet [dyn·s/cm⁵].
        C: of the outlet [cm⁵/dyn].
        R_distal: of the outlet [dyn·s/cm⁵].
        P_ref: of the outlet [dyn/cm²].
        E: Young's modulus [dyn/cm²].
        thickness: thickness of the wall [cm].
        amplitude: amplitude of the inflow [cm³/s].
        outwards: shift of one node of the inner wall along its radius [cm].
    """

    R_proximal: Parameter = 400.0
    C: Parameter = 2e-5
    R_distal: Parameter = 1500.0
    P_ref: Parameter = 500.0
    E: Parameter = 1.5e6
    thickness: Parameter = THICKNESS
    amplitude: Parameter = 4.0
    outwards: Parameter = 0.0


def coupled_mesh(*, n_around: int = 8, n_axial: int = 8, columns: bool = False) -> Mesh:
    """The tube with one layer of elements in its wall, in columns or not."""
    return tube(
        radius=RADIUS,
        length=LENGTH,
        thickness=THICKNESS,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=1,
        n_rings=2,
        columns=columns,
    )


def coupled_model(mesh: Mesh, *, wall_element: WallElement = "linear") -> Model:
    """The problem with its default parameters."""
    p = TubeParameters()
    inflow = Sinusoid(p.amplitude, p.amplitude, PERIOD, np.pi)
    return build_model(
        mesh,
        {
            "inlet": FlowPort(inflow),
            "outlet": BlockPort(RCR(p.R_proximal, p.C, p.R_distal, p.P_ref)),
        },
        blood=Blood(),
        wall=Wall(NeoHookean(p.E, POISSON), rho_s=1.1),
        wall_element=wall_element,
    )


def with_parameters(model: Model, parameters: TubeParameters) -> Model:
    """A model of `coupled_model` with other numbers; traced ones are fine."""
    p = parameters
    return dataclasses.replace(
        model,
        x=_shaped(model, p),
        ports=(
            FlowPort(Sinusoid(p.amplitude, p.amplitude, PERIOD, np.pi)),
            BlockPort(RCR(p.R_proximal, p.C, p.R_distal, p.P_ref)),
        ),
        wall=Wall(NeoHookean(p.E, POISSON), rho_s=1.1),
    )


@eqx.filter_jit
def outlet_pressure(
    parameters: TubeParameters, model: Model, state: State, stepper: Stepper, n_steps: int
) -> Float[Array, ""]:
    """Mean pressure of the outlet over the steps [dyn/cm²]; not a number where a step failed."""
    end = march(with_parameters(model, parameters), state, stepper, n_steps, throw=False)
    mean = jnp.mean(end.history.P_port[:, model.names.index("outlet")])
    return jnp.where(end.n_steps == n_steps, mean, jnp.nan)


@eqx.filter_jit
def outlet_pressure_gradient(
    parameters: TubeParameters, model: Model, state: State, stepper: Stepper, n_steps: int
) -> TubeParameters:
    """Derivative of `outlet_pressure` with respect to each parameter, in reverse mode."""
    return jax.grad(outlet_pressure)(parameters, model, state, stepper, n_steps)


@eqx.filter_jit
def outlet_pressure_slope(
    parameters: TubeParameters,
    direction: TubeParameters,
    model: Model,
    state: State,
    stepper: Stepper,
    n_steps: int,
) -> Float[Array, ""]:
    """Derivative of `outlet_pressure` along a change of parameters, in forward mode."""

    def pressure(p: TubeParameters) -> Float[Array, ""]:
        return outlet_pressure(p, model, state, stepper, n_steps)

    return jax.jvp(pressure, (parameters,), (direction,))[1]


def _shaped(model: Model, p: TubeParameters) -> Float[Array, "3 nodes"]:
    """Node positions: the wall's outer nodes along the normal, one inner node along its radius."""
    x = jax.lax.stop_gradient(model.x)
    r = jnp.hypot(x[0], x[1])
    normal = jnp.stack([x[0], x[1], jnp.zeros_like(r)]) / jnp.maximum(r, 1e-12)
    through = jnp.clip((r - RADIUS) / THICKNESS, 0.0, 1.0)
    wet = model.in_fluid & model.in_solid
    away = jnp.abs(x[2] - 0.6 * LENGTH) - 1e-3 * normal[0]
    chosen = jnp.arange(x.shape[1]) == jnp.argmin(jnp.where(wet, away, jnp.inf))
    return (
        model.x
        + (p.thickness - THICKNESS) * through * normal
        + p.outwards * jnp.where(chosen, normal, 0.0)
    )
