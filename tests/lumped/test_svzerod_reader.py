import copy
import re

import equinox as eqx
import jax
import numpy as np
import pytest

import lumped
from lumped.svzerod_series import steady_sources

SETTINGS = {"number_of_cardiac_cycles": 3, "number_of_time_pts_per_cardiac_cycle": 11}
BEAT = {"t": [0.0, 0.1, 0.4, 0.8], "Q": [1.0, 3.0, 2.0, 1.0]}


def condition(name, kind, **values):
    return {"bc_name": name, "bc_type": kind, "bc_values": values}


def vessel(identity, name, links=None, kind="BloodVessel", **values):
    return {
        "vessel_id": identity,
        "vessel_name": name,
        "vessel_length": 1.0,
        "zero_d_element_type": kind,
        "zero_d_element_values": {"R_poiseuille": 10.0, **values},
        "boundary_conditions": links or {},
    }


def junction(name, inlets, outlets, kind="NORMAL_JUNCTION", **values):
    entry = {"junction_name": name, "junction_type": kind}
    entry |= {"inlet_vessels": inlets, "outlet_vessels": outlets}
    return entry | ({"junction_values": values} if values else {})


def bifurcation():
    """A beat into one vessel that splits: an RCR and a coronary bed."""
    bed = {"Ra1": 1.0, "Ra2": 2.0, "Rv1": 3.0, "Ca": 4.0, "Cc": 5.0, "P_v": 6.0}
    return {
        "description": {"text": "remarks are allowed"},
        "simulation_parameters": {**SETTINGS, "output_all_cycles": True, "density": 1.06},
        "boundary_conditions": [
            condition("IN", "FLOW", **BEAT),
            condition("OUT_A", "RCR", Rp=1.0, C=2.0, Rd=3.0, Pd=4.0, _remark="fitted"),
            condition("OUT_B", "CORONARY", **bed, Pim=[0.0, 7.0, 0.0], t=[0.0, 0.3, 0.8]),
        ],
        "vessels": [
            vessel(3, "root", {"inlet": "IN"}, C=0.5, L=0.0, stenosis_coefficient=0.25),
            vessel(8, "left", {"outlet": "OUT_A"}, L=0.125),
            vessel(5, "right", {"outlet": "OUT_B"}, kind="BloodVesselCRL", C=0.0, L=2.0),
        ],
        "junctions": [junction("J0", [3], [8, 5])],
    }


def single(*conditions, **values):
    """One vessel between two boundary conditions."""
    return {
        "simulation_parameters": dict(SETTINGS),
        "boundary_conditions": list(conditions),
        "vessels": [vessel(0, "v", {"inlet": "IN", "outlet": "OUT"}, **values)],
    }


OUT = condition("OUT", "RESISTANCE", R=100.0, Pd=0.0)
STEADY = condition("IN", "FLOW", Q=[5.0, 5.0], t=[0.0, 0.5])


def numbers(element, *names):
    return [float(getattr(element, name)) for name in names]


def test_elements_and_nodes_follow_the_file():
    case = lumped.read_svzerod(bifurcation())
    network = case.network
    assert network.names == ("IN", "OUT_A", "OUT_B", "root", "left", "right")
    assert dict(zip(network.names, network.ports, strict=True)) == {
        "IN": ("IN:root",),
        "OUT_A": ("left:OUT_A",),
        "OUT_B": ("right:OUT_B",),
        "root": ("IN:root", "J0"),
        "left": ("J0", "left:OUT_A"),
        "right": ("J0", "right:OUT_B"),
    }
    root, right, bed = network["root"], network["right"], network["OUT_B"]
    assert isinstance(root, lumped.Vessel)
    assert (float(root.R_viscous), float(root.C), float(root.K_stenosis)) == (10.0, 0.5, 0.25)
    assert root.L is None  # zero is not there: no state, no division
    assert isinstance(right, lumped.VesselCRL)
    assert (right.C, right.K_stenosis, float(right.L)) == (None, None, 2.0)
    rcr = network["OUT_A"]
    assert numbers(rcr, "R_proximal", "C", "R_distal", "P_ref") == [1.0, 2.0, 3.0, 4.0]
    assert numbers(bed, "R_1", "R_2", "R_3", "C_a", "C_im", "P_venous") == [*range(1, 7)]
    assert float(bed.P_im(0.15)) == 3.5


