"""The svZeroDSolver program itself, run on the cases that we write."""

import jax.numpy as jnp
import numpy as np
import pytest

import lumped

svzerod = pytest.importorskip(
    "svzerod", reason="svzerod (extra 'benchmark') is the third party that is compared with"
)

PERIOD = 0.8
CONDITION = lumped.condition_from_clinic(110.0, 65.0, PERIOD)
P_SYSTOLIC = 110.0 * lumped.MMHG


def program(case):
    """Its result as a table like ours; a sample of each waveform at each of the finest steps."""
    frame = svzerod.simulate(lumped.svzerod_config(case, samples=3200))
    return {key: frame[key].to_numpy() for key in frame}


def last_cycle(network, points):
    """Result of the ostium over the last of ten cycles, without the closing point."""
    table = program(lumped.SvZeroDCase(network, PERIOD, points_per_cycle=points))
    return {key: column[:-1] for key, column in table.items()}


def surrogate(alpha, bed=None):
    options = {} if bed is None else {"coronary": bed}
    return lumped.Surrogate(R0=5e3, alpha=alpha, **options)


@pytest.mark.parametrize("alpha", [0.05, 0.124, 0.262])
def test_program_gives_our_ffr(alpha):
    network = surrogate(alpha).network(CONDITION)
    mean = lumped.mean_state(network, PERIOD)
    ours = mean[network.pressure_index("distal")] / mean[network.pressure_index("aorta")]
    theirs = last_cycle(network, 201)
    ffr = np.mean(theirs["pressure_out"]) / np.mean(theirs["pressure_in"])
    assert abs(ffr - ours) < 1e-10  # what ten cycles leave of the start


def waveform_errors(network):
    """Largest errors of distal pressure and flow, with 201 and with 3201 points a cycle."""
    ours = lumped.solve_periodic(network, PERIOD, lumped.Fourier(n_samples=3200))
    P, Q = ours.pressure("distal"), ours.flow("ostium")
    errors = []
    for points in (201, 3201):
        theirs, every = last_cycle(network, points), 3200 // (points - 1)
        error_P = np.max(np.abs(theirs["pressure_out"] - P[::every])) / P_SYSTOLIC
        error_Q = np.max(np.abs(theirs["flow_in"] - Q[::every])) / np.max(np.abs(Q))
        errors.append((error_P, error_Q))
    return np.array(errors)


def assert_it_converges_to_our_waveforms(network):
    coarse, fine = waveform_errors(network)
    assert np.all(fine < (1e-5, 5e-5))  # its steps of T/3200 at the bends of P_LV and P_aorta
    assert np.all(coarse / fine > 100)  # 16 times as many points: second order but for the bends


def test_program_converges_to_our_waveforms():
    assert_it_converges_to_our_waveforms(surrogate(0.262).network(CONDITION))


def test_program_converges_to_our_flow_under_a_changing_intramyocardial_pressure():
    """Nothing but P_im changes in time: all pulsation passes through its derivative."""
    bed = lumped.nominal_coronary(im_factor=0.4)
    steady = lumped.Constant(86.5 * lumped.MMHG)
    assert_it_converges_to_our_waveforms(surrogate(0.262, bed).network(CONDITION, inlet=steady))


def sine(mean, amplitude, period):
    return lumped.Sinusoid(mean, amplitude, period, phase=-jnp.pi / 2)


def everything():
    """A network of all elements that both have, at nodes of all kinds."""
    P_in = sine(1.2e5, 2e4, PERIOD)
    P_im = sine(3e4, 3e4, PERIOD)
    Q_out = sine(-4.0, 2.0, PERIOD / 2)
    bed = lumped.Coronary(P_im=P_im, R_1=3e3, R_2=6e3, R_3=3e4, C_a=4e-6, C_im=3e-5, P_venous=5e3)
    return lumped.connect(
        {
            "heart": (lumped.PressureSource(P_in), "root"),
            "trunk": (lumped.Vessel(300.0, C=1e-5, L=2.0, K_stenosis=20.0), "root", "fork"),
            "leak": (lumped.Resistance(2e4, P_ref=1e4), "fork"),
            "a": (lumped.Vessel(800.0, C=2e-6), "fork", "a_end"),
            "b": (lumped.VesselCRL(900.0, C=1e-6, L=3.0), "fork", "b_end"),
            "a_bed": (lumped.RCR(500.0, 1e-5, 8e3, P_ref=2e3), "a_end"),
            "b_bed": (bed, "b_end"),
            "c": (lumped.Vessel(700.0), "fork", "c_end"),
            "drain": (lumped.FlowSource(Q_out), "c_end"),
            "d": (lumped.Vessel(600.0), "d_end", "fork"),
            "d_bed": (lumped.RC(9e3, 5e-6), "d_end"),
        }
    )


def test_program_gives_our_transient_of_a_network_with_all_elements():
    case = lumped.SvZeroDCase(
        everything(),
        PERIOD,
        cycles=2,
        points_per_cycle=801,
        output=lumped.SvZeroDOutput(all_cycles=True),
    )
    ours, theirs = lumped.simulate_case(case), program(case)
    assert ours["name"].tolist() == theirs["name"].tolist()
    assert np.allclose(ours["time"], theirs["time"], rtol=0, atol=1e-12)
    for name in case.reported:
        # its first steps start from rates of zero, ours have no rates to start from
        rows = (theirs["name"] == name) & (theirs["time"] > 0.01)
        for key in ("flow_in", "flow_out", "pressure_in", "pressure_out"):
            scale = np.max(np.abs(theirs[key][rows]))
            assert np.max(np.abs(ours[key][rows] - theirs[key][rows])) < 2e-4 * scale, (name, key)


def test_program_approaches_our_differentiated_series_with_its_first_order():
    """A compliance behind a quadratic loss differentiates the flow, whose slope jumps."""
    t = np.linspace(0.0, 1.0, 11)
    flow = lumped.sampled(t, np.sin(2 * np.pi * t), 1.0)
    network = lumped.connect(
        {
            "flow": (lumped.FlowSource(flow), "in"),
            "v": (lumped.Vessel(0.0, C=1.0, K_stenosis=1.0), "in", "out"),
            "end": (lumped.PressureSource(lumped.Constant(0.1)), "out"),
        }
    )
    errors = []
    for points in (101, 401):
        case = lumped.SvZeroDCase(network, 1.0, cycles=2, points_per_cycle=points)
        ours, theirs = lumped.simulate_case(case), program(case)
        errors.append(np.max(np.abs(ours["flow_out"] - theirs["flow_out"])))
    assert errors[0] > 1e-2
    assert 3.5 < errors[0] / errors[1] < 4.5  # four times as many points: first order
