"""--dry-run: the plan, what is kept, where results go; nothing is written."""

import json

import pytest

from study.store.layouts import FORMAT

CASE = """\
[patient]
id = "small"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.91
[condition.exercise]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
"""


@pytest.fixture
def case_file(tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    return tmp_path / "case.toml"


def test_run_is_planned_and_nothing_is_written(case_file, command):
    outcome = command("run", case_file, "--dry-run", "--uncertainty")
    assert outcome.status == 0, outcome.stderr
    said = outcome.stdout
    assert "nothing is computed" in said
    assert f"results go to {case_file.parent / 'case-results'}, which will be created" in said
    for part in ("calibration at rest, linear law", "0D: exercise", "intervals of FFR"):
        assert f"to compute  {part}" in said
    assert [path.name for path in case_file.parent.iterdir()] == ["case.toml"]


def test_result_of_other_input_that_makes_way_is_named(case_file, command, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "result.json").write_text(json.dumps({"format": FORMAT, "kind": "run"}))
    outcome = command("run", case_file, "--dry-run", "--json", folder=folder)
    assert outcome.json["makes_way"] == ["run"]
    assert [path.name for path in folder.iterdir()] == ["result.json"]


@pytest.mark.parametrize("name", ["run", "simulate", "study"])
def test_case_that_is_refused_is_refused_in_the_plan_too(name, case_file, command):
    case_file.write_text(CASE.replace("ffr = 0.91\n", ""))
    outcome = command(name, case_file, "--dry-run")
    assert outcome.status == 2
    assert "try:" in outcome.stderr


def test_study_in_3d_is_planned_with_its_runs(command, tmp_path):
    outcome = command("study", "--demo", "--quick", "--dry-run", "--json", folder=tmp_path / "out")
    assert outcome.status == 0, outcome.stderr
    parts = {part["name"]: part for part in outcome.json["parts"]}
    for name in ("ramp", "3D: rest, curve", "3D: dobutamine, calibrated, rule printed"):
        assert parts[name]["state"] == "to compute"
        assert parts[name]["seconds"] > 1.0
    assert not (tmp_path / "out").exists()
    whole = command("study", "--demo", "--uncertainty", "1", "--dry-run", "--json")
    names = {part["name"] for part in whole.json["parts"]}
    assert {"ramp, second mesh", "uncertainty, dobutamine"} <= names
    assert "3D: dobutamine, drawn numbers 1" in names


def test_simulation_that_was_begun_goes_on(command, tmp_path):
    given = ("simulate", "--demo", "--cycles", "0.1", "--dry-run", "--json")
    fresh = command(*given, folder=tmp_path / "out").json["parts"]
    assert fresh[-1]["state"] == "to compute"
    (tmp_path / "checkpoint.npz").touch()
    assert command(*given, folder=tmp_path).json["parts"][-1]["state"] == "goes on"
    assert command(*given, "--restart", folder=tmp_path).json["parts"][-1]["state"] == "to compute"


def test_cases_of_a_cohort_are_planned(command, tmp_path):
    outcome = command("cohort", "--demo", "--dry-run", "--json", folder=tmp_path / "out")
    assert len(outcome.json["parts"]) == 10
    assert {part["state"] for part in outcome.json["parts"]} == {"to compute"}
    assert not (tmp_path / "out").exists()


def test_diagnosis_is_planned_and_a_missing_study_refused(command, tmp_path, monkeypatch):
    monkeypatch.setattr("study.run.diagnosis.cache_folder", lambda: tmp_path / "cache")
    assert command("template", "--record", folder=tmp_path / "record").status == 0
    outcome = command("diagnose", tmp_path / "record", "--dry-run")
    assert outcome.status == 0, outcome.stderr
    assert "to compute  diagnosis of 2 conditions  about 77 s" in outcome.stdout
    (tmp_path / "cache").mkdir(exist_ok=True)
    (tmp_path / "cache" / "fit-0-program").touch()  # a program was compiled before
    outcome = command("diagnose", tmp_path / "record", "--dry-run")
    assert "to compute  diagnosis of 2 conditions  about 10 s" in outcome.stdout
    without = command("diagnose", tmp_path / "record", "--dry-run", "--in-3d")
    assert without.status == 2
    assert "--case" in without.stderr
