"""Answers of another method: what the scorer refuses, and that no answer writes its own label."""

import json

import pytest

from benchmarks.foreign.check import NAMES, read_answers
from benchmarks.foreign.score import joined, ranked_first, table
from diagnosis import CATALOGUE

GOOD = {
    "verdict": "named",
    "named": ["inertance"],
    "probabilities": {"none": 0.05, "unknown": 0.05, "inertance": 0.6, "inertance+wire_drift": 0.3},
    "held_out_rms_mmHg": [2.0, 0.5],
}
FAULTS = {
    "misspelt effect": ({"named": ["inertence"]}, "'inertence'"),
    "misspelt in a pair": ({"probabilities": {"inertance+drift": 1.0}}, "'drift'"),
    "blanks in a pair": ({"probabilities": {"inertance + wire_drift": 1.0}}, "'inertance '"),
    "three joined": ({"probabilities": {"inertance+wire_drift+back_pressure": 1.0}}, "joins"),
    "sum of a half": ({"probabilities": {"none": 0.5}}, "sum to 0.5"),
    "above one": ({"probabilities": {"none": 1.5, "unknown": -0.5}}, "probability 1.5"),
    "not a number": ({"probabilities": {"none": float("nan")}}, "probability nan"),
    "a word": ({"probabilities": {"none": "1.0"}}, "probability '1.0'"),
    "no probability": ({"probabilities": {}}, "'probabilities'"),
    "another verdict": ({"verdict": "Named"}, "allowed: no_gap, named, ambiguous, unknown"),
    "nothing named": ({"named": []}, "'named' is empty"),
    "all named": ({"named": list(NAMES)}, "two effects"),
    "a name for a list": ({"named": "inertance"}, "list of effects"),
    "one error": ({"held_out_rms_mmHg": [1.0]}, "two errors"),
    "an error below zero": ({"held_out_rms_mmHg": [1.0, -1.0]}, "two errors"),
    "no verdict": ({"verdict": None}, "verdict None"),
    "one pair in two orders": (
        {"probabilities": {"inertance+wire_drift": 0.5, "wire_drift+inertance": 0.5}},
        "'inertance+wire_drift' and 'wire_drift+inertance' are one hypothesis",
    ),
}


def _written(folder, content):
    labels = {
        "0000": {"truth": "inertance", "lambda": 9.0, "form": "first"},
        "0001": {"truth": "outside:bridge", "lambda": 9.0, "form": "first"},
    }
    (folder / "labels.json").write_text(json.dumps({"records": labels}))
    file = folder / "answers-own.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return file


def test_effects_that_may_be_named_are_those_of_the_catalogue():
    assert set(NAMES) == {effect.id for effect in CATALOGUE}


def test_a_good_answer_is_read_as_it_is(tmp_path):
    file = _written(tmp_path, {"0000": GOOD})
    assert read_answers(file, ["0000", "0001"]) == {"0000": GOOD}
    assert "| answered | 1 of 2 |" in table([tmp_path], "own")


def test_names_may_be_left_out_where_nothing_is_named(tmp_path):
    entry = {key: value for key, value in GOOD.items() if key != "named"}
    file = _written(tmp_path, {"0000": {**entry, "verdict": "ambiguous"}})
    assert read_answers(file, ["0000"])["0000"]["named"] == []
    file = _written(tmp_path, {"0000": entry})
    with pytest.raises(ValueError, match="'named' is missing"):
        read_answers(file, ["0000"])


@pytest.mark.parametrize(
    ("probabilities", "first"),
    [
        ({"inertance": 0.5, "wire_drift": 0.4, "none": 0.1}, "inertance"),
        ({"wire_drift": 0.5, "inertance": 0.5}, ""),
        ({"none": 1.0, "inertance": 0.0}, ""),
    ],
)
def test_a_tie_and_probability_zero_rank_nothing_first(probabilities, first):
    assert ranked_first({"probabilities": probabilities}) == first


def test_a_set_or_answers_that_are_missing_are_asked_for(tmp_path):
    with pytest.raises(ValueError, match=r"no set.*benchmarks\.foreign make"):
        joined(tmp_path, "own")
    _written(tmp_path, {"0000": GOOD})
    with pytest.raises(ValueError, match=r"no answers-bic\.json.*benchmarks\.foreign answer"):
        joined(tmp_path, "bic")


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_answer_is_refused_with_file_and_record(name, tmp_path):
    change, words = FAULTS[name]
    file = _written(tmp_path, {"0000": {**GOOD, **change}})
    with pytest.raises(ValueError, match=r"^answers-own\.json, record 0000: ") as error:
        read_answers(file, ["0000"])
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "not JSON"),
        ('{"0000": {', "not JSON"),
        ("[]", "one JSON object"),
        ({}, "one JSON object"),
        ({"7": GOOD}, "which the set does not have"),
        ({"0000": [GOOD]}, "has to be an object"),
        ('{"0000": {}, "0000": {}}', "'0000' occurs twice"),
    ],
)
def test_a_faulty_file_is_refused_by_name(content, words, tmp_path):
    file = _written(tmp_path, content)
    with pytest.raises(ValueError, match=r"answers-own\.json") as error:
        read_answers(file, ["0000"])
    assert words in str(error.value)


def test_no_answer_writes_its_own_label(tmp_path):
    forged = {**GOOD, "named": ["wire_drift"], "truth": "wire_drift", "lambda": 99.0}
    forged["probabilities"] = {"wire_drift": 1.0}
    _written(tmp_path, {"0000": forged})
    (row,) = joined(tmp_path, "own")
    assert (row["truth"], row["lambda"]) == ("inertance", 9.0)
    assert ranked_first(row) == "wire_drift"


def test_sets_in_folders_of_one_name_are_two_columns(tmp_path):
    folders = [tmp_path / "a" / "set", tmp_path / "b" / "set"]
    for folder in folders:
        folder.mkdir(parents=True)
        _written(folder, {"0000": GOOD})
    assert "| answered | 1 of 2 | 1 of 2 | 2 of 4 |" in table(folders, "own")
