import numpy as np
import pytest

from diagnosis.verdict import (
    BESIDE,
    FORM_ERROR,
    PRIOR,
    form_difference,
    is_closed,
    judge,
    of_unlike_beats,
    predicts_no_worse,
    probabilities_of,
)


def test_probabilities_follow_bayes_rule():
    log_Z = {(): 0.0, ("a",): 3.0, ("b",): 0.0}
    forcing = {(): np.zeros((1, 1, 1)), ("a",): np.full((2, 3), 5.0)}
    p, beside = probabilities_of(log_Z, forcing, 2)
    each, alone = 0.5 * PRIOR["single"], 1.0 - BESIDE
    a, b = each * alone * np.exp(3.0), each * alone
    with_a = each * BESIDE * np.exp(5.0)
    # a little of what acts beside a is a difference of its forms
    its_form = with_a * form_difference(3.0, 5.0)
    a, with_a = a + its_form, with_a - its_form
    weights = {"none": PRIOR["none"], "a": a, "b": b, "unknown": PRIOR["unknown"] + with_a}
    for name, weight in weights.items():
        assert p[name] == pytest.approx(weight / sum(weights.values()), rel=1e-12)
    assert beside[("a",)] == pytest.approx(with_a / sum(weights.values()), rel=1e-12)
    # an effect that acts beside something unknown acts
    judgement = judge(p, ("a", "b"), {(): 50.0, ("a",): 9.0, ("b",): 50.0}, 20, 5, beside)
    assert judgement.inclusion["a"] == pytest.approx(p["a"] + beside[("a",)], rel=1e-12)


def test_a_remainder_as_small_as_a_difference_of_forms_is_no_second_effect():
    forcing = {(): np.zeros(1)}

    def pair(first: float, both: float, settled: tuple[str, ...] = ()) -> dict[str, float]:
        log_Z = {(): 0.0, ("a",): first, ("b",): 1.0, ("b", "a"): both}
        return probabilities_of(log_Z, forcing, 2, settled)[0]

    # as long as ε of the first: e^(-1/2) of the pair's probability is the effect's own
    rest = FORM_ERROR**2 * 800.0
    p = pair(800.0, 800.0 + rest)
    prior = {"a": 0.5 * PRIOR["single"], "b+a": PRIOR["pair"] * np.exp(rest)}
    alone = prior["b+a"] / sum(prior.values())
    assert p["b+a"] == pytest.approx(alone * (1.0 - np.exp(-0.5)), rel=1e-9)
    assert sum(p.values()) == pytest.approx(1.0, rel=1e-12)
    # an effect whose equation is settled has no other form
    assert pair(800.0, 800.0 + rest, settled=("a",))["b+a"] == pytest.approx(alone, rel=1e-9)
    # nor is something unknown beside the two
    log_Z = {(): 0.0, ("a",): 800.0, ("b",): 1.0, ("b", "a"): 800.0}
    forced = {(): np.zeros(1), ("b", "a"): np.full(3, 800.0 + rest)}
    parts = probabilities_of(log_Z, forced, 2)[1]
    whole = probabilities_of(log_Z, forced, 2, ("a",))[1]
    assert parts["b", "a"] == pytest.approx(whole["b", "a"] * (1.0 - np.exp(-0.5)), rel=1e-9)
    # a remainder half as long as the first is a second effect
    assert pair(80.0, 100.0)["b+a"] > 0.99
    # where no effect acts alone, there is nothing to which a remainder could belong
    assert pair(-1.0, 20.0)["b+a"] > 0.99


def test_closure_needs_a_good_fit_or_little_excess():
    assert is_closed(100.0, 500.0, 110, 10)
    assert not is_closed(250.0, 500.0, 110, 10)
    assert is_closed(135.0, 500.0, 110, 10)


@pytest.mark.parametrize(
    ("none", "a", "unknown", "verdict"),
    [
        (0.12, 0.08, 0.80, "no_gap"),
        (0.12, 0.86, 0.02, "no_gap"),
        (0.07, 0.87, 0.01, "ambiguous"),
        (0.07, 0.92, 0.00, "named"),
        (0.07, 0.10, 0.80, "unknown"),
        (0.01, 0.08, 0.90, "unknown"),
        (0.01, 0.95, 0.02, "named"),
        (0.01, 0.70, 0.10, "ambiguous"),
    ],
)
def test_a_gap_must_be_demonstrated_before_it_is_explained(none, a, unknown, verdict):
    p = {"none": none, "a": a, "b": 1.0 - none - a - unknown, "unknown": unknown}
    judgement = judge(p, ("a", "b"), {(): 12.0, ("a",): 9.0, ("b",): 10.0}, 20, 5)
    assert judgement.verdict == verdict


@pytest.mark.parametrize(
    ("none", "a", "verdict", "named"),
    [
        (0.12, 0.78, "unknown", ("a",)),
        (0.01, 0.95, "unknown", ("a",)),
        (0.01, 0.7, "ambiguous", None),
    ],
)
def test_beats_that_are_not_alike_name_nothing_and_leave_no_gap_open(none, a, verdict, named):
    p = {"none": none, "a": a, "b": 1.0 - none - a - 0.02, "unknown": 0.02}
    judgement = judge(p, ("a", "b"), {(): 12.0, ("a",): 9.0, ("b",): 10.0}, 20, 5)
    assert of_unlike_beats(judgement, ()) is judgement
    found = of_unlike_beats(judgement, ("wandering",))
    assert found.verdict == verdict
    assert found.named == (named or judgement.named)
    assert found.unlike_beats == ("wandering",)


@pytest.mark.parametrize(
    ("held_out", "left_out", "no_worse"),
    [
        (None, 0.1, True),
        (None, -0.1, False),
        (-0.9, -3.0, True),
        (-1.1, -3.0, False),
        (-4.9, 2.0, True),
        (-5.1, 200.0, False),
    ],
)
def test_held_out_conditions_count_most(held_out, left_out, no_worse):
    assert predicts_no_worse(held_out, left_out) is no_worse
