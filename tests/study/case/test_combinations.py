"""Values that are plausible one by one: what they imply together is asked about."""

import math
import pathlib

import pytest

from study import CaseError, read_case
from study.case.record import read_record

REST = """\
[patient]
id = "a"
[condition.rest]
P_systolic_mmHg = {high}
P_diastolic_mmHg = {low}
period_s = {period}
ffr = {ffr}
[surrogate]
R0_dyn_s_per_cm5 = {R0}
"""
ADULT = {"high": 120, "low": 75, "period": 0.9, "ffr": 0.91, "R0": 5e3}
NEWBORN = {"high": 60, "low": 35, "period": 0.4, "ffr": 0.93, "R0": 8e4}
PREMATURE = {"high": 42, "low": 22, "period": 0.36, "ffr": 0.9, "R0": 2e5}

RECORD = """\
[patient]
id = "a"
[condition.rest]
drug = "none"
period_s = 0.8
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
"""


def case_of(folder: pathlib.Path, values: dict[str, float], more: str = ""):
    file = folder / "case.toml"
    file.write_text(REST.format(**values) + more)
    return read_case(file)


@pytest.mark.parametrize("patient", [ADULT, NEWBORN, PREMATURE, {**ADULT, "ffr": 0.995}])
def test_adult_and_newborn_pass(patient, tmp_path):
    assert case_of(tmp_path, patient).surrogate.R0 == patient["R0"]


@pytest.mark.parametrize(
    ("change", "more", "words"),
    [
        ({"R0": 62.5}, "", "is it in mmHg min/l? then write R0_dyn_s_per_cm5 = 5000"),
        ({"R0": 5e6}, "", "mL/min through the coronary"),
        ({}, "[coronary]\nP_venous_mmHg = 40.0\n", ""),
        ({"low": 35.0}, "[coronary]\nP_venous_mmHg = 38.0\n", "no blood would flow"),
        ({}, "[coronary]\nR_3_dyn_s_per_cm5 = 200.0\n", "looks like mmHg"),
        ({}, "[blood]\nviscosity_poise = 0.4\n", "above the allowed range"),
        ({}, "[blood]\nviscosity_poise = 0.004\n", "looks like Pa s: 0.04"),
    ],
)
def test_case_with_a_slip_of_unit_is_asked_about(change, more, words, tmp_path):
    if not words:
        case_of(tmp_path, {**ADULT, **change}, more)
        return
    with pytest.raises(CaseError) as caught:
        case_of(tmp_path, {**ADULT, **change}, more)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "lines",
    [
        "mean_flow_ml_per_min = 80\nffr = 0.9\n",
        "mean_flow_ml_per_min = 2.0\nffr = 0.9\n",
        "mean_P_aorta_mmHg = 80\nmean_P_distal_mmHg = 72\nffr = 0.9\n",
    ],
)
def test_plausible_record_passes(lines, tmp_path):
    (tmp_path / "record.toml").write_text(RECORD + lines)
    record, _ = read_record(tmp_path)
    assert record.conditions[0].ffr == 0.9


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            "mean_flow_ml_per_min = 0.08\nffr = 0.9\n",
            "0.08 mL/min through a coronary (allowed: 0.5 to 3000 mL/min)\n"
            "    try: is this l/min? then write 80",
        ),
        ("mean_flow_ml_per_min = 4800\nffr = 0.9\n", "above the allowed range"),
        ("mean_P_aorta_mmHg = 80\nmean_P_distal_mmHg = 9.6\n", "is this kPa? then write 72"),
        ("mean_P_aorta_mmHg = 50\nmean_P_distal_mmHg = 45\n", "does not go with P_systolic_mmHg"),
        ("mean_P_aorta_mmHg = 80\nmean_P_distal_mmHg = 72\nffr = 0.7\n", "ratio of the two means"),
    ],
)
def test_record_with_a_slip_of_unit_is_asked_about(lines, words, tmp_path):
    (tmp_path / "record.toml").write_text(RECORD + lines)
    with pytest.raises(CaseError) as caught:
        read_record(tmp_path)
    assert words in str(caught.value)


def test_trace_of_flow_in_another_unit_is_asked_about(tmp_path):
    rows = ["time_s,P_aorta_mmHg,Q_coronary_ml_per_min"]
    for k in range(80):
        P = 68.0 + 40.0 * math.exp(-(((k - 24) / 14) ** 2)) - 0.05 * k
        rows.append(f"{k * 0.01:g},{P:g},{0.08 + 0.0001 * (k % 5):g}")
    (tmp_path / "rest.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "record.toml").write_text(RECORD + 'file = "rest.csv"\nffr = 0.9\n')
    with pytest.raises(CaseError) as caught:
        read_record(tmp_path)
    assert "is this l/min? then write 80" in str(caught.value)


def test_a_wave_free_ratio_belongs_to_rest(tmp_path):
    assert case_of(tmp_path, ADULT).conditions["rest"].ifr is None
    more = "[condition.dobutamine]\nP_systolic_mmHg = 130\nP_diastolic_mmHg = 70\nperiod_s = 0.5\n"
    with pytest.raises(CaseError, match="iFR is measured at rest"):
        case_of(tmp_path, ADULT, f"{more}ifr = 0.9\n")
