import copy
import json
import re
import types

import numpy as np
import pytest

from lumped.svzerod_calibration import read_calibration, write_calibrated

NODES = ("IN:root", "root:J0", "J0:left", "J0:right", "left:OUT_L", "right:OUT_R")
SAMPLES = 4


def vessel(identity, name, **conditions):
    return {
        "vessel_id": identity,
        "vessel_name": name,
        "vessel_length": 1.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 10.0 + identity, "L": 0.5},
        "boundary_conditions": conditions,
    }


def bifurcation():
    """One vessel that splits in two; every sample tells table, node and variable apart."""
    numbers = {
        (table, variable, node): [1000.0 * i + 100.0 * j + 10.0 * k + n for n in range(SAMPLES)]
        for i, table in enumerate(("y", "dy"))
        for j, variable in enumerate(("pressure", "flow"))
        for k, node in enumerate(NODES)
    }
    return {
        "boundary_conditions": [],
        "simulation_parameters": {"density": 1.06},
        "calibration_parameters": {"tolerance_gradient": 1e-5},
        "vessels": [
            vessel(7, "root", inlet="IN"),
            vessel(3, "right", outlet="OUT_R"),
            vessel(5, "left", outlet="OUT_L"),
        ],
        "junctions": [
            {
                "junction_name": "J0",
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": [7],
                "outlet_vessels": [5, 3],
            }
        ],
        **{
            table: {f"{v}:{node}": x for (t, v, node), x in numbers.items() if t == table}
            for table in ("y", "dy")
        },
    }


def write(tmp_path, config):
    path = tmp_path / "case.json"
    path.write_text(config if isinstance(config, str) else json.dumps(config))
    return path


def read(tmp_path, config):
    return read_calibration(write(tmp_path, config))


def arrays(count):
    names = ("R_viscous", "C", "L", "K_stenosis")
    return types.SimpleNamespace(**{n: np.arange(count) + 0.1 * i for i, n in enumerate(names)})


def test_samples_reach_the_vessels_they_belong_to(tmp_path):
    config = bifurcation()
    case = read(tmp_path, config)
    assert case.vessels.names == ("root", "right", "left")
    record = case.vessels.record
    for i, (inlet, outlet) in enumerate(
        [("IN:root", "root:J0"), ("J0:right", "right:OUT_R"), ("J0:left", "left:OUT_L")]
    ):
        assert record["P_in"][i].tolist() == config["y"][f"pressure:{inlet}"]
        assert record["P_out"][i].tolist() == config["y"][f"pressure:{outlet}"]
        assert record["Q_in"][i].tolist() == config["y"][f"flow:{inlet}"]
        assert record["Q_out"][i].tolist() == config["y"][f"flow:{outlet}"]
        assert record["dP_in"][i].tolist() == config["dy"][f"pressure:{inlet}"]
        assert record["dQ_in"][i].tolist() == config["dy"][f"flow:{inlet}"]
        assert record["dQ_out"][i].tolist() == config["dy"][f"flow:{outlet}"]


def test_junction_outlets_read_as_vessels_without_capacitance(tmp_path):
    config = bifurcation()
    outlets = read(tmp_path, config).junction_outlets
    assert outlets.names == ("J0:left", "J0:right")
    for i, node in enumerate(outlets.names):
        assert outlets.record["P_in"][i].tolist() == config["y"]["pressure:root:J0"]
        assert outlets.record["P_out"][i].tolist() == config["y"][f"pressure:{node}"]
        for end in ("in", "out"):
            assert outlets.record[f"Q_{end}"][i].tolist() == config["y"][f"flow:{node}"]
            assert outlets.record[f"dQ_{end}"][i].tolist() == config["dy"][f"flow:{node}"]
    assert not outlets.free["C"].any()
    assert outlets.free["R_viscous"].all()


