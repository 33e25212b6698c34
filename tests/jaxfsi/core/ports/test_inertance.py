"""A resistance and an inertance behind a rigid tube, against the closed form of their circuit."""

import equinox as eqx
import numpy as np
import pytest

from jaxfsi import core, meshing
from jaxfsi.core.step.step import advance_step
from lumped import Sinusoid

R, L, P_REF = 300.0, 50.0, 200.0
MEAN, AMPLITUDE, PERIOD = 1000.0, -800.0, 0.2  # P_ref at t = 0: the flow starts smoothly


def _exact_flow(t):
    """L dQ/dt + R Q = P(t) − P_ref from rest, P = MEAN + AMPLITUDE cos(ωt)."""
    omega, rate = 2.0 * np.pi / PERIOD, R / L
    wave = AMPLITUDE / complex(R, omega * L)
    steady = (MEAN - P_REF) / R
    return steady * (1.0 - np.exp(-rate * t)) + np.real(
        wave * (np.exp(1j * omega * t) - np.exp(-rate * t))
    )


@pytest.fixture(scope="module")
def model():
    # A short wide tube: its own inertance 1.06·0.2/(π 0.5²) = 0.3 is 0.5 % of L, its friction less.
    mesh = meshing.tube(radius=0.5, length=0.2, thickness=0.1, n_around=8, n_axial=2, n_layers=0)
    ports = {
        "inlet": core.PressurePort(Sinusoid(MEAN, AMPLITUDE, PERIOD)),
        "outlet": core.ResistanceInertancePort(R, L, P_REF),
    }
    return core.build_model(mesh, ports)


def _flow(model, n_steps, t_end=0.1):
    """Step by step, so that one program serves all numbers of steps."""
    stepper = core.prepare(t_end / n_steps, model, tolerance=1e-6, max_iterations=100)
    step, state, found = eqx.filter_jit(advance_step), core.initial_state(model, p=P_REF), []
    for _ in range(n_steps):
        state, report = step(model, state, stepper)
        assert report.result == core.RESULTS.successful
        found.append((float(state.t), float(state.Q_port[1])))
    return np.array(found).T


def test_flow_is_that_of_the_circuit(model):
    t, Q = _flow(model, 40)
    exact = _exact_flow(t)
    assert np.max(np.abs(Q - exact)) < 0.02 * np.max(np.abs(exact))


def test_flow_converges_with_the_order_of_the_method(model):
    """The differences of three runs, each with half the step of the one before."""
    ends = [_flow(model, n)[1][-1] for n in (20, 40, 80)]
    order = np.log2(abs(ends[0] - ends[1]) / abs(ends[1] - ends[2]))
    assert order > 1.8


def test_numbers_out_of_range_are_refused():
    with pytest.raises(ValueError, match=r"InertancePort\.L = -1"):
        core.ResistanceInertancePort(R=1.0, L=-1.0)
