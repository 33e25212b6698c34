"""The commands that read a measured record: what they write, what they refuse."""

import json

import pytest

from study.case.record import record_files
from study.report.diagnosis_report import diagnosis_report
from tests.diagnosis.records import synthetic

HEADINGS = (
    "Which cause", "How far the gap shrinks", "Where the data disagree", "Where in the model",
    "What to measure next", "Where this comes from",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("records") / "drifting"
    place.mkdir()
    for name, text in record_files(synthetic({"inertance": 0.1}, seed=4)).items():
        (place / name).write_text(text, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def outcome(folder, command):
    return command("diagnose", folder)


@pytest.fixture(scope="module")
def document(folder, outcome):
    assert outcome.status == 0, outcome.stderr
    return json.loads((folder.parent / "drifting-results/diagnosis.json").read_text())


@pytest.mark.slow
def test_a_cause_is_named_at_its_place(document):
    assert document["verdict"] == "named"
    assert document["named"] == ["inertance"]
    assert sum(document["probabilities"].values()) == pytest.approx(1.0, abs=1e-9)
    places = document["place_in_model"]
    # a free flow into the wall leaves the same trace; the probabilities know better
    assert max(places, key=lambda name: places[name]) == "ostium"


@pytest.mark.slow
def test_held_out_gap_and_provenance_are_in_the_document(document):
    (held,) = document["gap"]["held_out"]
    assert held["condition"] == "dobutamine_high"
    assert held["P_distal_rms_mmHg"]["after"] < held["P_distal_rms_mmHg"]["before"]
    assert {entry["file"] for entry in document["provenance"]["inputs"]} >= {"record.toml"}


@pytest.mark.slow
def test_the_page_shows_every_part(document, folder):
    page = (folder.parent / "drifting-results/diagnosis.html").read_text(encoding="utf-8")
    for heading in HEADINGS:
        assert heading in page
    assert "Add to the model: inertance" in page
    assert "Checked on dobutamine high" in page
    floor = document["smallest_global_p"]
    assert document["where"][0]["global_p"] >= floor
    if document["where"][0]["global_p"] == pytest.approx(floor):
        assert f"below {floor:.4f}" in page


@pytest.mark.slow
def test_the_page_is_drawn_again_from_the_document(document):
    assert diagnosis_report(document) == diagnosis_report(json.loads(json.dumps(document)))


@pytest.mark.slow
def test_summary_says_the_sentence(outcome, document):
    assert document["sentence"] in outcome.stdout


def test_a_plan_needs_no_measurement(folder, command, tmp_path):
    text = (folder / "record.toml").read_text(encoding="utf-8")
    place = tmp_path / "planned"
    place.mkdir()
    dropped = ("waveform", "ffr", "mean_")
    kept = [line for line in text.split("\n") if not line.startswith(dropped)]
    (place / "record.toml").write_text("\n".join(kept), encoding="utf-8")
    outcome = command("plan-measurement", place, "--json")
    assert outcome.status == 0, outcome.stderr
    sensors = json.loads(outcome.stdout)["sensors"]
    assert len(sensors["waveforms+flow"]["isolable"]) > len(sensors["means"]["isolable"])


def test_a_record_at_fault_is_refused_and_nothing_is_written(folder, command, tmp_path):
    place = tmp_path / "bad"
    place.mkdir()
    for path in folder.iterdir():
        text = path.read_text(encoding="utf-8").replace("P_aorta_mmHg\n", "P_aorta_kPa\n")
        (place / path.name).write_text(text.replace("period_s", "period_ms"), encoding="utf-8")
    outcome = command("diagnose", place)
    assert outcome.status == 2
    assert "period_s" in outcome.stderr
    assert not (tmp_path / "bad-results").exists()
