"""svZeroDSolver cases run here against its stored results, its own program, and analysis."""

import dataclasses
import functools
import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import lumped

QUANTITIES = ("flow_in", "flow_out", "pressure_in", "pressure_out")

REPRODUCED = {
    # case: largest difference from the stored result, relative to the largest value
    "pulsatileFlow_R_RCR": 1e-4,  # its 201 points a cycle, integrated by second-order steps
    "pulsatileFlow_R_coronary": 1e-4,
    "steadyFlow_RC_R": 1e-9,  # its Newton tolerance
    "steadyFlow_RLC_R": 1e-9,
    "steadyFlow_R_R": 1e-9,
    "steadyFlow_R_RCR": 1e-9,
    "steadyFlow_R_coronary": 1e-9,
    "steadyFlow_bifurcationR_R1": 1e-9,
    "steadyFlow_confluenceR_R": 1e-9,
    "steadyFlow_stenosis_R": 1e-9,
}


def crl_answer(t):
    return {
        "flow_in": np.cos(2 * t) + 0.5 * np.cos(t),
        "flow_out": np.cos(2 * t),
        "pressure_in": 0.5 * np.sin(t),
        "pressure_out": 0.5 * np.sin(t) - np.cos(2 * t),
    }


def stenosis_answer(t):
    return {
        "flow_in": np.sin(t),
        "flow_out": np.sin(t),
        "pressure_in": np.abs(np.sin(t)) * np.sin(t) + 0.1,
        "pressure_out": np.full_like(t, 0.1),
    }


DIFFERENTIATED = {
    # cases that differentiate their series: compared with the analytic answer in the file
    "pulsatileFlow_CRL": crl_answer,
    "pulsatileFlow_CStenosis_steadyPressure": stenosis_answer,
}

UNSUPPORTED = {
    "closedLoopHeart_singleVessel": "'RCR_aorta' of type 'ClosedLoopRCR' .* closes the circulation",
    "steadyFlow_calibration": "read it with `read_calibration`",
}

STEADY = {
    # case: flow in, flow out, pressure in, pressure out of each vessel, as the files derive them
    "steadyFlow_RC_R": [(5.0, 5.0, 1100.0, 600.0)],
    "steadyFlow_RLC_R": [(5.0, 5.0, 1100.0, 600.0)],
    "steadyFlow_R_R": [(5.0, 5.0, 1100.0, 600.0)],
    "steadyFlow_R_RCR": [(5.0, 5.0, 10500.0, 10000.0)],
    "steadyFlow_R_coronary": [(5.0, 5.0, 2000.0, 1500.0)],
    "steadyFlow_stenosis_R": [(5.0, 5.0, 3600.0, 600.0)],
    "steadyFlow_bifurcationR_R1": [
        (5.0, 5.0, 1100.0, 600.0),
        (2.5, 2.5, 600.0, 350.0),
        (2.5, 2.5, 600.0, 350.0),
    ],
    "steadyFlow_confluenceR_R": [
        (5.0, 5.0, 6600.0, 6100.0),
        (10.0, 10.0, 8100.0, 6100.0),
        (15.0, 15.0, 6100.0, 1600.0),
    ],
}


@pytest.fixture(scope="module")
def cases(shared_data):
    """The folder of the case files."""
    return shared_data / "svzerod" / "cases"


@functools.cache
def simulated(path, interpolation="linear"):
    return lumped.simulate_case(lumped.read_svzerod(path, interpolation=interpolation))


def stored(cases, name):
    columns = json.loads((cases / "results" / f"result_{name}.json").read_text())
    return {key: np.array(list(column.values())) for key, column in columns.items()}