def test_options_and_initial_values_are_read(tmp_path):
    config = bifurcation()
    case = read(tmp_path, config)
    assert (case.with_stenosis, case.with_capacitance) == (True, True)
    assert case.vessels.initial["R_viscous"].tolist() == [17.0, 13.0, 15.0]
    assert case.vessels.initial["C"].tolist() == [0.0, 0.0, 0.0]
    assert all(column.all() for column in case.vessels.free.values())
    config["calibration_parameters"] |= {
        "calibrate_stenosis_coefficient": False,
        "set_capacitance_to_zero": True,
    }
    case = read(tmp_path, config)
    assert (case.with_stenosis, case.with_capacitance) == (False, False)


def test_lists_of_free_parameters_are_read(tmp_path):
    config = bifurcation()
    config["vessels"][1]["calibrate"] = ["R_poiseuille", "stenosis_coefficient"]
    config["junctions"][0] |= {
        "calibrate": ["L"],
        "junction_type": "BloodVesselJunction",
        "junction_values": {
            "R_poiseuille": [1.0, 2.0],
            "L": [3.0, 4.0],
            "stenosis_coefficient": [5.0, 6.0],
        },
    }
    case = read(tmp_path, config)
    free = case.vessels.free
    assert free["R_viscous"].tolist() == free["K_stenosis"].tolist() == [False, True, False]
    assert not free["C"].any()
    assert not free["L"].any()
    assert case.junction_outlets.free["L"].tolist() == [True, True]
    assert not case.junction_outlets.free["R_viscous"].any()
    assert case.junction_outlets.initial["L"].tolist() == [3.0, 4.0]
    assert case.junction_outlets.initial["K_stenosis"].tolist() == [5.0, 6.0]


def test_written_case_carries_the_parameters_and_nothing_of_the_calibration(tmp_path):
    config = bifurcation()
    config["vessels"][1]["calibrate"] = config["junctions"][0]["calibrate"] = ["L"]
    path = write(tmp_path, config)
    out = tmp_path / "out.json"
    write_calibrated(path, arrays(3), out, junctions=arrays(2))
    found = json.loads(out.read_text())
    assert not any("calibrate" in one for one in (*found["vessels"], *found["junctions"]))
    assert found["vessels"][1]["zero_d_element_values"] == {
        "R_poiseuille": 1.0,
        "C": 1.1,
        "L": 1.2,
        "stenosis_coefficient": pytest.approx(1.3, rel=1e-15),  # 1 + 0.1·3 rounds
    }
    assert found["junctions"][0]["junction_type"] == "BloodVesselJunction"
    assert found["junctions"][0]["junction_values"].keys() == {
        "R_poiseuille",
        "L",
        "stenosis_coefficient",
    }
    assert found["junctions"][0]["junction_values"]["L"] == [0.2, 1.2]
    assert found.keys() == config.keys() - {"y", "dy", "calibration_parameters"}
    assert found["simulation_parameters"] == config["simulation_parameters"]