def test_settings_are_read():
    case = lumped.read_svzerod(bifurcation())
    assert (case.period, case.cycles, case.points_per_cycle) == (0.8, 3, 11)
    assert case.steady_initial
    assert case.output == lumped.SvZeroDOutput(all_cycles=True)
    assert case.reported == ("root", "left", "right")
    config = bifurcation()
    config["simulation_parameters"] |= {
        "steady_initial": False,
        "output_interval": 5,
        "output_mean_only": True,
        "use_cycle_to_cycle_error": True,
        "sim_cycle_to_cycle_percent_error": 2.0,
        "cardiac_period": 0.8,
    }
    case = lumped.read_svzerod(config)
    assert not case.steady_initial
    assert case.output == lumped.SvZeroDOutput(all_cycles=True, interval=5, mean_only=True)
    assert case.cycle_error == 0.02


def test_linear_and_cubic_series_pass_through_their_samples():
    for kind in ("linear", "cubic"):
        wave = lumped.read_svzerod(bifurcation(), interpolation=kind).network["IN"].waveform
        assert wave.times.shape == (3,)  # the closing sample is not a fourth
        t = np.array([0.0, 0.1, 0.4, 0.8])
        assert np.allclose(jax.vmap(wave)(t), BEAT["Q"], rtol=0, atol=1e-14)  # rounding
    linear = lumped.read_svzerod(bifurcation()).network["IN"].waveform
    assert float(linear(0.05)) == pytest.approx(2.0, rel=1e-15)
    assert float(linear(0.6)) == pytest.approx(1.5, rel=1e-15)
    assert float(linear(0.6 + 0.8)) == pytest.approx(1.5, rel=1e-14)


def test_equal_and_single_values_are_constants():
    case = lumped.read_svzerod(single(STEADY, OUT))
    assert isinstance(case.network["IN"].waveform, lumped.Constant)
    assert case.period == 0.5
    single_value = condition("IN", "PRESSURE", P=[5.0], t=[0.0])
    case = lumped.read_svzerod(single(single_value, OUT))
    assert float(case.network["IN"].waveform(0.3)) == 5.0
    assert case.period == 1.0  # what svZeroDSolver takes without any series


def test_flow_at_an_outlet_leaves_the_network():
    config = single(
        condition("IN", "PRESSURE", P=[1.0, 1.0], t=[0.0, 0.8]), condition("OUT", "FLOW", **BEAT)
    )
    assert float(lumped.read_svzerod(config).network["OUT"].waveform(0.1)) == -3.0


def test_windkessels_without_charge_are_resistances():
    for values in ({"C": 0.0, "Rd": 30.0}, {"C": 1e-4, "Rd": 0.0}):
        config = single(STEADY, condition("OUT", "RCR", Rp=10.0, Pd=7.0, **values))
        block = lumped.read_svzerod(config).network["OUT"]
        assert isinstance(block, lumped.Resistance)
        assert (float(block.R), float(block.P_ref)) == (10.0 + values["Rd"], 7.0)
    config = single(STEADY, condition("OUT", "RCR", Rp=0.0, C=1.0, Rd=2.0))
    assert float(lumped.read_svzerod(config).network["OUT"].R_proximal) == 0.0


