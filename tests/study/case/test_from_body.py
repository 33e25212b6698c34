"""What a case takes from the body, and how bodies that cannot be are refused."""

import pytest

from calibration import bed_flow
from lumped import L_PER_MIN, ML_PER_MIN, MMHG, nominal_coronary
from lumped.nominal import NOMINAL
from study import CaseError, read_case

BODY = """\
[body]
weight_kg = 36.0
height_cm = 144.0
age_years = 11.0
sex = "female"
"""
REST = """\
[condition.rest]
ffr = 0.93
"""
MEASURED = """\
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
cardiac_output_l_per_min = 3.9
ffr = 0.93
"""
SYNTHETIC = """\
[anatomy]
kind = "synthetic"
side = "left"
"""


def case_of(tmp_path, *parts):
    file = tmp_path / "case.toml"
    file.write_text('[patient]\nid = "child"\n' + "".join(parts))
    return read_case(file)


def flow(parameters, mean_mmHg):
    values = {name: getattr(parameters, name) for name in NOMINAL}
    return float(bed_flow(nominal_coronary(**values), mean_mmHg * MMHG)) / ML_PER_MIN


def test_rest_is_filled_from_the_body_and_says_so(tmp_path):
    case = case_of(tmp_path, BODY, REST)
    rest = case.conditions["rest"]
    assert rest.P_systolic / MMHG == pytest.approx(104.0, abs=0.1)
    assert rest.P_diastolic / MMHG == pytest.approx(61.5, abs=0.1)
    assert rest.period == pytest.approx(0.7407, abs=1e-3)
    # 42.5 mL/m² and 1.196 m² over the period
    assert rest.cardiac_output / L_PER_MIN == pytest.approx(42.5 * 1.196 / 0.7407 * 0.06, rel=2e-3)
    assumed = case.from_body.assumed
    assert {k.rpartition(".")[2] for k in assumed if k.startswith("condition.rest.")} == {
        "P_systolic", "P_diastolic", "period", "cardiac_output",
    }  # fmt: skip
    assert "Fourth Report" in assumed["condition.rest.P_systolic"].source
    assert (
        assumed["condition.rest.period"].low < rest.period < assumed["condition.rest.period"].high
    )


def test_what_the_case_gives_wins(tmp_path):
    case = case_of(tmp_path, BODY, MEASURED)
    rest = case.conditions["rest"]
    assert (rest.P_systolic / MMHG, rest.period) == (pytest.approx(110.0), 0.8)
    assert rest.cardiac_output / L_PER_MIN == pytest.approx(3.9)
    assert not [key for key in case.from_body.assumed if key.startswith("condition")]
    own = case_of(tmp_path, BODY, MEASURED, "[coronary]\nR_3_dyn_s_per_cm5 = 9e4\n").coronary
    assert (own.R_3, own.R_1) == (9e4, NOMINAL["R_1"])


def test_one_given_pressure_keeps_the_usual_proportion(tmp_path):
    case = case_of(tmp_path, BODY, REST, "P_systolic_mmHg = 88.0\n")
    rest = case.conditions["rest"]
    assert rest.P_diastolic / rest.P_systolic == pytest.approx(61.54 / 103.96, rel=1e-3)
    assert next(iter(case.from_body.assumed)) == "condition.rest.P_diastolic"


def test_beds_carry_the_flow_of_their_territory(tmp_path):
    case = case_of(tmp_path, BODY, MEASURED)
    right, left = flow(case.coronary, 80.0), flow(case.normal_bed, 80.0)
    # 0.9 mL/min/g, 1.28 times 93.3 g at 144 cm; 0.449 of it to the right
    assert right + left == pytest.approx(0.9 * 1.28 * 93.32, rel=1e-3)
    assert right / (right + left) == pytest.approx((5 / 17 + 0.28) / 1.28, rel=1e-6)
    assert case.normal_bed.R_3 * case.normal_bed.C_im == pytest.approx(
        NOMINAL["R_3"] * NOMINAL["C_im"]
    )
    other = case_of(tmp_path, BODY + 'dominance = "left"\nanomalous_artery = "left"\n', MEASURED)
    assert flow(other.coronary, 80.0) > 3.0 * flow(other.normal_bed, 80.0)


def test_without_a_body_nothing_changes(tmp_path):
    case = case_of(tmp_path, MEASURED)
    assert case.normal_bed == case.coronary
    assert case.coronary.R_1 == NOMINAL["R_1"]
    assert not case.from_body.assumed
    assert len(case.beds) == 1


def test_body_sizes_a_drawn_anatomy_and_its_side_names_the_artery(tmp_path):
    case = case_of(tmp_path, BODY, MEASURED, SYNTHETIC)
    assert case.anatomy.body_surface_area_m2 == pytest.approx(1.196, abs=2e-3)
    assert "anomalous (left)" in case.from_body.assumed["coronary.flow"].text
    given = case_of(tmp_path, BODY, MEASURED, SYNTHETIC, "body_surface_area_m2 = 1.9\n")
    assert given.anatomy.body_surface_area_m2 == 1.9
    assert "the body has 1.20 m2" in given.from_body.notices[0]


def test_a_venous_pressure_above_the_aortic_one_is_refused_at_its_key(tmp_path):
    low = MEASURED.replace("110.0", "38.0").replace("65.0", "20.0")
    with pytest.raises(CaseError, match=r"coronary\.P_venous_mmHg = 40.*no blood would flow"):
        case_of(tmp_path, BODY, low, "[coronary]\nP_venous_mmHg = 40\n")


def test_age_alone_fills_the_period(tmp_path):
    with pytest.raises(CaseError, match="P_systolic_mmHg: required"):
        case_of(tmp_path, "[body]\nage_years = 11\n", REST)
    pressures = "P_systolic_mmHg = 100\nP_diastolic_mmHg = 60\n"
    case = case_of(tmp_path, "[body]\nage_years = 11\n", REST, pressures)
    assert list(case.from_body.assumed) == ["condition.rest.period"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("36.0", "300", "body.weight_kg = 300: above the allowed range"),
        ("144.0", "1.44", "1.44 looks like m: 144 cm"),
        ('"female"', '"x"', "body.sex = 'x': not one of the allowed values"),
        ("11.0", "0", "body.age_years = 0: below the allowed range"),
    ],
)
def test_a_body_that_cannot_be_is_refused(old, new, said, tmp_path):
    with pytest.raises(CaseError) as caught:
        case_of(tmp_path, BODY.replace(old, new), REST)
    assert said in " ".join(str(caught.value).split())
    assert len(caught.value.faults) == 1  # what it would have told is not asked for


@pytest.mark.parametrize(("old", "new"), [("36.0", "110.0"), ("144.0", "80.0")])
def test_contradiction_of_size_and_age_is_noticed(old, new, tmp_path):
    case = case_of(tmp_path, BODY.replace(old, new).replace("11.0", "6.0"), MEASURED)
    assert any("an age of 6 years contradict each other" in text for text in case.from_body.notices)


def test_an_artery_that_the_anatomy_contradicts_is_refused(tmp_path):
    with pytest.raises(CaseError, match="drawn with an anomalous left artery"):
        case_of(tmp_path, BODY + 'anomalous_artery = "right"\n', MEASURED, SYNTHETIC)
