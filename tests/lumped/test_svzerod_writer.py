"""Networks as svZeroDSolver case files, and back."""

import json

import equinox as eqx
import jax
import numpy as np
import pytest

import lumped
from lumped.svzerod_series import series_from_waveform


def sampled(times, values, period, **options):
    return lumped.sampled(np.array(times), np.array(values), period, **options)


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


def test_round_trip_keeps_the_reference_cases(shared_data, tmp_path):
    folder = shared_data / "svzerod"
    files = [*(folder / "cases").glob("*Flow_[!c]*.json"), *folder.glob("vmr/*optimal*.json")]
    files += (folder / "cases").glob("*confluence*.json")
    assert len(files) == 13
    for path in files:
        case = lumped.read_svzerod(path)
        assert_same_case(case, round_trip(case, tmp_path / "out.json"))


CONDITION = lumped.condition_from_clinic(110.0, 65.0, 0.8)


def surrogate(**changes):
    bed = lumped.nominal_coronary(P_venous=1.0e3, im_factor=0.5)
    return lumped.Surrogate(R0=5e3, alpha=0.2, coronary=bed, **changes).network(CONDITION)


def test_surrogate_is_written_with_scaled_resistances_and_pressure(tmp_path):
    network = surrogate(K=20.0)
    path = tmp_path / "patient.json"
    lumped.write_svzerod(path, network, period=0.8, samples=100)
    config = json.loads(path.read_text())
    inlet, bed = config["boundary_conditions"]
    (ostium,) = config["vessels"]
    assert ostium["zero_d_element_values"] == {
        "R_poiseuille": 5e3,
        "C": 1e-7,
        "L": 0.0,
        "stenosis_coefficient": 20.0,
    }
    assert ostium["boundary_conditions"] == {"inlet": "inlet", "outlet": "coronary"}
    assert bed["bc_values"]["Ra1"] == pytest.approx(0.2 * 3.1992e4, rel=1e-15)
    assert bed["bc_values"]["P_v"] == 1e3
    t, P_im = (np.array(bed["bc_values"][key]) for key in ("t", "Pim"))
    ventricle = lumped.VentricularPressure(110.0 * lumped.MMHG, 0.8)
    assert np.allclose(P_im, 0.5 * jax.vmap(ventricle)(t % 0.8), rtol=1e-14)
    assert 0.0692 * 0.8 in t  # a breakpoint off the grid
    assert t.size == 102  # the other one, 0.4 T, is on the grid
    assert inlet["bc_values"]["P"][0] == inlet["bc_values"]["P"][-1]
    again = lumped.read_svzerod(path)
    assert again.name == "patient"
    assert again.network["coronary"].im_factor == 1.0


def test_written_series_are_exact_for_linear_samples_and_close():
    wave = sampled([0.2, 0.5], [1.0, 4.0], 0.8)
    t, values = series_from_waveform(wave, 0.8, samples=7)
    assert np.allclose(t, [0.0, 0.2, 0.5, 0.8], rtol=0, atol=1e-15)
    assert np.allclose(values, [2.2, 1.0, 4.0, 2.2], rtol=1e-14)  # rounding
    t, values = series_from_waveform(wave, 1.6, samples=7)  # two beats
    assert np.allclose(t, [0.0, 0.2, 0.5, 1.0, 1.3, 1.6], rtol=0, atol=1e-15)
    cubic = sampled([0.0, 0.3, 0.5], [1.0, 4.0, 2.0], 0.8, kind="cubic")
    t, values = series_from_waveform(cubic, 0.8, samples=4)
    assert np.allclose(t, [0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8], rtol=0, atol=1e-15)
    assert np.allclose(values[:-1], jax.vmap(cubic)(t[:-1]), rtol=1e-14)


def test_blocks_that_a_vessel_leaves_stand_on_junctions():
    """A block at a vessel's inlet would be a negative resistance: a junction turns it."""
    pressure = lumped.PressureSource(lumped.Constant(100.0))
    network = lumped.connect(
        {
            "side": (lumped.RC(R=10.0, C=1.0), "a"),
            "v": (lumped.Vessel(R_viscous=5.0), "a", "b"),
            "end": (pressure, "b"),
        }
    )
    config = lumped.svzerod_config(lumped.SvZeroDCase(network, 1.0))
    assert config["junctions"] == [
        {
            "junction_name": "a",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_blocks": [],
            "outlet_blocks": ["v", "side"],
        }
    ]
    assert config["boundary_conditions"][0]["bc_values"] == {
        "Rp": 0.0,
        "C": 1.0,
        "Rd": 10.0,
        "Pd": 0.0,
    }
    again = lumped.read_svzerod(config).network
    assert again.ports[again.names.index("side")] == ("a",)


@pytest.mark.parametrize(
    ("element", "fault"),
    [
        (lumped.RCRL(1.0, 1.0, 1.0, 1.0), "side: RCRL has no counterpart in svZeroDSolver"),
        (lumped.FlowSource(lumped.Ramp(0.0, 1.0)), "side: Ramp does not repeat after the period"),
        (lumped.FlowSource(sampled([0.0, 0.1], [1.0, 2.0], 0.3)), "does not divide the per"),
        (
            lumped.Resistance(np.array([1.0, 2.0])),
            "R = .* is not one finite number; write one patient",
        ),
    ],
)
def test_what_a_file_cannot_hold_is_refused(tmp_path, element, fault):
    network = lumped.connect(
        {
            "v": (lumped.Vessel(R_viscous=5.0), "a", "b"),
            "side": (element, "a"),
            "end": (lumped.Resistance(1.0), "b"),
        }
    )
    with pytest.raises(ValueError, match=f"(?s){fault}.*Use the elements that both have"):
        lumped.write_svzerod(tmp_path / "out.json", network, period=1.0)
    assert not list(tmp_path.iterdir())


def test_period_belongs_to_a_network_only(tmp_path):
    with pytest.raises(ValueError, match="Give `period`"):
        lumped.write_svzerod(tmp_path / "out.json", surrogate())
    case = lumped.SvZeroDCase(surrogate(), 0.8)
    with pytest.raises(ValueError, match="Leave `period` out"):
        lumped.write_svzerod(tmp_path / "out.json", case, period=0.8)


@pytest.mark.parametrize("change", [{"period": 0.0}, {"cycles": 0}, {"points_per_cycle": 1}])
def test_settings_without_meaning_are_refused(change):
    with pytest.raises(ValueError, match=r"must be positive|at least 1 cycle"):
        lumped.SvZeroDCase(**({"network": surrogate(), "period": 0.8} | change))
