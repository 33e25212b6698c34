"""A rigid tube that ends in a three-element Windkessel, driven by the flow of a recorded run.

In the periodic state each harmonic of the outlet's flow has the pressure Z(iω) Q; what the tube
does upstream is of no consequence for that relation. Case files of other codes add the histories
of both ports.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import Mesh
from jaxfsi.opening import Opening
from jaxfsi.verification.figures import Figure, figure
from lumped.blocks import RCR
from lumped.waveforms import Sampled

N_START = 10
"""Steps after the start, where the flow sets in with a jump, that are not compared."""


class PortHistory(NamedTuple):
    """Flows into the inlet and out of the outlet [cm³/s], pressures there [dyn/cm²], at t [s]."""

    t: Float[np.ndarray, " times"]
    Q_in: Float[np.ndarray, " times"]
    Q_out: Float[np.ndarray, " times"]
    P_in: Float[np.ndarray, " times"]
    P_out: Float[np.ndarray, " times"]


class WindkesselTube(NamedTuple):
    """Blood and outlet of the problem.

    Attributes:
        block: at the outlet.
        rho: density [g/cm³].
        mu: viscosity [g/(cm·s)].
    """

    block: RCR
    rho: float = 1.06
    mu: float = 0.04


SHORT_TUBE = WindkesselTube(RCR(R_proximal=121.0, C=1.5e-5, R_distal=1212.0))
"""A tube of 5 cm and radius 0.5 cm."""

LONG_TUBE = WindkesselTube(RCR(R_proximal=121.0, C=1.5e-4, R_distal=1212.0))
"""The case pipe3D_RCR of svFSI: 30 cm, radius 2 cm."""


SHORT_OPENINGS = (
    Opening("inlet", np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.6),
    Opening("outlet", np.array([0.0, 0.0, 5.0]), np.array([0.0, 0.0, 1.0]), 0.6),
)
"""Openings of the short tube."""


def windkessel_tube_model(
    mesh: Mesh,
    problem: WindkesselTube,
    inflow: PortHistory,
) -> Model:
    """The problem on a mesh, driven by the recorded inflow.

    Args:
        mesh: tube without a wall; one of its two openings has ``inlet`` in its name.
        problem: blood and outlet.
        inflow: its times must be those at which steps end.
    """
    t = np.concatenate([[0.0], inflow.t])
    Q = np.concatenate([[0.0], inflow.Q_in])
    wave = Sampled(
        times=jnp.asarray(t),
        values=jnp.asarray(Q),
        slopes=None,
        period=jnp.asarray(2.0 * t[-1]),
    )
    blood = Blood(problem.rho, Newtonian(problem.mu))
    inlet, outlet = _ends(mesh.openings)
    return build_model(mesh, {inlet: FlowPort(wave), outlet: BlockPort(problem.block)}, blood=blood)


def _ends(openings: tuple[str, ...]) -> tuple[str, str]:
    """The inlet, by its name, and the other opening."""
    inlet = next(name for name in openings if "inlet" in name)
    (outlet,) = (name for name in openings if name != inlet)
    return inlet, outlet


def periodic_pressure(Q: Float[np.ndarray, " times"], period: float, block: RCR) -> np.ndarray:
    """Pressure [dyn/cm²] of a Windkessel under one period of equally spaced flows [cm³/s]."""
    harmonics = np.fft.rfft(Q)
    s = 2j * np.pi * np.arange(len(harmonics)) / period
    R, C = float(block.R_distal), float(block.C)
    Z = float(block.R_proximal) + R / (1.0 + s * R * C)
    return np.fft.irfft(Z * harmonics, len(Q)) + float(block.P_ref)


def driven_pressure(
    Q: Float[np.ndarray, " times"], dt: float, block: RCR, *, held: bool = False
) -> Float[np.ndarray, " times"]:
    """Pressure [dyn/cm²] of a Windkessel at the ends of steps from rest, by exact integration.

    With τ = R_distal C and e = exp(−Δt/τ), over a step from Q₀ to Q₁ the inner pressure goes to
    e P_wk + R_distal ((1 − e) Q₀ + (1 − τ/Δt (1 − e)) (Q₁ − Q₀)).

    Args:
        Q: flow at the ends of the steps [cm³/s], 0 before.
        dt: length of a step [s].
        block: the Windkessel, with P_ref = 0.
        held: hold the flow of a step's end for the whole step, as some codes do, instead of
            taking it linear in time.
    """
    R, tau = float(block.R_distal), float(block.R_distal) * float(block.C)
    e = np.exp(-dt / tau)
    before = Q if held else np.concatenate([[0.0], Q[:-1]])
    rise = R * ((1.0 - e) * before + (1.0 - tau / dt * (1.0 - e)) * (Q - before))
    return lfilter([1.0], [1.0, -e], rise) + float(block.R_proximal) * Q


def history_error(P: np.ndarray, P_reference: np.ndarray) -> float:
    """Largest difference over the range of the reference."""
    return float(np.max(np.abs(P - P_reference)) / np.ptp(P_reference))


def range_error(P: np.ndarray, P_reference: np.ndarray) -> float:
    """Larger error of the extremes over the range of the reference."""
    gaps = [np.max(P) - np.max(P_reference), np.min(P) - np.min(P_reference)]
    return float(np.max(np.abs(gaps)) / np.ptp(P_reference))


def windkessel_figures(
    name: str, mesh: Mesh, problem: WindkesselTube, history: PortHistory, n_steps: int
) -> list[Figure]:
    """March along a recorded history and compare the pressures of both ports with it.

    The recorded runs hold the flow into the Windkessel over each step. The outlet is therefore
    compared twice: with the exact pressure under the flow computed here, and after that flow went
    through their rule, with their history. Where steps fill whole periods of one second, the range
    of the last one is compared with the closed form.

    Args:
        name: of the problem.
        mesh: tube without a wall; one of its two openings has ``inlet`` in its name.
        problem: blood and outlet.
        history: recorded at the end of each step.
        n_steps: steps to march.
    """
    dt = float(history.t[0])
    model = windkessel_tube_model(mesh, problem, history)
    stepper, state, ports = prepare(dt, model, tolerance=1e-4), initial_state(model), []
    chunk = math.gcd(n_steps, 40)
    for _ in range(n_steps // chunk):
        end = march(model, state, stepper, chunk)
        state = end.state
        ports.append((end.history.P_port, end.history.Q_port))
    P, Q = (np.concatenate(parts) for parts in zip(*ports, strict=True))
    i, j = (model.names.index(name) for name in _ends(mesh.openings))
    exact = driven_pressure(Q[:, j], dt, problem.block)
    theirs = driven_pressure(Q[:, j], dt, problem.block, held=True)
    drop = history.P_in[:n_steps] - history.P_out[:n_steps]
    gap = np.abs(P[:, i] - P[:, j] - drop)[N_START:]
    figures = [
        ("outlet pressure against its exact integral", history_error(P[:, j], exact), 1e-3),
        (
            "outlet pressure by the other code's rule",
            history_error(theirs, history.P_out[:n_steps]),
            0.01,
        ),
        ("outlet flow", history_error(Q[:, j], history.Q_out[:n_steps]), 0.01),
        ("inlet less outlet pressure, of the range", np.max(gap) / np.ptp(history.P_out), 0.01),
    ]
    n_period = round(1.0 / dt)
    if n_steps % n_period == 0:
        last = slice(n_steps - n_period, n_steps)
        closed = periodic_pressure(Q[last, j], 1.0, problem.block)
        figures.append(("range against the closed form", range_error(P[last, j], closed), 1e-3))
    return [figure(name, what, error, 0.0, target) for what, error, target in figures]
