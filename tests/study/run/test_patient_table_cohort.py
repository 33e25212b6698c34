"""A cohort of a CSV file: a result for each row, and what a faulty row does."""

from study.case.patient_table import patients_template

HEADER, ROW = patients_template().splitlines()
SETTINGS = ("--workers", "2", "--json")


def _table(folder, *rows):
    file = folder / "patients.csv"
    file.write_text("\n".join([f"{HEADER},solver.n_steps", *rows]) + "\n")
    return file


def _row(name, ffr=0.91):
    return f"{ROW.replace('patient-01', name).replace('0.91', str(ffr))},64"


def test_each_row_has_a_result(tmp_path, command):
    file, out = _table(tmp_path, _row("a"), _row("b", 0.95)), tmp_path / "out"
    found = command("cohort", file, *SETTINGS, folder=out)
    assert found.status == 0, found.stderr
    patients = found.json["patients"]
    assert [(p["name"], p["status"]) for p in patients] == [("a", 0), ("b", 0)]
    # a lower drop at rest is a larger resistance behind the same artery
    assert patients[1]["alpha"] > patients[0]["alpha"]
    page = (out / "cohort.html").read_text()
    assert '<a href="b/report.html">b</a>' in page
    assert "without a result" not in page
    assert (out / "b" / "result.json").is_file()
    again = command("cohort", file, *SETTINGS, folder=out)
    assert all(p["kept"] for p in again.json["patients"])


def test_a_faulty_row_is_refused_before_anything_is_written(tmp_path, command):
    file, out = _table(tmp_path, _row("a"), _row("b", 1.2)), tmp_path / "out"
    found = command("cohort", file, *SETTINGS, folder=out)
    assert found.status == 2
    assert "row 2, column condition.rest.ffr" in found.stderr
    assert not out.exists()


def test_template_of_a_table_is_printed(command):
    assert command("template", "--csv").stdout == patients_template()
    assert command("template", "--csv", "--record").status == 2
    assert command("template", "--csv", "--schema").status == 2
