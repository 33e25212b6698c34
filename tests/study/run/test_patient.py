"""From a case to surrogates, conditions and rules."""

import math
import pathlib

import pytest

from lumped import MMHG, Sampled
from study import CaseError, demo_case_path, load_patient, read_case

REST = """\
[patient]
id = "small"
[condition.exercise]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.91
"""
CONTOURS = '[anatomy]\nkind = "ivus"\ncontours = "contours.csv"\n'


@pytest.fixture
def load(tmp_path):
    def load(text: str):
        source = demo_case_path().parent / "rest_diastole_contours.csv"
        (tmp_path / "contours.csv").write_bytes(source.read_bytes())
        (tmp_path / "case.toml").write_text(REST + text)
        return load_patient(read_case(tmp_path / "case.toml"))

    return load


def test_rest_comes_first_whatever_the_order_of_the_file(load):
    patient = load("[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n")
    assert list(patient.conditions) == ["rest", "exercise"]
    assert patient.stresses == ["exercise"]


def test_given_resistance_wins_and_leaves_the_curve_to_the_contours(load):
    given = load(CONTOURS + "[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n")
    drawn = load(CONTOURS)
    assert float(given.models["linear"].surrogate.R0) == 5.0e3
    assert "given" in given.models["linear"].origin
    for name in ("R0", "K"):
        values = (getattr(p.models["quadratic"].surrogate, name) for p in (given, drawn))
        first, second = map(float, values)
        assert first == second > 0.0


def test_given_coefficients_make_both_laws(load):
    text = "[surrogate]\nR0_dyn_s_per_cm5 = 1.0e3\nK_dyn_s2_per_cm8 = 500.0\n"
    patient = load(text + 'law = "quadratic"\n')
    assert list(patient.models) == ["quadratic", "linear"]
    slope = math.sqrt(1.0e3**2 + 4.0 * 500.0 * 40.0 * MMHG)
    assert float(patient.models["linear"].surrogate.R0) == pytest.approx(slope, rel=1e-14)
    linear = load(text + 'law = "linear"\n')
    assert list(linear.models) == ["linear", "quadratic"]
    assert float(linear.models["linear"].surrogate.R0) == 1.0e3


def test_resistance_without_contours_gives_the_linear_law_only(load):
    assert list(load("[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n").models) == ["linear"]


def test_no_resistance_at_all_is_refused(load):
    with pytest.raises(CaseError, match="no resistance is known"):
        load('[surrogate]\nlaw = "quadratic"\n')


def test_own_factors_come_before_both_readings_of_the_rule(load):
    patient = load("[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n[stress.factors]\nR_2 = 0.3\n")
    assert list(patient.rules) == ["factors", "printed", "all"]
    assert float(patient.rules["factors"].R_2) == 0.3
    assert float(patient.rules["factors"].R_1) == 1.0
    assert list(load('[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n[stress]\nrule = "all"\n').rules) == [
        "all", "printed",
    ]  # fmt: skip


def test_wide_aorta_only_changes_the_entrance(load):
    open_, narrow = load(CONTOURS), load(CONTOURS + "aorta_radius_mm = 12.0\n")
    assert float(open_.vessel.losses.a_viscous) == float(narrow.vessel.losses.a_viscous)
    assert float(narrow.vessel.losses.b_contraction) < float(open_.vessel.losses.b_contraction)


def test_measured_aorta_is_as_wide_as_its_line_at_the_ostium(load, tmp_path):
    lines = {"centerline": "centerline.csv", "aorta_centerline": "aorta_centerline.csv"}
    for name in lines.values():
        source = demo_case_path().parent / name
        (tmp_path / name).write_bytes(source.read_bytes())
    keys = "".join(f'{key} = "{name}"\n' for key, name in lines.items())
    own, given = load(CONTOURS + keys), load(CONTOURS + "aorta_radius_mm = 14.19\n")
    one, other = (float(p.vessel.losses.b_contraction) for p in (own, given))
    assert one == pytest.approx(other, rel=1e-5)  # 14.19 mm to 0.05 mm, of a share of 1 %
    (tmp_path / "aorta_centerline.csv").write_text("0,0,0\n" * 8)
    with pytest.raises(CaseError, match=r"aorta_centerline.csv.*\n?.*"):
        load(CONTOURS + keys)


def test_measured_beat_drives_its_condition(load, tmp_path):
    rows = [f"{k * 0.02:.3f},{85 + 20 * math.sin(k / 40 * math.pi):.3f}" for k in range(40)]
    (tmp_path / "beat.csv").write_text("\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n")
    text = 'waveform = "beat.csv"\n[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n'
    patient = load(text)
    beat = patient.conditions["rest"].waveform
    assert isinstance(beat, Sampled)
    source = patient.model.surrogate.network(patient.conditions["rest"])["inlet"]
    assert float(source.waveform(0.2)) == pytest.approx(float(rows[10].split(",")[1]) * MMHG)
    assert patient.conditions["exercise"].waveform is None


def test_unreadable_contours_are_a_fault_of_that_file(load, tmp_path):
    with pytest.raises(CaseError) as caught:
        load(CONTOURS.replace("contours.csv", "case.toml"))
    assert caught.value.faults[0].file == pathlib.Path(tmp_path / "case.toml")
