"""What is said of intervals: which, from what, and what would shrink them."""

import pytest

from study.report.cohort_figures import interval_figure
from study.report.uncertainty_words import (
    causes_words,
    help_words,
    level_words,
    rules_words,
    uncertainty_words,
)


def _cause(name, share, low, high):
    return {"name": name, "share": share, "change": 0.01, "interval_if_known": [low, high]}


ENTRY = {
    "condition": "dobutamine",
    "median": 0.79,
    "interval_90": [0.65, 0.89],
    "chance_at_or_below_threshold": 0.55,
    "causes": [
        _cause("bed_factor", 0.64, 0.71, 0.86),
        _cause("stress_loss", 0.30, 0.66, 0.88),
        _cause("rest_ratio", 0.05, 0.65, 0.89),
        _cause("period", 0.004, 0.65, 0.89),
    ],
    "bed_factor": 0.44,
    "bed_factor_90": [0.25, 0.78],
    "bed_factor_source": "adults and children pooled",
    "rule_bed_factors": {"printed": 0.91, "all": 0.5},
    "n_samples": 16384,
    "levels": [
        {"of": "periodic states", "runs": 128, "error": 0.0018},
        {"of": "runs in 3D", "runs": 5, "error": 0.0071},
    ],
}
DOCUMENT = {"uncertainty": [ENTRY]}


def test_the_interval_comes_with_its_chance_and_causes():
    said = uncertainty_words(DOCUMENT)
    assert "FFR 0.79 [0.65, 0.89] under dobutamine (90 %; chance of 0.80 or below: 55 %)" in said
    causes = causes_words(ENTRY)
    assert "64 %" in causes
    # a cause of less than a twentieth is not told
    assert causes.count("%") == 3


def test_what_to_measure_is_told_where_it_is_worth_it():
    (line,) = help_words(ENTRY)
    assert line.startswith("measure flow under stress over that at rest (flow_reserve")
    assert line.endswith("from [0.65, 0.89] to [0.71, 0.86]")


def test_what_was_measured_is_not_asked_for_again():
    assert help_words(ENTRY | {"flow_reserve": 2.0}) == []


def test_runs_that_collapsed_are_told():
    level = {"of": "runs in 3D", "runs": 3, "error": 0.01, "failed": 1}
    assert "1 more runs in 3D had none" in level_words(ENTRY | {"levels": [level]})


def test_draws_and_what_corrects_them():
    assert level_words(ENTRY) == (
        "16384 draws, corrected by 128 periodic states (error 0.0018), corrected by 5 runs in 3D"
        " (error 0.0071)"
    )
    assert level_words({"n_samples": 1024}) == "1024 draws"


@pytest.mark.parametrize(
    ("source", "said"),
    [("adults and children pooled", "flow reserves in the literature"), ("the case", "the case")],
)
def test_rules_are_set_beside_the_evidence(source, said):
    words = rules_words({"uncertainty": [ENTRY | {"bed_factor_source": source}]})
    assert "dobutamine over that at rest: 0.91 by the rule printed, 0.50 by the rule all; " in words
    assert f"0.44 [0.25, 0.78] by {said}" in words


def test_without_intervals_nothing_is_said():
    assert uncertainty_words({}) == rules_words({}) == ""


def test_a_cohort_draws_intervals_over_measured_ratios():
    entry = {
        "patient": "a", "side": None, "condition": "exercise", "measured": 0.84, "median": 0.86,
        "low": 0.8, "high": 0.9, "chance_at_or_below_threshold": 0.05,
    }  # fmt: skip
    drawn = interval_figure({"intervals": [entry, entry | {"measured": 0.7, "side": "left"}]})
    assert "exercise: 1 of 2 inside" in drawn
    assert interval_figure({"intervals": [entry | {"measured": None}]}) == ""
    assert interval_figure({}) == ""
