"""Ratios beside their limits: sides, grey zone, intervals, and measured against predicted."""

import pytest

from study.report.ratio_limits import limit_rows, measured_words, side

READING = {
    "condition": "dobutamine", "ffr": 0.82, "ffr_sd": 0.02, "measured": 0.77, "measured_sd": 0.01,
}  # fmt: skip
RUN = {
    "kind": "run",
    "law": "linear",
    "conditions": {"rest": {"measured_rest_ratio": 0.91, "measured_ifr": 0.9}},
    "runs": [
        {"condition": "rest", "law": "linear", "boundary": "fixed", "rest_ratio": 0.8, "ifr": 0.7},
        {
            "condition": "rest", "law": "linear", "boundary": "calibrated", "rest_ratio": 0.91,
            "ifr": 0.88,
        },
    ],
    "headline": {"readings": [READING, {**READING, "ffr": 0.5}]},
}  # fmt: skip


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.81, "above"), (0.80, "grey zone"), (0.75, "grey zone"), (0.74, "below the grey zone")],
)
def test_grey_zone_has_both_its_ends(value, words):
    assert side(value, 0.80, 0.75) == words


def test_each_ratio_has_its_own_limit():
    rows = {row.name: row for row in limit_rows(RUN)}
    assert list(rows) == ["resting Pd/Pa", "iFR at rest", "FFR, dobutamine"]
    assert rows["resting Pd/Pa"].sides == ("at or below", "at or below")
    # the measured iFR lies above 0.89 and that of the calibrated model below
    assert rows["iFR at rest"].sides == ("above", "at or below")
    assert rows["FFR, dobutamine"].sides == ("grey zone", "above")
    # 0.82 ± 1.64 · 0.02 holds 0.80
    assert rows["FFR, dobutamine"].crossed is True


def test_study_has_the_same_rows():
    row = {"condition": "rest", "measured": 0.95, "fsi": 0.951, "ifr": 0.93, "measured_ifr": 0.94}
    study = {"kind": "study", "rows": [row], "headline": RUN["headline"]}
    rows = limit_rows(study)
    assert [r.predicted for r in rows] == [0.951, 0.93, 0.82]
    assert rows[1].measured == 0.94


def test_measured_stress_ratio_stands_against_the_prediction():
    (said,) = measured_words(RUN)
    assert "predicted 0.820, a difference of +0.050" in said
    # 0.77 lies below 0.82 − 1.64 · 0.02 = 0.787
    assert "outside the 90 % interval 0.787 to 0.853" in said


def test_interval_of_all_that_is_uncertain_is_preferred():
    entry = {"condition": "dobutamine", "median": 0.80, "interval_90": [0.70, 0.88]}
    (said,) = measured_words({**RUN, "uncertainty": [entry]})
    assert "predicted 0.800" in said
    assert "inside the 90 % interval 0.700 to 0.880 (with all uncertainties included)" in said


def test_nothing_is_said_where_nothing_was_measured():
    readings = [{**READING, "measured": None}]
    assert measured_words({**RUN, "headline": {"readings": readings}}) == []
