import copy
import json

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from calibration.vascular import FreeParameters, VesselFit, calibrate_vessels
from calibration.vessel_record import (
    VesselParameters,
    VesselRecord,
    synthetic_record,
    vessel_residuals,
)
from lumped.svzerod_calibration import read_calibration, write_calibrated

SVZEROD_NAMES = ("R_poiseuille", "C", "L", "stenosis_coefficient")


def P_in(t):
    return 1.2e5 + 2.0e4 * jnp.sin(7.0 * t) + 6.0e3 * jnp.cos(16.0 * t + 0.3)


def Q_in(t):
    # turns negative, so that abs(Q) is tried on both sides
    return 3.0 + 6.0 * jnp.sin(7.0 * t + 0.2) + 1.5 * jnp.cos(23.0 * t)


def true_parameters(vessels):
    rng = np.random.default_rng(7)
    return VesselParameters(
        R_viscous=10 ** rng.uniform(0, 3, vessels),
        C=10 ** rng.uniform(-7, -5, vessels),
        L=10 ** rng.uniform(0, 1.5, vessels),
        K_stenosis=10 ** rng.uniform(-1, 1.5, vessels),
    )


def exact_record(vessels, samples=80):
    return synthetic_record(true_parameters(vessels), jnp.linspace(0.0, 0.9, samples), P_in, Q_in)


def noisy_record(vessels, samples=80):
    """A record that no parameters fit, so that second derivatives of the residual matter."""
    rng = np.random.default_rng(11)
    return jax.tree.map(
        lambda x: x + 0.05 * jnp.std(x) * jnp.asarray(rng.standard_normal(x.shape)),
        exact_record(vessels, samples),
    )


def table(parameters):
    return np.asarray(parameters.as_table())


def fit_case(part, **options) -> VesselFit:
    return calibrate_vessels(
        VesselRecord(**part.record),
        initial=VesselParameters(**part.initial),
        free=FreeParameters(**part.free),
        **options,
    )


def with_lists(config, names=SVZEROD_NAMES):
    """The same case in the file format of svZeroDSolver 3.2."""
    config = copy.deepcopy(config)
    for vessel in config["vessels"]:
        vessel["calibrate"] = list(names)
    return config


@pytest.fixture
def vmr_case(shared_data):
    return shared_data / "svzerod" / "vmr" / "0104_0001_calibrate_from_0d.json"


@pytest.fixture
def steady_case(shared_data):
    return shared_data / "svzerod" / "cases" / "steadyFlow_calibration.json"


def test_exact_records_leave_no_residual():
    record = exact_record(3)
    momentum, mass = vessel_residuals(true_parameters(3), record)
    # round-off of the largest terms
    assert float(jnp.max(jnp.abs(momentum))) < 1e-13 * 1.5e5
    assert float(jnp.max(jnp.abs(mass))) < 1e-13 * 15.0


def test_synthetic_vessels_are_recovered_to_round_off():
    fit = calibrate_vessels(exact_record(3))
    # round-off times the largest ratio of a column to the smallest parameter's share (1e3)
    np.testing.assert_allclose(table(fit.parameters), table(true_parameters(3)), rtol=1e-11)
    assert np.all(np.asarray(fit.rank) == 4)
    assert np.all(np.asarray(fit.residual_norm) < 1e-13 * 1.5e5 * np.sqrt(160))


def test_recovery_does_not_depend_on_the_start():
    far = jax.tree.map(lambda x: 30.0 * x, true_parameters(3))
    fit = calibrate_vessels(exact_record(3), initial=far)
    # as above
    np.testing.assert_allclose(table(fit.parameters), table(true_parameters(3)), rtol=1e-11)


def test_optimum_of_svzerod_is_reproduced(vmr_case):
    case = read_calibration(vmr_case)
    fit = fit_case(
        case.vessels, with_stenosis=case.with_stenosis, with_capacitance=case.with_capacitance
    )
    stored = json.loads((vmr_case.parent / "0104_0001_optimal_from_0d.json").read_text())
    expected = np.array(
        [[v["zero_d_element_values"][key] for key in SVZEROD_NAMES] for v in stored["vessels"]]
    )
    found = table(fit.parameters)
    # both sides stop at round-off of well-conditioned problems
    np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=1e-11)
    # the quadratic loss is down to 1e-6 of the pressure drop: round-off there counts 1e6-fold
    np.testing.assert_allclose(found[:, 3], expected[:, 3], rtol=1e-6)


def test_written_case_equals_the_stored_optimum_of_svzerod(vmr_case, tmp_path):
    case = read_calibration(vmr_case)
    vessels = fit_case(case.vessels).parameters
    # the 0D run behind the record has plain junctions: no drop, so exactly zero parameters
    junctions = fit_case(case.junction_outlets, with_capacitance=False).parameters
    write_calibrated(vmr_case, vessels, tmp_path / "out.json", junctions=junctions)
    found = json.loads((tmp_path / "out.json").read_text())
    stored = json.loads((vmr_case.parent / "0104_0001_optimal_from_0d.json").read_text())
    for ours, theirs in zip(found["vessels"], stored["vessels"], strict=True):
        # as in the test above, for the worst of the four
        assert ours["zero_d_element_values"] == pytest.approx(
            theirs["zero_d_element_values"], rel=1e-6, abs=0.0
        )
        ours["zero_d_element_values"] = theirs["zero_d_element_values"]
    assert found == stored


