import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    RCR,
    FlowSource,
    PressureSource,
    Sinusoid,
    Surrogate,
    Vessel,
    VesselCRL,
    aligned_times,
    connect,
    march,
    step,
)
from lumped.units import MMHG
from lumped.verification import BLOCKS, PERIOD, VESSELS, impedance, vessel_impedance

FLOW = Sinusoid(mean=80.0, amplitude=60.0, period=PERIOD)
S = 2j * np.pi / PERIOD


def fed(vessel):
    """A sinusoidal flow through a vessel into a Windkessel."""
    return connect(
        {
            "heart": (FlowSource(FLOW), "in"),
            "vessel": (vessel, "in", "out"),
            "bed": (BLOCKS["rcr"], "out"),
        }
    )


def exact_inlet(vessel, t):
    """Inlet pressure of `fed`, by hand."""
    bed = BLOCKS["rcr"]
    Z = complex(vessel_impedance(vessel, impedance(bed, S), S))
    R = float(vessel.R_viscous + bed.R_proximal + bed.R_distal)
    return float(bed.P_ref) + 80.0 * R + (60.0 * Z * np.exp(S * np.asarray(t))).real


def exact_start(network, vessel):
    """States of `fed` at t = 0, by hand: P_c behind the resistance, Q_L, P_wk."""
    bed = BLOCKS["rcr"]
    Z = complex(vessel_impedance(vessel, impedance(bed, S), S))
    P_c = 60.0 * (Z - float(vessel.R_viscous))
    Q_L = P_c / (float(vessel.L) * S + complex(impedance(bed, S)))
    P_wk = Q_L / (1.0 / float(bed.R_distal) + S * float(bed.C))
    mean = float(bed.P_ref) + 80.0 * np.array(
        [float(bed.R_proximal + bed.R_distal), 0.0, float(bed.R_distal)]
    )
    mean[1] = 80.0
    x = mean + np.array([P_c.real, Q_L.real, P_wk.real])
    return jnp.zeros(network.n_unknowns).at[:3].set(x)


@pytest.mark.parametrize("order", [1, 3, 5])
def test_march_converges_with_its_order(order):
    vessel = VESSELS["RCL"]
    network = fed(vessel)
    start = exact_start(network, vessel)
    inlet = network.pressure_index("in")
    run = jax.jit(lambda ts: march(ts, network, start, order=order))
    errors = []
    for steps in (40, 80) if order == 5 else (160, 320):
        path = run(jnp.linspace(0.0, PERIOD, steps + 1))
        errors.append(np.max(np.abs(path.z[1:, inlet] - exact_inlet(vessel, path.t[1:]))))
        assert float(path.defect) == 0.0
    rate = np.log2(errors[0] / errors[1])
    assert abs(rate - order) < 0.35, (errors, rate)
    # the integral has the order of the scheme too: the mean is known
    mean = float(path.integral[inlet]) / PERIOD
    expected = exact_inlet(vessel, 0.0) - exact_inlet(vessel, PERIOD / 2)
    expected = exact_inlet(vessel, PERIOD / 2) + expected / 2
    assert mean == pytest.approx(expected, rel={1: 5e-3, 3: 1e-6, 5: 1e-8}[order])


def test_march_of_index_two_converges():
    # a compliance directly on a pressure source: its flow is C dP/dt
    source = Sinusoid(mean=90.0 * MMHG, amplitude=25.0 * MMHG, period=PERIOD)
    network = connect(
        {
            "inlet": (PressureSource(source), "in"),
            "vessel": (VesselCRL(R_viscous=60.0, C=2e-5, L=2.0), "in", "out"),
            "bed": (BLOCKS["rcr"], "out"),
        }
    )
    bed = BLOCKS["rcr"]
    P_hat = 25.0 * MMHG
    Q_hat = P_hat / (60.0 + 2.0 * S + complex(impedance(bed, S)))
    R = float(60.0 + bed.R_proximal + bed.R_distal)
    Q_mean = (90.0 * MMHG - float(bed.P_ref)) / R
    P_wk = float(bed.P_ref) + float(bed.R_distal) * Q_mean
    P_wk += (Q_hat / (1.0 / float(bed.R_distal) + S * float(bed.C))).real
    start = jnp.zeros(network.n_unknowns)
    start = start.at[:3].set(jnp.array([115.0 * MMHG, Q_mean + Q_hat.real, P_wk]))
    run = jax.jit(lambda ts: march(ts, network, start))
    errors = []
    for steps in (40, 80):
        path = run(jnp.linspace(0.0, PERIOD, steps + 1))
        turn = np.exp(S * np.asarray(path.t[1:]))
        Q_out = Q_mean + (Q_hat * turn).real
        Q_in = Q_out + (S * 2e-5 * P_hat * turn).real
        gaps = (
            path.z[1:, network.flow_index("bed")] - Q_out,
            path.z[1:, network.flow_index("vessel")] - Q_in,
        )
        errors.append([float(np.max(np.abs(gap))) for gap in gaps])
    rates = np.log2(np.array(errors[0]) / np.array(errors[1]))
    # order 2 s - 1 = 5 for the state, stage order s = 3 for the flow that is a derivative
    assert rates[0] > 4.6, (errors, rates)
    assert rates[1] > 2.6, (errors, rates)