def test_junctions_stay_where_no_values_are_given(tmp_path):
    config = bifurcation()
    out = tmp_path / "out.json"
    write_calibrated(write(tmp_path, config), arrays(3), out)
    assert json.loads(out.read_text())["junctions"] == config["junctions"]


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda c: c["y"].pop("flow:J0:left"), "y: 'flow:J0:left' is missing"),
        (lambda c: c["dy"].pop("pressure:IN:root"), "dy: 'pressure:IN:root' is missing"),
        (lambda c: c["y"]["flow:IN:root"].pop(), "'flow:IN:root' has 3 samples"),
        (lambda c: c["dy"]["flow:IN:root"].append(1.0), "'flow:IN:root' has 5 samples"),
        (lambda c: c["y"].update({"flow:IN:root": ["a"] * 4}), "not a list of finite numbers"),
        (lambda c: c["y"].update({"flow:IN:root": [float("nan")] * 4}), "not a list of finite"),
        (lambda c: c.pop("dy"), "dy: missing"),
        (lambda c: c.update(vessels={}), "vessels: missing, or not a list"),
        (lambda c: c.update(vessels=[], junctions=[]), "vessels: empty"),
        (lambda c: c["vessels"][0].update(zero_d_element_type="BloodVesselCRL"), "BloodVesselCRL"),
        (lambda c: c["vessels"][0].pop("vessel_id"), r"vessels\[0\]"),
        (lambda c: c["vessels"][0].update(vessel_id=3), "vessel_id 3: used twice"),
        (lambda c: c["vessels"][0].pop("boundary_conditions"), "inlet connected to nothing"),
        (lambda c: c["junctions"][0].pop("junction_name"), r"junctions\[0\]"),
        (lambda c: c["junctions"][0].update(inlet_vessels=[99]), r"vessel_id \[99\]"),
        (lambda c: c["junctions"][0].update(inlet_vessels=[7, 7]), "exactly one inlet"),
        (lambda c: c["vessels"][0]["zero_d_element_values"].update(L="x"), "L: an initial value"),
        (lambda c: c["vessels"][0].update(zero_d_element_values=3), "root: zero_d_element_values"),
        (lambda c: c["vessels"][0].update(calibrate=True), "root: calibrate is not a list"),
        (lambda c: c["junctions"][0].update(calibrate=True), "J0: calibrate is not a list"),
        (lambda c: c["junctions"][0].update(junction_values=3), "J0: junction_values is not an"),
        (
            lambda c: c["junctions"][0].update(
                junction_type="BloodVesselJunction", junction_values={"L": 1.0}
            ),
            "L: an initial value",
        ),
        (
            lambda c: c["junctions"][0].update(
                junction_type="BloodVesselJunction", junction_values={"L": [1.0]}
            ),
            "L: an initial value",
        ),
        (
            lambda c: (
                c["vessels"][0].update(calibrate=["C"]),
                c["calibration_parameters"].update(set_capacitance_to_zero=True),
            ),
            "set_capacitance_to_zero is true",
        ),
        (
            lambda c: (
                c["vessels"][0].update(calibrate=["stenosis_coefficient"]),
                c["calibration_parameters"].update(calibrate_stenosis_coefficient=False),
            ),
            "calibrate_stenosis_coefficient is false",
        ),
    ],
)
def test_bad_files_are_refused_with_their_fault(tmp_path, spoil, fault):
    config = copy.deepcopy(bifurcation())
    spoil(config)
    with pytest.raises(ValueError, match=f"(?s)case.json.*{fault}.*Correct these entries"):
        read(tmp_path, config)


def test_all_missing_samples_are_named_together(tmp_path):
    config = bifurcation()
    for key in ("flow:J0:left", "pressure:root:J0"):
        config["y"].pop(key)
    with pytest.raises(ValueError, match="is missing") as refused:
        read(tmp_path, config)
    assert "'pressure:root:J0'" in str(refused.value)
    assert "'flow:J0:left'" in str(refused.value)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "\x00\x01"])
def test_files_that_are_no_case_are_refused(tmp_path, text):
    with pytest.raises(ValueError, match=re.escape("case.json")):
        read(tmp_path, text)


def test_refused_output_leaves_nothing_behind(tmp_path):
    path = write(tmp_path, bifurcation())
    with pytest.raises(ValueError, match="the file has 3 vessels"):
        write_calibrated(path, arrays(2), tmp_path / "out.json")
    bad = arrays(3)
    bad.L[1] = np.inf
    with pytest.raises(ValueError, match="L: not finite for vessels"):
        write_calibrated(path, bad, tmp_path / "out.json")
    assert [p.name for p in tmp_path.iterdir()] == ["case.json"]


def test_failed_writing_keeps_the_old_file(tmp_path, monkeypatch):
    path = write(tmp_path, bifurcation())
    out = tmp_path / "out.json"
    out.write_text("old")

    def fail(source, target):
        raise OSError("no space")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="no space"):
        write_calibrated(path, arrays(3), out)
    assert out.read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["case.json", "out.json"]