def differences(ours, theirs):
    """Largest difference of each quantity, relative to its largest value in the vessel."""
    assert [*ours] == [*theirs]
    assert ours["name"].tolist() == theirs["name"].tolist()
    assert np.allclose(ours["time"], theirs["time"], rtol=0, atol=1e-9)  # written to 10 digits
    found = dict.fromkeys(QUANTITIES, 0.0)
    for name in set(theirs["name"]):
        rows = theirs["name"] == name
        for key in QUANTITIES:
            error = np.max(np.abs(ours[key][rows] - theirs[key][rows]))
            found[key] = max(found[key], error / np.max(np.abs(theirs[key][rows])))
    return found


def test_every_case_is_listed(cases):
    listed = {*REPRODUCED, *DIFFERENTIATED, *UNSUPPORTED}
    assert listed == {path.stem for path in cases.glob("*.json")}


@pytest.mark.parametrize(("name", "tolerance"), REPRODUCED.items())
def test_stored_results_are_reproduced(cases, name, tolerance):
    found = differences(simulated(cases / f"{name}.json"), stored(cases, name))
    assert max(found.values()) < tolerance, found


@pytest.mark.parametrize(("name", "reason"), UNSUPPORTED.items())
def test_unsupported_cases_are_refused_with_their_reason(cases, name, reason):
    with pytest.raises(ValueError, match=reason):
        lumped.read_svzerod(cases / f"{name}.json")


@pytest.mark.parametrize("name", STEADY)
def test_steady_cases_give_the_analytic_answer_in_the_file(cases, name):
    case = lumped.read_svzerod(cases / f"{name}.json")
    table = simulated(cases / f"{name}.json")
    for vessel, answer in zip(case.reported, STEADY[name], strict=True):
        rows = table["name"] == vessel
        for key, value in zip(QUANTITIES, answer, strict=True):
            # rounding of a marched steady state; svZeroDSolver's own error is 1e-10
            assert np.allclose(table[key][rows], value, rtol=1e-11, atol=0), key


@pytest.mark.parametrize(("name", "answer"), DIFFERENTIATED.items())
def test_differentiated_series_give_the_analytic_answer_in_the_file(cases, name, answer):
    """The stored result is off by up to 2.4 % of the flow, which is its error, not ours.

    Both cases differentiate a series: the slope of straight lines jumps at each sample, and
    svZeroDSolver's steps pass over the jumps. Splines through the samples give the answer itself.
    """
    ours, theirs = simulated(cases / f"{name}.json", "cubic"), stored(cases, name)
    exact = answer(ours["time"])
    for key in QUANTITIES:
        error = np.max(np.abs(ours[key] - exact[key]))
        assert error < 2e-7, key  # derivative of splines through samples with 9 digits
        theirs_off = np.max(np.abs(theirs[key] - exact[key]))
        assert abs(np.max(np.abs(ours[key] - theirs[key])) - theirs_off) < 2e-7, key


def replaced(case, **waveforms):
    network = case.network
    for name, waveform in waveforms.items():
        network = eqx.tree_at(lambda n, name=name: n[name].waveform, network, waveform)
    return dataclasses.replace(case, network=network)


def sine(mean, amplitude, period):
    return lumped.Sinusoid(mean, amplitude, period, phase=-jnp.pi / 2)


def windkessel():
    """The network of pulsatileFlow_R_RCR, driven from rest."""
    conditions = [
        {"bc_name": "INFLOW", "bc_type": "FLOW", "bc_values": {"Q": [2.2, 2.2], "t": [0.0, 1.0]}},
        {
            "bc_name": "OUT",
            "bc_type": "RCR",
            "bc_values": {"Rp": 1000.0, "C": 1e-4, "Rd": 1000.0, "Pd": 0.0},
        },
    ]
    vessel = {
        "vessel_name": "v",
        "vessel_id": 0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 100.0},
        "boundary_conditions": {"inlet": "INFLOW", "outlet": "OUT"},
    }
    settings = {
        "number_of_cardiac_cycles": 2,
        "number_of_time_pts_per_cardiac_cycle": 11,
        "steady_initial": False,
        "output_all_cycles": True,
    }
    return {
        "simulation_parameters": settings,
        "boundary_conditions": conditions,
        "vessels": [vessel],
    }


