"""What a diagnosis says to people."""

from types import SimpleNamespace

import pytest

from study.report.diagnosis_words import bed_remark, doubts, sentence, to_do


def test_no_gap_beside_something_more_probable_says_so():
    (said,) = doubts({"none": 0.29, "unknown": 0.62, "back_pressure": 0.09})
    assert "something not in the catalogue has probability 0.62, no gap 0.29" in said
    assert "below 0.10" in said
    assert doubts({"none": 0.8, "unknown": 0.1, "back_pressure": 0.1}) == []


def test_beats_that_are_not_alike_are_told_and_what_to_do():
    judgement = SimpleNamespace(unlike_beats=("alternating", "wandering"), verdict="unknown")
    record = SimpleNamespace(n_sensors=0)
    diagnosis = SimpleNamespace(judgement=judgement, effects=(), record=record)
    said = sentence(diagnosis, 0.5)
    assert "not alike: every second beat is weaker; the distal trace wanders" in said
    assert "no cause is named" in said
    assert to_do(diagnosis, [])[0].startswith("Record again, in a steady rhythm")


@pytest.mark.parametrize(
    ("probability", "sensors", "said"), [(0.97, 2, 1), (0.3, 2, 0), (0.97, 0, 0)]
)
def test_a_bed_of_another_structure_is_told(probability, sensors, said):
    record = SimpleNamespace(n_sensors=sensors)
    found = bed_remark(SimpleNamespace(record=record, other_bed=probability))
    assert len(found) == said
    assert all("is not the single layer of the model (probability 0.97)" in step for step in found)