def test_steps_of_no_length_change_nothing():
    network = fed(VESSELS["stenosis"])
    start = exact_start(network, VESSELS["RCL"])
    ts = jnp.linspace(0.0, 0.1, 11)
    doubled = jnp.sort(jnp.concatenate([ts, ts[3:4], ts[:1], ts[-1:]]))
    run = jax.jit(lambda ts: march(ts, network, start))
    once, twice = run(ts), run(doubled)
    np.testing.assert_allclose(twice.z[-1], once.z[-1], rtol=1e-13)
    np.testing.assert_allclose(twice.integral, once.integral, rtol=1e-13)
    gradient = jax.jit(jax.grad(lambda ts: march(ts, network, start).z[-1, 0]))(doubled)
    assert np.all(np.isfinite(gradient))


def test_step_of_rounding_length_is_harmless():
    # breakpoints that should coincide may differ by a rounding error
    network = fed(VESSELS["stenosis"])
    start = exact_start(network, VESSELS["RCL"])
    taken = jax.jit(lambda dt: step(0.3, dt, network, start, order=5))
    for dt in (1e-16, 1e-13):
        np.testing.assert_allclose(taken(dt).z[:3], start[:3], rtol=1e-9)


def test_nonlinear_steps_are_solved_to_rounding():
    network = fed(VESSELS["CRL stenosis"])
    ts = jnp.linspace(0.0, PERIOD, 65)
    path = jax.jit(march)(ts, network, jnp.zeros(network.n_unknowns))
    assert float(path.defect) < 1e-12
    residual = jax.vmap(network.residual)(path.t[1:], path.z[1:])[:, network.n_states :]
    # closures and conservation hold at every step end, to rounding of 1e5 dyn/cm²
    assert np.max(np.abs(residual)) < 1e-7


@pytest.mark.parametrize("name", ["RCL", "stenosis"])
def test_march_has_an_exact_gradient(name, assert_gradient):
    def probe(case):
        vessel, x0 = case
        network = fed(vessel)
        z0 = jnp.zeros(network.n_unknowns).at[:3].set(jnp.stack(x0))
        path = march(jnp.linspace(0.0, 0.2, 13), network, z0)
        return path.z[-1, network.pressure_index("in")] / 1e5 + path.integral[0] / 1e4

    states = [jnp.asarray(v) for v in (1.0e5, 90.0, 9e4)]
    assert_gradient(probe, (VESSELS[name], states))


def test_march_of_a_batch_equals_a_loop():
    vessel = VESSELS["stenosis"]

    def end(K):
        network = fed(eqx.tree_at(lambda v: v.K_stenosis, vessel, K))
        z0 = jnp.zeros(network.n_unknowns)
        return march(jnp.linspace(0.0, 0.2, 13), network, z0).z[-1]

    K = jnp.array([1.0, 50.0])
    one = jax.jit(end)
    np.testing.assert_allclose(jax.jit(jax.vmap(end))(K), [one(K[0]), one(K[1])], rtol=1e-11)


@pytest.mark.parametrize("grading", [0.0, 0.8, 1.0])
def test_aligned_times_hold_all_breakpoints_and_nest(grading, rest):
    network = Surrogate(R0=5e3).network(rest)
    ts = np.asarray(aligned_times(network, 0.8, 50, cycles=2, grading=grading))
    assert np.all(np.diff(ts) >= 0.0)
    assert ts.size - 1 >= 2 * 50
    for mark in (0.0, 0.0692 * 0.8, 0.28, 0.32, 0.8, 0.8 + 0.28, 1.6):
        assert np.min(np.abs(ts - mark)) < 1e-15
        assert np.min(np.abs(ts[::2] - mark)) < 1e-15


def test_impossible_steps_are_refused():
    network = fed(VESSELS["RC"])
    with pytest.raises(ValueError, match="order 2"):
        march(jnp.linspace(0.0, 1.0, 3), network, jnp.zeros(network.n_unknowns), order=2)
    with pytest.raises(ValueError, match="at least 1"):
        aligned_times(network, PERIOD, 0)


def test_undamped_march_conserves_volume():
    # a compliance fed by a flow through an open inertance: what enters is stored or leaves
    network = connect(
        {
            "heart": (FlowSource(FLOW), "in"),
            "vessel": (Vessel(60.0, C=2e-5), "in", "out"),
            "bed": (RCR(120.0, 9e-4, 1.4e3), "out"),
        }
    )
    path = jax.jit(march)(jnp.linspace(0.0, 0.3, 31), network, jnp.zeros(network.n_unknowns))
    entered = path.integral[network.flow_index("vessel")]
    left = -path.integral[network.flow_index("vessel", 1)]
    stored = 2e-5 * (path.z[-1, 0] - path.z[0, 0])
    # the quadrature of the scheme is that of the state: exact, not only to its order
    assert float(entered - left - stored) == pytest.approx(0.0, abs=1e-12 * float(entered))