def test_junction_branches_become_vessels():
    config = bifurcation()
    losses = {"R_poiseuille": [0.0, 2.0], "L": [0.0, 3.0], "stenosis_coefficient": [0.0, 4.0]}
    config["junctions"] = [junction("J0", [3], [8, 5], "BloodVesselJunction", **losses)]
    network = lumped.read_svzerod(config).network
    assert network.names[-1] == "J0_right"
    assert network.ports[-1] == ("J0", "J0:right")
    assert network.ports[network.names.index("left")][0] == "J0"  # all zero: no branch
    assert network.ports[network.names.index("right")][0] == "J0:right"
    branch = network["J0_right"]
    assert (float(branch.R_viscous), float(branch.L), float(branch.K_stenosis)) == (2.0, 3.0, 4.0)
    assert branch.C is None
    config["junctions"] = [junction("J0", [3], [8, 5], "resistive_junction", R=[1.0, 0.0, 2.0])]
    case = lumped.read_svzerod(config)
    assert case.network.names[-2:] == ("J0_root", "J0_right")
    assert case.network.ports[-2] == ("root:J0", "J0")
    assert case.reported == ("root", "left", "right")  # branches are no vessels of the file


def test_internal_junctions_and_blocks_join_like_normal_ones():
    plain = lumped.read_svzerod(bifurcation()).network
    config = bifurcation()
    config["junctions"] = [
        {
            "junction_name": "J0",
            "junction_type": "internal_junction",
            "inlet_blocks": ["root"],
            "outlet_blocks": ["left", "right"],
        }
    ]
    assert lumped.read_svzerod(config).network.ports == plain.ports
    config["vessels"][0]["boundary_conditions"] = {}
    config["junctions"].append(
        {
            "junction_name": "J1",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_blocks": ["IN"],
            "outlet_blocks": ["root"],
        }
    )
    assert lumped.read_svzerod(config).network.ports == plain.ports  # same node, same name


def spoil_condition(i, **values):
    return lambda c: c["boundary_conditions"][i]["bc_values"].update(values)


