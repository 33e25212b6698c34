"""FFR with an interval: from the case, the literature and a measured flow reserve; bad input."""

import numpy as np
import pytest

from study import read_case
from study.case.faults import CaseError
from study.run.patient import load_patient
from study.run.progress import Progress
from study.run.ratio_uncertainty import response_to_stress, uncertain_ratios

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
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
[uncertainty]
{known}
"""


def _case(tmp_path, known="", reserve=""):
    file = tmp_path / "unsure.toml"
    file.write_text(CASE.format(known=known, reserve=reserve))
    return read_case(file)


def _found(case):
    patient, sd = load_patient(case), case.conditions["rest"].ffr_sd
    (one,) = uncertain_ratios(patient, sd, Progress(), n_samples=2**12)
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
    ("known", "source"),
    [
        ("age_years = 9", "assumed as under adenosine"),
        ("age_years = 40", "Jiang et al. 2022"),
        ("", "adults and children pooled"),
        ("bed_factor = 0.6", "the case"),
    ],
)
def test_evidence_is_that_of_age_and_drug(known, source, tmp_path):
    found = response_to_stress(_case(tmp_path, known), "dobutamine")
    assert source in found.source
    if source == "the case":
        assert float(found.bed_factor.median) == 0.6
    other = response_to_stress(_case(tmp_path, known), "exercise")
    assert float(other.stress_loss.median) < float(found.stress_loss.median)


@pytest.mark.parametrize(
    ("known", "reserve", "said"),
    [
        ("P_venous_low_mmHg = 12\nP_venous_high_mmHg = 5", "", "is not above the least one, 12"),
        ("bed_factor = 7", "", "bed_factor"),
        ("bed_facter = 0.5", "", "bed_factor"),
        ("age_years = -3", "", "age_years"),
        ("", "flow_reserve = 40", "flow_reserve"),
    ],
)
def test_bad_uncertainty_is_refused(known, reserve, said, tmp_path):
    with pytest.raises(CaseError, match=said):
        _case(tmp_path, known, reserve)


def test_flow_reserve_at_rest_is_refused(tmp_path):
    file = tmp_path / "unsure.toml"
    text = CASE.format(known="", reserve="").replace("ffr_sd = 0.01", "flow_reserve = 2.0")
    file.write_text(text)
    with pytest.raises(CaseError, match="a flow reserve is measured under stress"):
        read_case(file)