def test_steady_flow_keeps_the_start_where_it_already_fits(steady_case):
    part = read_calibration(steady_case).vessels
    fit = fit_case(part)
    assert int(fit.rank[0]) == 1
    # the file is a solution to 1e-11 of the pressure drop, the start of the iteration
    np.testing.assert_allclose(table(fit.parameters), [[100.0, 1e-4, 1.0, 0.0]], atol=1e-9)


def test_steady_flow_from_zero_shares_the_loss_equally(steady_case):
    # 500 dyn/cm² at 5 cm³/s: only R + 5 K = 100 is known; L and C never enter
    fit = calibrate_vessels(VesselRecord(**read_calibration(steady_case).vessels.record))
    assert int(fit.rank[0]) == 1
    # the flow and pressure of the file carry 1e-11 of noise
    np.testing.assert_allclose(table(fit.parameters), [[50.0, 0.0, 0.0, 10.0]], rtol=1e-9)


def test_steady_flow_agrees_with_svzerod_in_what_is_determined(steady_case):
    svzerod = pytest.importorskip("svzerod")
    config = with_lists(json.loads(steady_case.read_text()))
    kept = svzerod.calibrate(config)["vessels"][0]["zero_d_element_values"]
    expected = dict(zip(SVZEROD_NAMES, (100.0, 1e-4, 1.0, 0.0), strict=True))
    # the tolerance of its increment is 1e-10
    assert kept == pytest.approx(expected, abs=1e-8)
    config["vessels"][0]["zero_d_element_values"] = dict.fromkeys(SVZEROD_NAMES, 0.0)
    moved = svzerod.calibrate(config)["vessels"][0]["zero_d_element_values"]
    # from zero its split between R and K differs from ours, their sum does not
    assert moved["R_poiseuille"] + 5.0 * moved["stenosis_coefficient"] == pytest.approx(100.0)
    assert moved["L"] == moved["C"] == 0.0


@pytest.mark.parametrize(
    ("names", "options"),
    [
        (("R_poiseuille", "C", "L"), {"with_stenosis": False}),
        (("R_poiseuille", "L", "stenosis_coefficient"), {"with_capacitance": False}),
        (("R_poiseuille", "L"), {"with_stenosis": False, "with_capacitance": False}),
    ],
)
def test_held_parameters_stay_zero_and_the_rest_agrees_with_svzerod(vmr_case, names, options):
    svzerod = pytest.importorskip("svzerod")
    fit = fit_case(read_calibration(vmr_case).vessels, **options)
    result = svzerod.calibrate(with_lists(json.loads(vmr_case.read_text()), names))
    expected = np.array(
        [[v["zero_d_element_values"][key] for key in SVZEROD_NAMES] for v in result["vessels"]]
    )
    found = table(fit.parameters)
    held = [key not in names for key in SVZEROD_NAMES]
    assert np.all(found[:, held] == 0.0)
    # its stopping tolerances, 1e-9 of the increment, and the small share of the quadratic loss
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_held_value_is_kept_and_the_others_fitted_around_it():
    truth = true_parameters(3)
    yes, no = np.ones(3, bool), np.zeros(3, bool)
    free = FreeParameters(R_viscous=yes, C=yes, L=no, K_stenosis=yes)
    zeros = jnp.zeros(3)
    start = VesselParameters(R_viscous=zeros, C=zeros, L=truth.L, K_stenosis=zeros)
    fit = calibrate_vessels(exact_record(3), free=free, initial=start)
    assert np.array_equal(fit.parameters.L, truth.L)
    assert np.all(np.asarray(fit.rank) == 3)
    # as for the full recovery
    np.testing.assert_allclose(table(fit.parameters), table(truth), rtol=1e-11)


def test_more_samples_than_unknowns_are_not_needed():
    # two instants give four equations for four unknowns
    fit = calibrate_vessels(exact_record(2, samples=2))
    # round-off times the condition of the two-sample problem (1e4)
    np.testing.assert_allclose(table(fit.parameters), table(true_parameters(2)), rtol=1e-9)


def test_batch_equals_loop():
    record = noisy_record(3)
    batch = table(calibrate_vessels(record).parameters)
    for i in range(3):
        one = calibrate_vessels(jax.tree.map(lambda x, i=i: x[i : i + 1], record))
        # the order of summation differs with the batch
        np.testing.assert_allclose(table(one.parameters), batch[i : i + 1], rtol=1e-11)


