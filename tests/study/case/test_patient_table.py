"""Patients from one CSV file: columns are keys, faults name row and column."""

import pathlib
import tomllib

import pytest

from study import CaseError, read_case
from study.case.patient_table import column_key, patients_template, read_patients, toml_text

HEADER, ROW = patients_template().splitlines()


def table(folder: pathlib.Path, *rows: str, header: str = HEADER) -> pathlib.Path:
    file = folder / "patients.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def refused(file: pathlib.Path) -> str:
    with pytest.raises(CaseError) as found:
        read_patients(file, "run")
    return str(found.value)


def test_template_is_a_valid_table(tmp_path):
    (row,) = read_patients(table(tmp_path, ROW), "run")
    assert row.name == "patient-01"
    assert row.case.conditions["dobutamine"].ffr is None


def test_row_and_its_case_file_are_the_same_case(tmp_path):
    header = f"{HEADER},anatomy.kind,anatomy.intramural_length_mm,solver.n_steps,wall.prestress"
    (row,) = read_patients(table(tmp_path, f"{ROW},synthetic,12.3,64,none", header=header), "run")
    file = tmp_path / "case.toml"
    file.write_text(row.text)
    read = read_case(file)
    assert (read.conditions, read.anatomy, read.solver) == (
        row.case.conditions,
        row.case.anatomy,
        row.case.solver,
    )
    assert read.wall.prestress == "none"


def test_every_fault_names_its_row_and_column(tmp_path):
    good = ROW.replace("patient-01", "p1")
    high = ROW.replace("patient-01", "p2").replace("0.91", "1.91")
    word = ROW.replace("patient-01", "p3").replace("5000", "many")
    missing = ROW.replace("patient-01", "p4").replace("0.91", "")
    said = refused(table(tmp_path, good, high, word, missing))
    assert "4 faults" not in said
    assert "3 faults" in said
    assert "patients.csv:3: row 2, column condition.rest.ffr = 1.91" in said
    assert "patients.csv:4: row 3, column surrogate.R0_dyn_s_per_cm5 = 'many'" in said
    assert "patients.csv:5: row 4, column condition.rest.ffr" in said


@pytest.mark.parametrize("turned", [False, True])
def test_a_key_that_is_a_number_and_a_table_is_refused(tmp_path, turned):
    number, part = "wall.thickness_per_radius", "wall.thickness_per_radius.min_mm"
    columns = [(number, "0.1"), (part, "0.3")]
    names, cells = zip(*(columns[::-1] if turned else columns), strict=True)
    header = ",".join((HEADER, *names))
    said = refused(table(tmp_path, ",".join((ROW, *cells)), header=header))
    assert f"row 1, column {number} = '0.1': given beside {part}" in said
    assert "leave one of them empty" in said


def test_unknown_column_is_named_with_the_nearest(tmp_path):
    said = refused(table(tmp_path, ROW, header=HEADER.replace("rest.ffr", "rest.fffr")))
    assert "column condition.rest.fffr: unknown column" in said
    assert "nearest valid column is condition.rest.ffr" in said


@pytest.mark.parametrize(
    ("header", "rows", "words"),
    [
        (HEADER, [ROW, ROW], "row 1 has the same"),
        (HEADER, [], "0 patients"),
        (HEADER.replace("patient.id", "patient.notes"), [ROW], "column patient.id: missing"),
        (f"{HEADER},patient.id", [f"{ROW},x"], "appears twice"),
        (HEADER, [f"{ROW},1,2"], "row 1 has 13 cells, and there are 11 columns"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path, header, rows, words):
    assert words in refused(table(tmp_path, *rows, header=header))


def test_semicolons_and_decimal_commas_are_read(tmp_path):
    header, row = HEADER.replace(",", ";"), ROW.replace(",", ";").replace("0.8", "0,8")
    (found,) = read_patients(table(tmp_path, row, header=header), "run")
    assert found.case.conditions["rest"].period == 0.8


def test_spreadsheet_is_told_from_text(tmp_path):
    file = tmp_path / "patients.csv"
    file.write_bytes(b"PK\x03\x04\xff\xfe")
    assert "saved as CSV" in refused(file)


def test_files_of_a_row_lie_beside_the_table(tmp_path):
    (tmp_path / "beat.csv").write_text(
        "time_s,P_aorta_mmHg\n" + "".join(f"{0.02 * k},{65 + 45 * (k == 8)}\n" for k in range(40))
    )
    file = table(tmp_path, f"{ROW},none.csv", header=f"{HEADER},condition.rest.waveform")
    assert "no such file" in refused(file)


def test_every_key_of_a_condition_is_a_column_under_any_name():
    assert column_key("condition.my-drug.flow_reserve") is not None
    assert column_key("condition.rest.nothing") is None


def test_characters_of_any_plane_come_back_from_the_case_file(tmp_path):
    name = "emoji \U0001f600, DEL \x7f, \N{LATIN SMALL LETTER E WITH ACUTE}"
    text = toml_text({"patient": {"id": "a", "notes": name}})
    assert tomllib.loads(text)["patient"]["notes"] == name
