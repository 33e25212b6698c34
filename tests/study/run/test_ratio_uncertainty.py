"""FFR with an interval: from the case, the literature and a measured flow reserve; bad input."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from calibration import Runs
from lumped import MMHG, AorticPressure
from study import read_case
from study.case.faults import CaseError
from study.run.drawn_runs import drawn_case, drawn_values
from study.run.patient import load_patient
from study.run.progress import Progress
from study.run.ratio_uncertainty import (
    condition_inputs,
    response_to_stress,
    stress_model,
    uncertain_ratios,
    venous_range,
)

CASE = """\
[patient]
id = "unsure"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.91
ffr_sd = 0.01
[condition.dobutamine]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
{reserve}
[body]
{age}
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
[uncertainty]
{known}
"""


def _case(tmp_path, known="", reserve="", age=""):
    file = tmp_path / "unsure.toml"
    file.write_text(CASE.format(known=known, reserve=reserve, age=age))
    return read_case(file)


def _found(case):
    (one,) = uncertain_ratios(load_patient(case), Progress(), n_samples=2**12).found
    return one


def test_intervals_of_the_linear_law_follow_from_the_divider(tmp_path):
    known = """
pressure_sd_mmHg = 0
period_sd = 0
loss_sd = 0.4
im_factor_sd = 0
P_venous_low_mmHg = 0
P_venous_high_mmHg = 0.1
bed_factor = 0.5
bed_factor_sd = 0.3
stress_loss = 1
stress_loss_sd = 0
"""
    one = _found(_case(tmp_path, known))
    # FFR = f β/(1 + f β), β = r/(1 − r); r is nearly normal, f lognormal
    rng = np.random.default_rng(1)
    r, f = rng.normal(0.91, 0.01, 200_000), 0.5 * np.exp(0.3 * rng.standard_normal(200_000))
    beta = f * r / (1.0 - r)
    expected = np.quantile(beta / (1.0 + beta), [0.05, 0.95])
    # quantiles of 4096 points of a Sobol sequence, venous pressure below 0.1 mmHg
    assert one.found.interval() == pytest.approx(expected, abs=3e-3)
    assert one.found.slopes["R0"] == pytest.approx(0.0, abs=1e-9)
    assert next(iter(one.found.shares)) == "bed_factor"
    assert one.bed_factors["all"] == pytest.approx(0.5)


def test_flow_reserve_narrows_the_interval_to_its_place(tmp_path):
    wide = _found(_case(tmp_path))
    narrow = _found(_case(tmp_path, reserve="flow_reserve = 1.5\nflow_reserve_sd = 0.1"))
    assert narrow.flow_reserve == (1.5, 0.1)
    width = [high - low for low, high in (wide.found.interval(), narrow.found.interval())]
    assert width[1] < 0.7 * width[0]
    # a bed that lets through less has the higher ratio
    assert narrow.found.median > wide.found.median
    assert narrow.found.n_effective < wide.found.n_effective


@pytest.mark.parametrize(
    ("known", "age", "source"),
    [
        ("", "age_years = 9", "assumed as under adenosine"),
        ("", "age_years = 40", "Jiang et al. 2022"),
        ("", "", "adults and children pooled"),
        ("bed_factor = 0.6", "", "the case"),
    ],
)
def test_evidence_is_that_of_age_and_drug(known, age, source, tmp_path):
    found = response_to_stress(_case(tmp_path, known, age=age), "dobutamine")
    assert source in found.source
    if source == "the case":
        assert float(found.bed_factor.median) == 0.6
    other = response_to_stress(_case(tmp_path, known, age=age), "exercise")
    assert float(other.stress_loss.median) < float(found.stress_loss.median)


@pytest.mark.parametrize(
    ("known", "reserve", "said"),
    [
        ("P_venous_low_mmHg = 12\nP_venous_high_mmHg = 5", "", "is not above the least one, 12"),
        ("bed_factor = 7", "", "bed_factor"),
        ("bed_facter = 0.5", "", "bed_factor"),
        ("age_years = 9", "", r"move it below \[body\]"),
        ("", "flow_reserve = 40", "flow_reserve"),
    ],
)
def test_bad_uncertainty_is_refused(known, reserve, said, tmp_path):
    with pytest.raises(CaseError, match=said):
        _case(tmp_path, known, reserve)


def test_a_deviation_of_nothing_is_refused(tmp_path):
    with pytest.raises(CaseError, match=r"dobutamine\.ffr_sd.*standard deviation without its ffr"):
        _case(tmp_path, reserve="ffr_sd = 0.02")


def test_flow_reserve_at_rest_is_refused(tmp_path):
    file = tmp_path / "unsure.toml"
    text = CASE.format(known="", reserve="", age="").replace("ffr_sd = 0.01", "flow_reserve = 2.0")
    file.write_text(text)
    with pytest.raises(CaseError, match="a flow reserve is measured under stress"):
        read_case(file)


def test_quadratic_law_is_corrected_by_periodic_states(tmp_path):
    case = _case(tmp_path)
    law = dataclasses.replace(case.surrogate, R0=700.0, K=400.0, law="quadratic")
    case = dataclasses.replace(case, surrogate=law)
    one = _found(case)
    (level,) = one.found.corrections
    assert (level.kind, level.n_runs) == ("linear", 128)
    # what periodic states add is small against the interval
    low, high = one.found.interval()
    assert level.error < 0.1 * (high - low)
    patient = load_patient(case)
    inputs = condition_inputs(patient, "dobutamine")
    medians = {name: spread.value(jnp.zeros(())) for name, spread in inputs.items()}
    exact = float(stress_model(patient, "dobutamine").ffr(medians))
    assert one.found.nominal == pytest.approx(exact, abs=3.0 * level.error)


@pytest.mark.parametrize(("R0", "K"), [(5.0e3, 0.0), (0.0, 900.0)])
def test_a_loss_of_zero_has_no_error(tmp_path, R0, K):
    case = _case(tmp_path)
    law = dataclasses.replace(case.surrogate, R0=R0, K=K, law="quadratic")
    patient = load_patient(dataclasses.replace(case, surrogate=law))
    inputs = condition_inputs(patient, "dobutamine")
    assert ("K" in inputs, "R0" in inputs) == (K > 0.0, R0 > 0.0)
    (one,) = uncertain_ratios(patient, Progress(), n_samples=2**10).found
    assert one.found.sd > 0.0
    if K == 0.0:  # a quadratic law without its quadratic part is the linear one
        (linear,) = uncertain_ratios(load_patient(case), Progress(), n_samples=2**10).found
        assert one.found.median == pytest.approx(linear.found.median, abs=2e-3)


def test_runs_in_3d_move_the_interval(tmp_path):
    patient = load_patient(_case(tmp_path))
    (plain,) = uncertain_ratios(patient, Progress(), n_samples=2**12).found
    runs = {"dobutamine": Runs(np.array([0.83]), np.array([0.86]), name="runs in 3D", error=0.02)}
    (moved,) = uncertain_ratios(patient, Progress(), runs_in_3d=runs, n_samples=2**12).found
    assert [level.name for level in moved.found.corrections] == ["runs in 3D"]
    assert moved.found.median == pytest.approx(plain.found.median - 0.03, abs=3e-3)
    # a single run cannot tell by how much others differ: what is expected is allowed for
    assert moved.found.sd > plain.found.sd
    assert moved.found.slopes["runs in 3D"] == pytest.approx(0.02)
    assert uncertain_ratios(patient, Progress(), runs_in_3d={}).found == []


def test_drawn_numbers_reach_the_case_of_a_3d_run(tmp_path):
    case = _case(tmp_path)
    patient = load_patient(case)
    inputs = condition_inputs(patient, "dobutamine")
    z = np.full(len(inputs), 0.5)
    values = drawn_values(inputs, z)
    # lumen and mesh stay: their losses are those of the mesh
    assert set(inputs) - set(values) == {"R0", "stress_loss"}
    drawn = stress_model(patient, "dobutamine").with_values(values)
    changed = drawn_case(case, "dobutamine", drawn)
    again = load_patient(changed)
    for name, other in (("conditions", patient), ("rules", patient)):
        assert set(getattr(again, name)) >= set(getattr(other, name))
    entry = changed.conditions["dobutamine"]
    assert entry.period == pytest.approx(values["period"])
    assert entry.P_systolic == pytest.approx(values["P_systolic"])
    assert changed.conditions["rest"] == case.conditions["rest"]
    assert changed.coronary.P_venous == pytest.approx(values["P_venous"])
    # the bed of the case under stress is that of the drawn patient
    own = stress_model(again, "dobutamine", "factors")
    assert float(own.bed_factor) == pytest.approx(values["bed_factor"])


def test_a_measured_beat_goes_along_with_drawn_numbers(tmp_path):
    wave = AorticPressure(130.0, 70.0, 0.45)
    t = np.linspace(0.0, 0.45, 50, endpoint=False)
    rows = [f"{a:.5f},{float(wave(a)):.3f}" for a in t]
    (tmp_path / "beat.csv").write_text("\n".join(["time_s,P_aorta_mmHg", *rows]))
    case = _case(tmp_path, reserve='waveform = "beat.csv"')
    patient = load_patient(case)
    values = {"period": 0.5, "P_systolic": 150.0 * MMHG, "P_diastolic": 60.0 * MMHG}
    drawn = stress_model(patient, "dobutamine").with_values(values)
    entry = drawn_case(case, "dobutamine", drawn).conditions["dobutamine"]
    beat = entry.waveform
    assert len(beat.t) == 50
    assert beat.t[-1] == pytest.approx(0.5 * 49 / 50)
    known = case.conditions["dobutamine"]
    before = (np.array(known.waveform.P_aorta) - known.P_diastolic) / (
        known.P_systolic - known.P_diastolic
    )
    after = (np.array(beat.P_aorta) - 60.0 * MMHG) / (90.0 * MMHG)
    np.testing.assert_allclose(after, before, rtol=1e-12)
    # the case is a sound one: its conditions make a network and a periodic state
    again = load_patient(drawn_case(case, "dobutamine", drawn))
    assert float(stress_model(again, "dobutamine")()) == pytest.approx(float(drawn()), abs=1e-9)
    (one,) = uncertain_ratios(patient, Progress(), n_samples=2**8).found
    assert one.found.sd > 0.0


def test_a_condition_without_an_interval_leaves_the_others_theirs(tmp_path):
    # flow cannot fall to a third while the bed keeps less than half of its resistance
    impossible = "flow_reserve = 0.3\nflow_reserve_sd = 0.001"
    case = _case(tmp_path, reserve=impossible)
    with pytest.raises(RuntimeError, match="no interval of FFR under dobutamine"):
        uncertain_ratios(load_patient(case), Progress(), n_samples=2**10)
    other = dataclasses.replace(
        case.conditions["dobutamine"], name="exercise", flow_reserve=None, flow_reserve_sd=None
    )
    case = dataclasses.replace(case, conditions={**case.conditions, "exercise": other})
    both = uncertain_ratios(load_patient(case), Progress(), n_samples=2**10)
    assert [one.condition for one in both.found] == ["exercise"]
    assert list(both.failures) == ["dobutamine"]
    assert "[condition.dobutamine]" in both.failures["dobutamine"]


def test_drug_and_venous_pressure_of_the_case_count(tmp_path):
    named = _case(tmp_path, reserve='drug = "adenosine"')
    assert float(response_to_stress(named, "dobutamine").stress_loss.median) == 1.0
    assert response_to_stress(named, "dobutamine").pooled
    assert not response_to_stress(_case(tmp_path, age="age_years = 40"), "dobutamine").pooled
    measured = dataclasses.replace(named.coronary, P_venous=8.0 * MMHG)
    low, high = venous_range(dataclasses.replace(named, coronary=measured))
    assert (low / MMHG, high / MMHG) == pytest.approx((6.0, 10.0))
    assert venous_range(named)[1] / MMHG == pytest.approx(12.0)


def test_a_drug_at_rest_is_refused(tmp_path):
    file = tmp_path / "unsure.toml"
    text = CASE.format(known="", reserve="", age="")
    file.write_text(text.replace("ffr_sd = 0.01", 'ffr_sd = 0.01\ndrug = "adenosine"'))
    with pytest.raises(CaseError, match="a drug is given under stress"):
        read_case(file)


def test_numbers_of_the_body_are_drawn_with_its_spread(tmp_path):
    text = CASE.format(
        known="",
        reserve="",
        age='weight_kg = 36\nheight_cm = 144\nage_years = 11\nsex = "female"',
    )
    for line in ("P_systolic_mmHg = 110.0", "P_diastolic_mmHg = 65.0", "period_s = 0.80"):
        text = text.replace(f"{line}\n", "", 1)
    file = tmp_path / "unsure.toml"
    file.write_text(text)
    inputs = condition_inputs(load_patient(read_case(file)), "dobutamine")
    assert float(inputs["rest_P_systolic"].sd) / MMHG == pytest.approx(10.4855)
    assert float(inputs["rest_period"].log_sd) == 0.13
    assert float(inputs["P_systolic"].sd) / MMHG == pytest.approx(3.0)  # given, so measured
    low = inputs["rest_P_systolic"].value(jnp.array(-6.0))
    assert low > inputs["rest_P_diastolic"].value(jnp.array(6.0))
