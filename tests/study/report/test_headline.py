"""What is said of a predicted FFR follows its numbers."""

import dataclasses
import types
from typing import Any

import numpy as np
import pytest

from study.case.condition import Condition
from study.case.faults import CaseError
from study.case.model import require
from study.case.read import read_case
from study.report.algorithm_results import study_readings, study_verdict
from study.report.diagnosis_words import sentence
from study.report.headline import Reading, chance_at_or_below, headline, headline_numbers, percent
from study.report.remarks import notes, resistance_words, verdict
from study.run.patient import ASSUMED_R0, load_patient
from study.run.pipeline import run_case

CASE = """\
[patient]
id = "a-1"
[condition.rest]
period_s = 0.8
P_systolic_mmHg = 110
P_diastolic_mmHg = 65
ffr = 0.91
[condition.dobutamine]
period_s = 0.45
P_systolic_mmHg = 130
P_diastolic_mmHg = 70
[coronary]
P_venous_mmHg = 5
"""


def own(value, sd, measured=None, words="rule printed"):
    return Reading("dobutamine", words, value, sd, measured, 0.015)


@pytest.mark.parametrize("value", [0.70, 0.80, 0.835])
def test_the_chance_is_the_share_of_draws_at_or_below(value):
    draws = value + 0.024 * np.random.default_rng(3).standard_normal(400_000)
    share = np.mean(draws <= 0.80)
    # four standard errors of the share of so many draws
    assert chance_at_or_below(value, 0.024) == pytest.approx(share, abs=4 * 0.5 / 632)
    assert chance_at_or_below(value, 0.0) == float(value <= 0.80)


def test_a_contradiction_comes_first_and_no_side_is_claimed():
    text = headline([own(0.891, 0.009, 0.80), own(0.87, 0.02, 0.80, "rule all")], what="FFR")
    assert text.startswith("The model is contradicted: measured 0.800 ± 0.015 under dobutamine, ")
    assert "model 0.8910 ± 0.0090 (+5.2 sd; 2 of 2 readings are contradicted)" in text
    assert "lies above" not in text
    low = headline([own(0.70, 0.009, 0.80)], what="FFR")
    assert low.startswith("The model is contradicted")


def test_a_reading_near_the_threshold_makes_no_claim():
    text = headline([own(0.891, 0.009), own(0.835, 0.024, words="rule all")], what="FFR")
    assert "0.835 ± 0.024 (7 %) with rule all" in text
    assert "chance of 0.80 or below: below 0.1 %" in text
    assert "lies above" in text
    assert "is open: the chance of 0.80 or below is below 0.1 % to 7 %, depending on" in text
    assert "By every reading" not in text


@pytest.mark.parametrize(
    ("value", "words"), [(0.89, "lies above 0.80"), (0.70, "at or below 0.80")]
)
def test_a_side_is_stated_where_every_reading_is_sure(value, words):
    assert words in headline([own(value, 0.01, value + 0.01), own(value, 0.02)], what="FFR")


def test_a_measurement_that_agrees_is_told_beside():
    text = headline([own(0.82, 0.015, 0.80)], what="FFR")
    assert "contradicted" not in text
    assert "measured 0.800 ± 0.015" in text


def test_chances_are_no_more_exact_than_they_are():
    found = [percent(p) for p in (1e-9, 0.004, 0.0726, 0.5, 0.995, 1.0)]
    assert found == ["below 0.1 %", "0.4 %", "7 %", "50 %", "99.5 %", "above 99.9 %"]


def test_numbers_of_a_headline_are_those_of_its_readings():
    (entry,) = headline_numbers([own(0.891, 0.009, 0.80)]).readings
    assert entry.z == pytest.approx(0.091 / np.hypot(0.009, 0.015), rel=1e-12)
    assert entry.contradicted


def case_with(folder, lines="", text=CASE):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "case.toml").write_text(text + lines, encoding="utf-8")
    return read_case(folder / "case.toml")


@pytest.fixture(scope="module")
def without_R0(tmp_path_factory):
    return run_case(case_with(tmp_path_factory.mktemp("cases")))


def test_a_case_without_R0_runs_and_says_what_is_assumed(without_R0):
    model = without_R0.patient.model
    assert model.assumed
    assert float(model.surrogate.R0) == ASSUMED_R0
    said = resistance_words(without_R0)
    assert "does not depend on R0" in said
    assert "alpha and flow belong to it" in said
    texts = " ".join(note.text for note in notes(without_R0))
    assert "given in the case" not in texts
    assert "resting flow of" not in texts
    assert "±" in verdict(without_R0)