def drop(i, key):
    return lambda c: c["boundary_conditions"][i]["bc_values"].pop(key)


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (
            spoil_condition(2, Pv=3.0),
            "condition OUT_B: 'Pv' is not a known key, did you mean 'P_v'",
        ),
        (spoil_condition(1, closed_loop_outlet=True), "condition OUT_A: 'closed_loop_outlet'"),
        (drop(1, "Rd"), "condition OUT_A: Rd is missing"),
        (drop(0, "t"), "condition IN: t is missing"),
        (spoil_condition(1, Rp="12"), "condition OUT_A: Rp = '12' is not a finite number"),
        (spoil_condition(1, C=float("nan")), "condition OUT_A: C = nan is not a finite number"),
        (spoil_condition(1, C=-1.0), "condition OUT_A: RCR.C = -1"),
        (spoil_condition(0, Q=[1.0, None, 2.0, 1.0]), "condition IN: Q is not a list of finite"),
        (spoil_condition(0, Q=[1.0, 2.0, 1.0]), "condition IN: Q: 4 times for 3 values"),
        (spoil_condition(0, Q=[1.0, 2.0, 2.0, 3.0]), "condition IN: Q: The beat does not close"),
        (spoil_condition(0, t=[0.1, 0.2, 0.4, 0.8]), "condition IN: Q: the times start at 0.1"),
        (spoil_condition(0, t=[0.0, 0.4, 0.4, 0.8]), "condition IN: Q: the times do not ascend"),
        (spoil_condition(0, t=[0.0, 0.1, 0.4, 0.9]), "the periods differ: IN 0.9 s, OUT_B 0.8 s"),
        (lambda c: c["simulation_parameters"].update(cardiac_period=1.0), "cardiac_period 1 s"),
        (
            lambda c: c["vessels"][0]["zero_d_element_values"].update(R=1.0),
            "vessel root: 'R' is not a known key",
        ),
        (
            lambda c: c["vessels"][0]["zero_d_element_values"].update(C=-1.0),
            "vessel root: Vessel.C = -1",
        ),
        (lambda c: c["vessels"][0].update(vesel_length=1.0), "vessel root: 'vesel_length' is not"),
        (lambda c: c["vessels"][0].update(vessel_id=8), "vessel_id 8: used twice"),
        (lambda c: c["vessels"][0].update(vessel_id="a"), "vessel_id = 'a' is not a whole number"),
        (lambda c: c["vessels"][1].update(vessel_name="root"), "root: named twice"),
        (
            lambda c: c["vessels"][0].pop("boundary_conditions"),
            "root: its inlet is connected to no",
        ),
        (
            lambda c: c["vessels"][0]["boundary_conditions"].update(outlet="OUT_A"),
            "root: its outlet is connected to OUT_A, junction J0",
        ),
        (
            lambda c: c["vessels"][0]["boundary_conditions"].update(inlet="INN"),
            "vessel root: no boundary condition is named 'INN'",
        ),
        (
            lambda c: c["boundary_conditions"].append(copy.deepcopy(OUT)),
            "boundary condition OUT: used by nothing",
        ),
        (lambda c: c["junctions"][0].update(inlet_vessels=[99]), "no vessel has the vessel_id 99"),
        (
            lambda c: c["junctions"][0].update(inlet_vessels=[[3]]),
            "J0: inlet_vessels is not a list of numbers",
        ),
        (
            lambda c: c["junctions"][0].update(inlet_blocks=[{}]),
            "J0: inlet_blocks is not a list of names",
        ),
        (
            lambda c: c["vessels"][0]["boundary_conditions"].update(inlet=["IN"]),
            "vessel root: inlet of boundary_conditions is not a name",
        ),
        (
            lambda c: c["junctions"][0].update(outlet_vessels="8"),
            "J0: outlet_vessels is not a list",
        ),
        (
            lambda c: c["junctions"][0].update(inlet_blocks=["nobody"]),
            "junction J0: no vessel or boundary condition is named 'nobody'",
        ),
        (
            lambda c: c["junctions"][0].update(
                junction_type="resistive_junction", junction_values={"R": [1.0]}
            ),
            "junction J0: R has 1 values for 3 branches",
        ),
        (lambda c: c.update(vessels={}), "vessels: missing, or not a list"),
        (lambda c: c["vessels"].append(3), r"vessels\[3\]: not an object with vessel_name"),
        (lambda c: c.pop("simulation_parameters"), "simulation_parameters: missing"),
        (lambda c: c.update(vesels=[]), "the file: 'vesels' is not a known key"),
        (
            lambda c: c["simulation_parameters"].update(number_of_cardiac_cycles=0),
            "number_of_cardiac_cycles = 0 is not a whole number of 1 or more",
        ),
        (lambda c: c["simulation_parameters"].update(steady=True), "'steady' is not a known key"),
        (lambda c: c["simulation_parameters"].update(coupled_simulation=True), "a 3D solver"),
        (
            lambda c: (
                c.update(initial_condition={"pressure_all": 1.0}),
                c["simulation_parameters"].update(steady_initial=False),
            ),
            "initial_condition: not supported",
        ),
        (lambda c: c.update(y={}, dy={}), "read it with `read_calibration`"),
    ],
)
def test_faults_are_named_with_what_is_supported(spoil, fault):
    config = bifurcation()
    spoil(config)
    with pytest.raises(ValueError, match=f"(?s)cannot be read.*{fault}.*Supported are the vessels"):
        lumped.read_svzerod(config)


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (
            lambda c: c["boundary_conditions"][1].update(bc_type="ClosedLoopRCR"),
            "'OUT_A' of type 'ClosedLoopRCR' is not supported: it closes the circulation",
        ),
        (
            lambda c: c["boundary_conditions"][2].update(bc_type="CORONARY_VAR_RES"),
            "'OUT_B' of type 'CORONARY_VAR_RES' is not supported: its resistances change",
        ),
        (
            lambda c: c["vessels"][0].update(zero_d_element_type="BloodVesselA"),
            "'root' of type 'BloodVesselA' is not supported: there is no such element",
        ),
        (
            lambda c: c.update(chambers=[{"name": "LV", "type": "ChamberElastanceInductor"}]),
            "'LV' of type 'ChamberElastanceInductor' is not supported: a heart chamber",
        ),
        (
            lambda c: c.update(valves=[{"name": "AV", "type": "ValveTanh"}]),
            "'AV' of type 'ValveTanh' is not supported: a valve",
        ),
        (
            lambda c: c.update(external_solver_coupling_blocks=[{"name": "X", "type": "FLOW"}]),
            "'X' of type 'FLOW' is not supported: it waits for a 3D solver",
        ),
    ],
)
def test_unsupported_elements_are_named_with_their_type_and_reason(spoil, fault):
    config = bifurcation()
    spoil(config)
    with pytest.raises(ValueError, match=f"(?s){re.escape(fault)}.*Supported are"):
        lumped.read_svzerod(config)