def test_jit_equals_eager():
    record = noisy_record(1, samples=12)
    with jax.disable_jit():
        eager = calibrate_vessels(record)
    jitted = jax.jit(lambda r: calibrate_vessels(r).parameters)(record)
    # the order of summation differs
    np.testing.assert_allclose(table(jitted), table(eager.parameters), rtol=1e-11)


@pytest.mark.parametrize(
    "options", [{}, {"with_stenosis": False}, {"with_capacitance": False}], ids=str
)
def test_derivative_with_respect_to_the_record_equals_central_differences(options):
    record = noisy_record(3)
    rng = np.random.default_rng(3)
    direction = jax.tree.map(
        lambda x: jnp.std(x) * jnp.asarray(rng.standard_normal(x.shape)), record
    )

    def optimum(s):
        moved = jax.tree.map(lambda x, d: x + s * d, record, direction)
        return calibrate_vessels(moved, **options).parameters

    h = 1e-4
    above, below = table(optimum(h)), table(optimum(-h))
    _, slope = jax.jvp(optimum, (0.0,), (1.0,))
    # truncation h² times the curvature of the optimum, which is of the order of the slope
    np.testing.assert_allclose(table(slope), (above - below) / (2 * h), rtol=1e-5, atol=0.0)


def test_reverse_and_forward_derivatives_agree():
    record = noisy_record(3)

    def loss(r):
        fit = calibrate_vessels(r)
        return jnp.sum(jnp.log(fit.parameters.R_viscous)) + jnp.sum(fit.residual_norm)

    gradient = jax.grad(loss)(record)
    direction = jax.tree.map(jnp.ones_like, record)
    _, forward = jax.jvp(loss, (record,), (direction,))
    reverse = sum(float(jnp.sum(leaf)) for leaf in jax.tree.leaves(gradient))
    # summation order only
    assert reverse == pytest.approx(float(forward), rel=1e-9)


def test_derivative_with_respect_to_a_held_value_equals_central_differences():
    record = noisy_record(3)
    yes, no = np.ones(3, bool), np.zeros(3, bool)
    free = FreeParameters(R_viscous=yes, C=yes, L=no, K_stenosis=yes)
    zeros = jnp.zeros(3)

    def optimum(shift):
        start = VesselParameters(
            R_viscous=zeros, C=zeros, L=true_parameters(3).L + shift, K_stenosis=zeros
        )
        return calibrate_vessels(record, free=free, initial=start).parameters

    h = 1e-1
    difference = (table(optimum(h)) - table(optimum(-h))) / (2 * h)
    _, slope = jax.jvp(optimum, (0.0,), (1.0,))
    # round-off of C, 1e-12 beside a change of 1e-5; the optimum is close to linear in L
    np.testing.assert_allclose(table(slope), difference, rtol=1e-6)
    assert np.all(table(slope)[:, 2] == 1.0)


def test_second_derivative_equals_central_differences_of_the_first():
    record = noisy_record(1)

    def optimum(s):
        moved = jax.tree.map(lambda x: x * (1.0 + s), record.Q_in)
        changed = VesselRecord(**{**vars(record), "Q_in": moved})
        return jnp.log(calibrate_vessels(changed).parameters.R_viscous[0])

    h = 1e-4
    slope = jax.jacfwd(optimum)
    # truncation h²
    assert float(jax.jacfwd(slope)(0.0)) == pytest.approx(
        float(slope(h) - slope(-h)) / (2 * h), rel=1e-5
    )


def test_derivative_stays_finite_where_the_data_determine_little():
    steady = VesselRecord(
        **{
            name: jnp.full((1, 5), value)
            for name, value in dict(
                P_in=1100.0, Q_in=5.0, P_out=600.0, Q_out=5.0, dP_in=0.0, dQ_in=0.0, dQ_out=0.0
            ).items()
        }
    )
    gradient = jax.grad(lambda r: jnp.sum(calibrate_vessels(r).parameters.R_viscous))(steady)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradient))
    # half of dP/Q goes to R: d R/d P_in summed over samples is 1/(2 Q); exact but for round-off
    assert float(jnp.sum(gradient.P_in)) == pytest.approx(0.1, rel=1e-9)


def test_vessel_that_does_not_converge_is_named():
    record = exact_record(3)
    broken = VesselRecord(**{**vars(record), "P_in": record.P_in.at[1, 4].set(jnp.nan)})
    with pytest.raises(ValueError, match=r"vessels \[1\].*Look for infinite or missing"):
        calibrate_vessels(broken)
    fit = calibrate_vessels(broken, throw=False)
    good = np.asarray(fit.result == optx.RESULTS.successful)
    assert good.tolist() == [True, False, True]


def test_arrays_that_do_not_fit_together_are_refused():
    record = exact_record(3)
    with pytest.raises(ValueError, match="one value a vessel"):
        calibrate_vessels(record, initial=true_parameters(2))
    with pytest.raises(ValueError, match="same instants"):
        VesselRecord(**{**vars(record), "Q_out": record.Q_out[:, 1:]})