def test_windkessel_has_the_analytic_periodic_pressure():
    """Z(iω) = R + R_p + R_d/(1 + iω R_d C) under Q = 2.2 + 2.5 sin(2π t)."""
    case = replaced(lumped.read_svzerod(windkessel()), INFLOW=sine(2.2, 2.5, 1.0))
    solution = lumped.periodic_case(case, lumped.Fourier(n_samples=16))
    omega = 2 * np.pi
    Z = 1100.0 + 1000.0 / (1 + 1j * omega * 0.1)
    exact = 2.2 * 2100.0 + 2.5 * np.imag(Z * np.exp(1j * omega * np.asarray(solution.t)))
    P = solution.pressure("INFLOW:v")
    assert np.max(np.abs(P - exact)) < 1e-12 * np.max(exact)  # one harmonic: rounding


def between(inlet, outlet, **vessel):
    """A vessel with parameters between two boundary conditions of given kinds, 0 at all times."""
    config = windkessel()
    for entry, kind in zip(config["boundary_conditions"], (inlet, outlet), strict=True):
        key = "P" if kind == "PRESSURE" else "Q"
        entry |= {"bc_type": kind, "bc_values": {key: [0.0, 0.0], "t": [0.0, 2 * np.pi]}}
    kind = vessel.pop("kind", "BloodVessel")
    config["vessels"][0] |= {"zero_d_element_type": kind, "zero_d_element_values": vessel}
    return lumped.read_svzerod(config)


def test_crl_vessel_has_the_analytic_answer_of_its_case():
    """The case pulsatileFlow_CRL with its sources as functions, not samples."""
    case = between("PRESSURE", "FLOW", kind="BloodVesselCRL", C=1.0, L=0.0, R_poiseuille=1.0)
    flow_out = lumped.Sinusoid(0.0, -1.0, np.pi)  # enters the network
    case = replaced(case, INFLOW=sine(0.0, 0.5, 2 * np.pi), OUT=flow_out)
    solution = lumped.periodic_case(case, lumped.Fourier(n_samples=16, reduce=False))
    exact = crl_answer(np.asarray(solution.t))
    found = (solution.flow("v"), -solution.flow("v", 1), *map(solution.pressure, ("INFLOW:v",)))
    for key, values in zip(QUANTITIES, (*found, solution.pressure("v:OUT")), strict=True):
        assert np.max(np.abs(values - exact[key])) < 1e-12, key  # two harmonics: rounding


def test_stenosis_has_the_analytic_answer_of_its_case():
    """The case pulsatileFlow_CStenosis_steadyPressure with its source as a function."""
    loss = {"R_poiseuille": 0.0, "C": 1.0, "L": 0.0, "stenosis_coefficient": 1.0}
    case = between("FLOW", "PRESSURE", **loss)
    case = replaced(case, INFLOW=sine(0.0, 1.0, 2 * np.pi), OUT=lumped.Constant(0.1))
    case = dataclasses.replace(case, cycles=1, steady_initial=True)
    table = lumped.simulate_case(case)
    exact = stenosis_answer(table["time"])
    for key in QUANTITIES:
        # Newton's tolerance; the charge of the compliance does not change, so no step error
        assert np.max(np.abs(table[key] - exact[key])) < 1e-11, key