def test_FFR_does_not_depend_on_R0(without_R0, tmp_path):
    R0 = 4.0e5
    other = run_case(case_with(tmp_path, f"[surrogate]\nR0_dyn_s_per_cm5 = {R0}\n"))
    for mine, theirs in zip(without_R0.runs, other.runs, strict=True):
        if mine.boundary == "calibrated":
            # rounding of two periodic states
            assert theirs.ratio == pytest.approx(mine.ratio, abs=1e-12)
            assert theirs.ratio_sd == pytest.approx(mine.ratio_sd, rel=1e-9)
    alphas = [found.calibrations["linear"].alpha for found in (without_R0, other)]
    assert alphas[1] / alphas[0] == pytest.approx(R0 / ASSUMED_R0, rel=1e-9)
    assert "None is given" not in resistance_words(other)


def test_R0_is_demanded_where_it_matters(tmp_path):
    case = case_with(tmp_path)
    require(case, "run")
    for command in ("calibrate", "sweep"):
        with pytest.raises(CaseError, match="R0"):
            require(case, command)
    quadratic = dataclasses.replace(case.surrogate, law="quadratic", K=1e3)
    with pytest.raises(CaseError, match="R0"):
        require(dataclasses.replace(case, surrogate=quadratic), "run")
    rest = {"rest": case.conditions["rest"]}
    with pytest.raises(CaseError, match="does not depend on R0"):
        require(dataclasses.replace(case, conditions=rest), "run")
    with pytest.raises(CaseError, match="no resistance"):
        load_patient(dataclasses.replace(case, surrogate=quadratic))


def judged(verdict_: str, none: float) -> Any:
    p = {"none": none, "back_pressure": 0.5, "inertance": 0.5 - none}
    judgement = types.SimpleNamespace(
        verdict=verdict_,
        named=("back_pressure", "inertance"),
        probabilities=p,
        closed=False,
        confirmed=True,
        unlike_beats=(),
    )
    return types.SimpleNamespace(judgement=judgement, effects=(), beside={(): 1.0}, known_part=())


@pytest.mark.parametrize("verdict_", ["ambiguous", "unknown"])
def test_a_gap_is_said_only_where_it_is_demonstrated(verdict_):
    shown = sentence(judged(verdict_, 0.01), 0.002)
    assert shown.startswith("There is a gap")
    not_shown = sentence(judged(verdict_, 0.01), 0.165)
    assert "There is a gap" not in not_shown
    assert "p = 0.17" in not_shown
    assert "no gap is demonstrated" in not_shown


def studied(measured: float | None, rest_ratio: float = 0.91) -> Any:
    """A study in 3D under both rules, of which only the ratios are known."""
    conditions = {
        "rest": Condition("rest", "rest", 1.4e5, 8.0e4, 0.8, ffr=0.91, ffr_sd=0.01),
        "dobutamine": Condition(
            "dobutamine", "stress", 1.4e5, 8.0e4, 0.5, ffr=measured, ffr_sd=0.02
        ),
    }
    case = types.SimpleNamespace(
        conditions=conditions, stress=types.SimpleNamespace(rule="printed")
    )
    ratios = {"all": 0.81, "printed": 0.857}
    return types.SimpleNamespace(
        case=case,
        uncertainty=None,
        choice=types.SimpleNamespace(rules=("printed", "all")),
        collapsed={},
        loop=types.SimpleNamespace(ratio=rest_ratio, alpha=0.3, reached=rest_ratio == 0.91),
        calibrated=[
            types.SimpleNamespace(condition="dobutamine", rule=rule, ratio=ratio, is_rest=False)
            for rule, ratio in ratios.items()
        ],
        reduced=types.SimpleNamespace(
            runs=[
                types.SimpleNamespace(
                    condition="dobutamine", rule=rule, boundary="calibrated", law=law,
                    recalibrated={"rest_ratio": slope},
                )
                for rule in ratios
                for law, slope in (("linear", 5.0), ("quadratic", 1.5))
            ]
        ),
    )  # fmt: skip


def test_a_study_states_each_rule_with_its_uncertainty_and_chance():
    own_, other = study_readings(studied(None))
    assert own_.sd == pytest.approx(1.5 * 0.01 / 0.91 * 0.857, rel=1e-12)
    assert other.chance == pytest.approx(chance_at_or_below(0.81, other.sd), rel=1e-12)
    text = study_verdict(studied(None))
    assert text.startswith("FFR in 3D: 0.857 ± 0.014 under dobutamine (chance of 0.80 or below")
    assert "0.810 ± 0.013 (23 %) with rule all" in text
    assert "is open" in text


def test_a_study_that_is_contradicted_says_so_first():
    assert study_verdict(studied(0.78)).startswith("The model is contradicted: measured 0.780")


def test_a_resting_ratio_that_is_missed_adds_to_the_uncertainty():
    own_, _ = study_readings(studied(None, rest_ratio=0.93))
    assert own_.sd == pytest.approx(1.5 * np.hypot(0.01, 0.02) / 0.91 * 0.857, rel=1e-9)
