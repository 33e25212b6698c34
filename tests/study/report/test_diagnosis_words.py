"""What a diagnosis says to people."""

from study.report.diagnosis_words import doubts


def test_no_gap_beside_something_more_probable_says_so():
    (said,) = doubts({"none": 0.29, "unknown": 0.62, "back_pressure": 0.09})
    assert "something not in the catalogue has probability 0.62, no gap 0.29" in said
    assert "below 0.05" in said
    assert doubts({"none": 0.8, "unknown": 0.1, "back_pressure": 0.1}) == []