def test_blocks_at_inlets_are_refused():
    config = single(condition("OUT", "FLOW", **BEAT), condition("IN", "RCR", Rp=1.0, C=1.0, Rd=1.0))
    with pytest.raises(ValueError, match=r"IN: a RCR at an inlet would be a negative resistance"):
        lumped.read_svzerod(config)


def test_all_faults_are_reported_together():
    config = bifurcation()
    spoil_condition(2, Pv=3.0)(config)
    drop(1, "Rd")(config)
    config["simulation_parameters"]["output_interval"] = 0
    with pytest.raises(ValueError, match=r"output_interval") as refused:
        lumped.read_svzerod(config)
    assert str(refused.value).count("\n  - ") == 3


@pytest.mark.parametrize("text", ["", "{", "\x00\x01"])
def test_files_that_are_not_json_are_refused(tmp_path, text):
    path = tmp_path / "case.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"case\.json is not JSON.*Give a svZeroDSolver case"):
        lumped.read_svzerod(path)
    path.write_text("[1, 2]")
    with pytest.raises(ValueError, match=r"case\.json cannot be read[^,]*not an object"):
        lumped.read_svzerod(path)


def round_trip(case, path):
    lumped.write_svzerod(path, case)
    return lumped.read_svzerod(path)


def assert_same_case(a, b):
    assert eqx.tree_equal(a.network, b.network)
    for field in (
        "period",
        "cycles",
        "points_per_cycle",
        "steady_initial",
        "cycle_error",
        "output",
    ):
        assert getattr(a, field) == getattr(b, field), field


def test_round_trip_keeps_the_network(tmp_path):
    plain, losses = bifurcation(), bifurcation()
    values = {"R_poiseuille": [1.0, 2.0], "L": [0.0, 3.0], "stenosis_coefficient": [0.0, 4.0]}
    losses["junctions"] = [junction("J0", [3], [8, 5], "BloodVesselJunction", **values)]
    losses["simulation_parameters"] |= {
        "use_cycle_to_cycle_error": True,
        "steady_initial": False,
        "output_interval": 3,
    }
    outlet = single(condition("IN", "PRESSURE", P=[1.0], t=[0.0]), condition("OUT", "FLOW", **BEAT))
    for config in (plain, losses, outlet):
        case = lumped.read_svzerod(config)
        assert_same_case(case, round_trip(case, tmp_path / "out.json"))


def test_steady_sources_are_held_at_the_mean_of_the_samples():
    case = lumped.read_svzerod(bifurcation())
    steady = steady_sources(case.network, case.period, samples=10)
    assert float(steady["IN"].waveform(0.0)) == pytest.approx(7.0 / 4.0, rel=1e-15)
    assert float(steady["OUT_B"].P_im(0.0)) == pytest.approx(7.0 / 3.0, rel=1e-15)
