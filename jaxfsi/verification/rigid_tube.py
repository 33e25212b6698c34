"""Steady and oscillating flow in a rigid tube between two pressures.

The pressure of the inlet is mean + amplitude · cos ωt, that of the outlet zero. What is compared
lies in the middle of the tube, away from the ends: the pressures act there on the whole stress of
the blood, which bends its streamlines over about a radius. Poiseuille's flow is the case ω → 0::

    w(r) = G/(4μ) (R² − r²),  Q = π R⁴ G/(8μ)
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Complex, Float

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import Mesh
from jaxfsi.verification.womersley import (
    impedance_per_length,
    velocity_shape,
    womersley_number,
)
from lumped.waveforms import Sinusoid

TOLERANCE, MAX_ITERATIONS = 1e-4, 60
"""Of the steps: their errors stay far below those of the mesh."""


class RigidTube(NamedTuple):
    """A rigid tube and the pressure at its inlet.

    Attributes:
        radius: of the lumen [cm].
        length: of the tube [cm].
        rho: density [g/cm³].
        mu: viscosity [g/(cm·s)].
        mean: mean pressure of the inlet [dyn/cm²].
        amplitude: its amplitude [dyn/cm²].
        period: its period [s].
    """

    radius: float = 0.5
    length: float = 2.0
    rho: float = 1.0
    mu: float = 0.1
    mean: float = 0.0
    amplitude: float = 0.0
    period: float = 1.0

    @property
    def omega(self) -> float:
        """Angular frequency [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def alpha(self) -> float:
        """Womersley number."""
        return womersley_number(self.radius, self.omega, self.rho, self.mu)


def rigid_tube_model(mesh: Mesh, problem: RigidTube) -> Model:
    """The problem on a mesh of `round_tube`."""
    waves = [
        PressurePort(Sinusoid(share * problem.mean, share * problem.amplitude, problem.period))
        for share in (1.0, 0.0)
    ]
    blood = Blood(problem.rho, Newtonian(problem.mu))
    return build_model(mesh, {"inlet": waves[0], "outlet": waves[1]}, blood=blood)


def developed_state(t: float, dt: float, model: Model, problem: RigidTube) -> State:
    """The exact flow of an endless tube at time t [s], that at t − dt before it."""
    x, y, z = np.asarray(model.x)
    turns = np.exp(1j * problem.omega * np.array([t, t - dt]))
    (u, p), (u_before, p_before) = (_developed(turn, x, y, z, problem) for turn in turns)
    a, _ = _developed(1j * problem.omega * turns[0], x, y, z, problem._replace(mean=0.0))

    def along(w: Float[np.ndarray, " nodes"]):
        field = np.stack([np.zeros_like(w), np.zeros_like(w), w])
        return jnp.where(model.prescribed, 0.0, jnp.asarray(field))

    return initial_state(model, t=t)._replace(
        u=along(u),
        a=along(a),
        p=jnp.asarray(p),
        u_before=along(u_before),
        p_before=jnp.asarray(p_before),
    )


def _developed(turn: complex, x, y, z, problem: RigidTube) -> tuple[np.ndarray, np.ndarray]:
    r = np.minimum(np.hypot(x, y), problem.radius)
    steady = (problem.radius**2 - r**2) / (4.0 * problem.mu) * problem.mean / problem.length
    shape = velocity_shape(r, problem.radius, problem.alpha) / (1j * problem.omega * problem.rho)
    wave = problem.amplitude * turn
    w = steady + np.real(shape * wave) / problem.length
    return w, (problem.mean + np.real(wave)) * (1.0 - z / problem.length)


class MidSection(NamedTuple):
    """What is measured in the middle of the tube.

    Attributes:
        r: distance from the axis of the nodes of the section at mid-length [cm].
        w: their velocity along the axis [cm/s].
        gradient: −∂p/∂z between the sections at a third and two thirds of the length [dyn/cm³].
        flow: through the outlet [cm³/s].
    """

    r: Float[np.ndarray, " section"]
    w: Float[np.ndarray, " section"]
    gradient: float
    flow: float


def middle_section(state: State, model: Model, problem: RigidTube) -> MidSection:
    """Velocity, pressure gradient and flow of a state."""
    x, y, z = np.asarray(model.x)
    near, middle, far = (_nearest(z, share * problem.length) for share in (1 / 3, 1 / 2, 2 / 3))
    p = np.asarray(state.p)
    drop = np.mean(p[near]) - np.mean(p[far])
    return MidSection(
        np.hypot(x, y)[middle],
        np.asarray(state.u)[2, middle],
        float(drop / (np.mean(z[far]) - np.mean(z[near]))),
        float(flux(state.u, model.x, model.port_faces[model.names.index("outlet")])),
    )


def _nearest(z: Float[np.ndarray, " nodes"], height: float) -> Bool[np.ndarray, " nodes"]:
    away = np.abs(z - height)
    return away < np.min(away) + 1e-9


class FlowErrors(NamedTuple):
    """Errors of a computed flow.

    Attributes:
        resistance: relative error of pressure gradient over flow, a complex one's modulus.
        profile: relative L₂ error of the velocity over the nodes of the section, at the computed
            gradient.
    """

    resistance: float
    profile: float


def poiseuille_errors(section: MidSection, problem: RigidTube) -> FlowErrors:
    """A steady section against Poiseuille's flow."""
    exact = 8.0 * problem.mu / (np.pi * problem.radius**4)
    peak = section.gradient * problem.radius**2 / (4.0 * problem.mu)
    shape = np.maximum(1.0 - (section.r / problem.radius) ** 2, 0.0)
    return FlowErrors(
        abs(section.gradient / section.flow / exact - 1.0),
        float(np.linalg.norm(section.w / peak - shape) / np.linalg.norm(shape)),
    )


def womersley_errors(cosine: MidSection, sine: MidSection, problem: RigidTube) -> FlowErrors:
    """Sections at ωt = 0 and ωt = 3π/2 (modulo 2π) against Womersley's flow.

    A quantity Re(A e^(iωt)) has the values Re A and Im A there.
    """
    gradient = complex(cosine.gradient, sine.gradient)
    flow = complex(cosine.flow, sine.flow)
    w: Complex[np.ndarray, " section"] = cosine.w + 1j * sine.w
    exact = impedance_per_length(problem.radius, problem.omega, problem.rho, problem.mu)
    r = np.minimum(cosine.r, problem.radius)
    drive = gradient / (1j * problem.omega * problem.rho)
    w_exact = drive * velocity_shape(r, problem.radius, problem.alpha)
    return FlowErrors(
        abs(gradient / flow / exact - 1.0),
        float(np.linalg.norm(w - w_exact) / np.linalg.norm(w_exact)),
    )


def steady_errors(mesh: Mesh, problem: RigidTube, *, n_steps: int) -> FlowErrors:
    """March the steady problem over a few times of diffusion, R²/ν.

    Args:
        mesh: the tube.
        problem: with a mean pressure alone.
        n_steps: number of steps.
    """
    model = rigid_tube_model(mesh, problem)
    dt = 3.0 * problem.radius**2 * problem.rho / problem.mu / n_steps
    stepper = prepare(dt, model, tolerance=TOLERANCE, max_iterations=MAX_ITERATIONS)
    end = march(model, developed_state(0.0, dt, model, problem), stepper, n_steps)
    return poiseuille_errors(middle_section(end.state, model, problem), problem)


def oscillating_errors(mesh: Mesh, problem: RigidTube, *, n_quarter: int) -> FlowErrors:
    """March the oscillating problem over two periods from the flow of an endless tube.

    Args:
        mesh: the tube.
        problem: with an amplitude alone.
        n_quarter: steps in a quarter of a period.
    """
    model = rigid_tube_model(mesh, problem)
    dt = problem.period / (4 * n_quarter)
    stepper = prepare(dt, model, tolerance=TOLERANCE, max_iterations=MAX_ITERATIONS)
    state = developed_state(0.0, dt, model, problem)
    sections = []
    for _ in range(8):
        state = march(model, state, stepper, n_quarter).state
        sections.append(middle_section(state, model, problem))
    return womersley_errors(sections[-1], sections[-2], problem)
