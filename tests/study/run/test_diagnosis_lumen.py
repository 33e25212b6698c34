"""The lumen of a finished study in a diagnosis: opened again, changed, told and drawn."""

import json
import types

import numpy as np
import pytest

from diagnosis.reach import Reach
from study import read_case
from study.report.diagnosis_lumen import lumen_part, with_lumen
from study.report.diagnosis_report import diagnosis_report
from study.report.documents import typed
from study.report.documents.least_change import LumenPart
from study.report.summary import summary
from study.run import diagnosis_lumen
from study.run.diagnosis import study_of
from study.run.diagnosis_lumen import NO_STUDY, found_reach, lumen_reach, study_lumen
from study.store.case_inputs import input_files
from study.store.json_form import as_json, from_json
from study.store.layouts import FORMAT
from study.store.options import StudyOptions
from study.store.provenance import origin
from tests.study.report.documents.test_documents import EXAMPLES
from tests.study.run.test_what_if import CASE


def finished(path):
    """What a diagnosis reads of a finished study of a case, in a folder beside it."""
    folder = path.parent / f"{path.stem}-results"
    folder.mkdir(exist_ok=True)
    options = StudyOptions(case=path)
    command = ["jaxfsi", "study", str(path)]
    made = origin(input_files(read_case(path)), path.parent, command, options)
    document = {"kind": "study", "format": FORMAT, "provenance": as_json(made)}
    (folder / "study.json").write_text(json.dumps(document))
    return folder


@pytest.fixture
def drawn(tmp_path):
    path = tmp_path / "drawn.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    path = tmp_path_factory.mktemp("known") / "drawn.toml"
    path.write_text(CASE)
    return study_lumen(finished(path))


def told(known, monkeypatch, *, best=("proximal_resistance",), **change):
    """The part of a diagnosis that found a loss."""
    usual = Reach(False, 0.3, 3.2, ("proximal_resistance",), True, 0.4, 0.35, 0.06, 1.2)
    monkeypatch.setattr(diagnosis_lumen, "reach", lambda _: usual._replace(**change))
    judged = types.SimpleNamespace(best=best, probabilities={"+".join(best): 0.9})
    return lumen_part(lumen_reach(types.SimpleNamespace(judgement=judged), known))


def test_the_lumen_of_a_study_is_opened_again(drawn):
    folder = finished(drawn)
    assert study_of(folder) == study_of(drawn) == folder
    found = study_lumen(folder)
    assert np.all(np.diff(found.lumen.s) > 0.0)
    assert (found.scan, found.sd, found.course) == ("CT", 0.02, 1.0)
    assert found.study == "drawn-results"
    drawn.write_text(CASE + "[uncertainty]\nlumen_sd_mm = 0.3\n")
    assert "changed since the study" in study_lumen(folder)
    stated = study_lumen(finished(drawn))
    assert (stated.scan, stated.sd) == ("the case", pytest.approx(0.03))


def test_without_sections_it_is_said_why(drawn, tube, tmp_path):
    assert study_lumen(None) == NO_STUDY
    assert study_of(drawn) is None
    mesh = finished(tube.write_case(tmp_path / "tube"))
    assert "of kind mesh, has no sections" in study_lumen(mesh)


def test_the_change_is_told_and_drawn(known, monkeypatch):
    part = told(known, monkeypatch)
    change = part.change
    assert part.wanted.factor == pytest.approx(np.exp(0.35))
    assert change.from_mm <= change.largest_s_mm <= change.to_mm
    assert change.course_mean_mm < 0.0
    assert (
        min(change.R0_factor, change.K_factor)
        <= np.exp(0.35)
        <= max(change.R0_factor, change.K_factor)
    )
    low, middle, high = (np.array(getattr(change, n)) for n in ("low_mm", "delta_r_mm", "high_mm"))
    assert np.all((low <= middle + 1e-9) & (middle <= high + 1e-9))
    assert np.max(np.abs(middle)) <= change.n_sd * change.scan_sd_mm + 1e-9
    assert "narrowing" in part.sentence
    assert "the image cannot exclude it" in part.sentence
    stored = json.loads(json.dumps(as_json(part)))
    assert from_json(LumenPart, stored) == part
    example = json.loads((EXAMPLES / "diagnose.json").read_text(encoding="utf-8"))
    document = {**example, "lumen": stored}
    page = diagnosis_report(document)
    assert part.sentence in page
    assert "Mean over the intramural course of 10.0 mm" in page
    assert f"lumen: {part.sentence}" in summary(document)
    assert as_json(typed(document)) == document
    plain = with_lumen(typed(example), found_reach(None, NO_STUDY))
    assert f"Not examined. {NO_STUDY}" in diagnosis_report(as_json(plain))
    assert "Would a different lumen" not in diagnosis_report(example)


def test_other_outcomes_are_told(known, monkeypatch):
    reached = told(known, monkeypatch, boundary=True, pull=0.4)
    assert reached.change is None
    assert "no other lumen is needed" in reached.sentence
    not_free = told(known, monkeypatch, free=False, p_value=1e-9, p_value_free=1e-8, pull=0.1)
    assert not_free.change is None
    assert "more than noise (p < 0.0001)" in not_free.sentence
    assert "Nor does another lumen" in not_free.sentence
    wide = told(known, monkeypatch, log_factor=-1.0, best=("inertance",))
    assert "widening" in wide.sentence
    assert "another cause more probable: inertance, probability 0.90" in wide.sentence
    far = told(known._replace(sd=0.003), monkeypatch, log_factor=1.0)
    assert "excludes it, so look for another cause" in far.sentence