def test_charging_from_rest_follows_the_exponential():
    """P_wk = Q R_d (1 − exp(−t/(R_d C))), from svZeroDSolver's zero initial state."""
    case = lumped.read_svzerod(windkessel())
    table = lumped.simulate_case(case)
    t = table["time"]
    assert np.allclose(t, np.linspace(0.0, 2.0, 21), rtol=0, atol=1e-15)
    P_wk = 2.2 * 1000.0 * (1 - np.exp(-t / 0.1))
    # the first point is the initial state as it is; steps of one time constant leave 2e-5
    assert table["pressure_out"][0] == 0.0
    assert np.allclose(table["pressure_out"][1:], P_wk[1:] + 2200.0, rtol=1e-4)
    error = np.max(np.abs(table["pressure_out"][1:] - P_wk[1:] - 2200.0))
    finer = lumped.simulate_case(dataclasses.replace(case, points_per_cycle=21))
    t = finer["time"][1:]
    P_wk = 2.2 * 1000.0 * (1 - np.exp(-t / 0.1))
    error_finer = np.max(np.abs(finer["pressure_out"][1:] - P_wk - 2200.0))
    assert error / error_finer > 2**4.5  # order 5


def test_output_settings_choose_the_reported_points():
    case = lumped.read_svzerod(windkessel())
    every = lumped.simulate_case(case)

    def report(**settings):
        return lumped.simulate_case(
            dataclasses.replace(case, output=lumped.SvZeroDOutput(**settings))
        )

    last = report(interval=3)
    assert np.allclose(last["time"], [0.0, 0.3, 0.6, 0.9], rtol=0, atol=1e-15)
    assert last["pressure_in"].tolist() == every["pressure_in"][10::3].tolist()
    mean = report(all_cycles=True, mean_only=True)
    assert np.isnan(mean["time"]).all()
    assert mean["pressure_in"].tolist() == [np.mean(every["pressure_in"])]
    for settings in ({"by_variable": True}, {"derivatives": True}):
        with pytest.raises(ValueError, match="Set output_variable_based and output_derivative"):
            report(**settings)
    with pytest.raises(ValueError, match="Use `periodic_case`"):
        lumped.simulate_case(dataclasses.replace(case, cycle_error=0.01))


def test_a_case_without_steady_state_is_refused():
    config = windkessel()
    config["boundary_conditions"][1] = {
        "bc_name": "OUT",
        "bc_type": "FLOW",
        "bc_values": {"Q": [2.2, 2.2], "t": [0.0, 1.0]},
    }
    config["vessels"][0]["zero_d_element_values"]["C"] = 1e-4
    config["simulation_parameters"]["steady_initial"] = True
    with pytest.raises(ValueError, match=r"no unique steady state.*Set steady_initial to false"):
        lumped.simulate_case(lumped.read_svzerod(config))


def test_periodic_case_takes_a_solver_that_fits():
    """Index 2 (compliance on a pressure source) and no state at all; both have exact answers."""
    config = windkessel()
    config["boundary_conditions"][0] |= {"bc_type": "PRESSURE"}
    config["boundary_conditions"][0]["bc_values"] = {"P": [0.0, 2.0, 0.0], "t": [0.0, 0.25, 1.0]}
    config["boundary_conditions"][1] |= {"bc_type": "RESISTANCE", "bc_values": {"R": 4.0, "Pd": 0}}
    config["vessels"][0] |= {"zero_d_element_type": "BloodVesselCRL"}
    config["vessels"][0]["zero_d_element_values"] = {"R_poiseuille": 6.0, "C": 0.5}
    solution = lumped.periodic_case(lumped.read_svzerod(config), lumped.Shooting(n_steps=8))
    P, slope = solution.pressure("INFLOW:v"), np.where(solution.t <= 0.25, 8.0, -8.0 / 3.0)
    slope = np.where(solution.t == 0.0, -8.0 / 3.0, slope)  # a step end has the slope before it
    # stage equations of a linear source are exact but for rounding
    assert np.allclose(solution.flow("v"), P / 10.0 + 0.5 * slope, rtol=1e-10, atol=1e-10)
    del config["vessels"][0]["zero_d_element_values"]["C"]
    solution = lumped.periodic_case(lumped.read_svzerod(config))
    assert np.allclose(solution.flow("v"), solution.pressure("INFLOW:v") / 10.0, rtol=1e-12)
