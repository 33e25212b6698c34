"""The command `check`: faults with their lines, and what can be run."""

import pytest

from study import demo_case_path
from study.case.template import case_template

CASE = """\
[patient]
id = "small"

[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.91
"""
RECORD = """\
[patient]
id = "small"
[condition.rest]
drug = "none"
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
"""
STRESS = '[condition.stress]\ndrug = "dobutamine"\nP_systolic_mmHg = 120.0\n' + (
    "P_diastolic_mmHg = 70.0\nperiod_s = 0.5\n"
)


@pytest.fixture
def case_file(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(case_template())
    return file


def test_each_fault_is_a_line_with_file_and_line(tmp_path, command):
    file = tmp_path / "bad.toml"
    file.write_text(CASE.replace("ffr = 0.91", "ffr = 9.1").replace("period_s", "periode_s"))
    outcome = command("check", file)
    assert outcome.status == 2
    first, second = outcome.stdout.splitlines()
    assert first.startswith(f"{file}:7: condition.rest.periode_s = 0.8: unknown key")
    assert second.startswith(f"{file}:8: condition.rest.ffr = 9.1: above the allowed range")
    assert outcome.stderr == ""
    quiet = command("check", file, "--quiet")
    assert quiet.stdout == outcome.stdout


def test_what_can_be_run_is_said_and_what_others_lack(case_file, command):
    outcome = command("check", case_file)
    assert outcome.status == 0, outcome.stdout
    assert f"{case_file}: a case without faults" in outcome.stdout
    assert "can be run:   run, calibrate, sweep\n" in outcome.stdout
    assert "cannot study: anatomy: there is nothing to mesh" in outcome.stdout
    assert command("check", case_file, "--quiet").stdout == ""


def test_case_that_no_command_can_use_has_a_fault(tmp_path, command):
    file = tmp_path / "case.toml"
    file.write_text('[patient]\nid = "p"\n')
    outcome = command("check", file)
    assert outcome.status == 2
    assert "condition.rest: the condition at rest is missing" in outcome.stdout


def test_finished_mesh_is_held_against_simulate_and_study(tmp_path, command, tube):
    file = tube.write_case(tmp_path)
    assert {"simulate", "study"} <= set(command("check", file, "--json").json["checked"][0]["runs"])
    text = file.read_text()
    file.write_text(text[: text.index("[condition.rest]")])
    outcome = command("check", file)
    assert "can be run:   mesh\n" in outcome.stdout
    assert "cannot simulate: condition: there is no condition 'rest' to run" in outcome.stdout
    assert "add [condition.rest]" in command("simulate", file, "--dry-run").stderr


def test_files_of_the_bundled_patient_are_read_and_its_openings_named(command):
    outcome = command("check", demo_case_path(), "--json")
    assert outcome.status == 0, outcome.stdout
    (found,) = outcome.json["checked"]
    assert found["faults"] == []
    assert "aorta_inlet" in found["describes"]["openings"]
    assert "study" in found["runs"]


def test_faults_of_all_files_are_told_and_of_the_files_that_they_name(tmp_path, command):
    (tmp_path / "contours.csv").write_text("no contours\n")
    named = CASE + '[anatomy]\nkind = "ivus"\ncontours = "contours.csv"\n'
    (tmp_path / "named.toml").write_text(named)
    (tmp_path / "empty.toml").write_text("")
    files = (tmp_path / "named.toml", tmp_path / "empty.toml", tmp_path / "absent.toml")
    outcome = command("check", *files, "--json")
    assert outcome.status == 2
    faulty = [[fault["file"] for fault in entry["faults"]] for entry in outcome.json["checked"]]
    expected = [tmp_path / "contours.csv", *files[1:]]
    assert faulty == [[str(file)] for file in expected]


@pytest.mark.parametrize("place", ["record", "record/record.toml"])
def test_record_is_told_by_its_folder_and_by_its_file(tmp_path, command, place):
    (tmp_path / "record").mkdir()
    file = tmp_path / "record/record.toml"
    file.write_text(RECORD + "ffr = 0.9\n" + STRESS)
    outcome = command("check", tmp_path / place)
    assert outcome.status == 0, outcome.stdout
    assert f"{file}: a record without faults" in outcome.stdout
    assert "can be run:   diagnose, plan-measurement" in outcome.stdout
    file.write_text(RECORD + STRESS)
    assert "can be run:   plan-measurement" in command("check", tmp_path / place).stdout
    file.write_text(RECORD + "ffr = 3.0\n")
    assert f"{file}:8: condition.rest.ffr = 3" in command("check", tmp_path / place).stdout
