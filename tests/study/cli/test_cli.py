"""The command line: exit status, what goes where, nothing left behind."""

import csv
import json
import pathlib
import re

import numpy as np
import pytest

import study.cli.commands
from study import demo_case_path
from study.cli.argument_values import alpha_range
from study.cli.arguments import parse
from study.cli.inputs import result_folder
from study.store.layouts import FORMAT
from study.store.stored_document import load_document

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
ffr = 0.86
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
[solver]
n_steps = 64
"""


@pytest.fixture(scope="module")
def case_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("cli") / "small.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def small_run(case_file, command):
    outcome = command("run", case_file)
    assert outcome.status == 0, outcome.stderr
    return outcome


@pytest.fixture(scope="module")
def small_result(case_file, small_run):
    return json.loads((case_file.parent / "small-results/result.json").read_text())


def test_results_lie_beside_the_case_by_default(small_run, case_file):
    folder = case_file.parent / "small-results"
    assert {path.name for path in folder.iterdir()} == {"report.html", "result.json", "run.log"}
    assert "alpha = " in small_run.stdout
    assert str(folder / "report.html") in small_run.stderr


def test_case_with_R0_alone_uses_the_linear_law(small_result):
    assert list(small_result["models"]) == ["linear"]
    assert small_result["vessel"] is None
    # R0 d/((1 − d) R_total), the closed form; relative round-off of Newton's last step
    expected = 5.0e3 * 0.91 / 0.09 / (3.1992e4 + 6.3984e4 + 2.666e5)
    assert small_result["calibrations"]["linear"]["alpha"] == pytest.approx(expected, rel=1e-11)


def test_measured_stress_is_compared_under_both_rules_and_outlets(small_result):
    gaps = [run["gap"] for run in small_result["runs"] if run["condition"] == "exercise"]
    assert len(gaps) == 4
    for run in small_result["runs"]:
        if run["condition"] == "exercise":
            assert run["gap"]["difference"] == pytest.approx(run["ffr"] - 0.86, abs=1e-14)
    page = (pathlib.Path(small_result_folder(small_result)) / "report.html").read_text()
    assert "Predicted less measured" in page


def small_result_folder(result):
    case = pathlib.Path(result["provenance"]["command"][2])
    return case.parent / f"{case.stem}-results"


def test_calibrate_agrees_with_run(case_file, small_result, command, tmp_path):
    outcome = command("calibrate", case_file, "--json", folder=tmp_path / "c")
    assert outcome.status == 0, outcome.stderr
    # the same computation
    assert outcome.json["alpha"] == small_result["calibrations"]["linear"]["alpha"]
    assert outcome.written("calibration.json")["alpha"] == outcome.json["alpha"]

    # alpha of the closed form goes with R0, and with d/(1 − d) of the measured ratio d
    by = outcome.written("calibration.json")["calibrations"]["linear"]["log_alpha_by_log"]
    assert by["R0"] == pytest.approx(1.0, abs=1e-9)
    assert by["rest_ratio"] == pytest.approx(1.0 / (1.0 - 0.91), rel=1e-9)
    assert by["R_1"] == pytest.approx(-3.1992e4 / 3.62576e5, rel=1e-6)


def test_alpha_is_told_with_the_digits_that_mean_something(small_run):
    (line,) = [
        line for line in small_run.stdout.splitlines() if "alpha = " in line and "95" in line
    ]
    assert "alpha = 0.1394 (95 %" in line
    assert not re.search(r"\d\.\d{6}", line)


def test_folder_of_a_run_shows_the_run_and_not_its_mesh(tmp_path):
    for kind, name in (("mesh", "mesh.json"), ("simulate", "simulation.json")):
        (tmp_path / name).write_text(json.dumps({"format": FORMAT, "kind": kind}))
    assert load_document(tmp_path)["kind"] == "simulate"
    (tmp_path / "simulation.json").unlink()
    assert load_document(tmp_path)["kind"] == "mesh"


def test_sweep_agrees_with_calibration_and_stress(case_file, small_result, command, tmp_path):
    alpha = small_result["calibrations"]["linear"]["alpha"]
    span = f"{alpha!r}:{4.0 * alpha!r}:3"
    rest = command("sweep", case_file, "--alpha", span, "--json", folder=tmp_path / "s")
    assert rest.status == 0, rest.stderr
    # the mean of a linear network is a direct solve in both
    assert rest.json["rows"][0]["rest_ratio"] == pytest.approx(0.91, abs=1e-12)
    with (tmp_path / "s/sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["alpha"]) for row in rows] == [row["alpha"] for row in rest.json["rows"]]
    assert (tmp_path / "s/sweep.svg").read_text().startswith("<svg")
    stress = command(
        "sweep", case_file, "--alpha", span, "--condition", "exercise", "--rule", "all", "--json",
        folder=tmp_path / "s2",
    )  # fmt: skip
    run = next(
        r for r in small_result["runs"] if (r["rule"], r["boundary"]) == ("all", "calibrated")
    )
    assert stress.json["rows"][0]["ffr"] == pytest.approx(run["ffr"], abs=1e-12)
    assert stress.json["rows"][0]["mean_flow_ml_per_min"] == pytest.approx(
        run["mean_flow_ml_per_min"], rel=1e-11
    )


def test_sweep_with_a_measured_beat(case_file, command, tmp_path):
    rows = [f"{k * 0.02:.3f},{80 + 25 * np.sin(np.pi * k / 40):.4f}" for k in range(40)]
    (tmp_path / "beat.csv").write_text("\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n")
    text = CASE.replace("ffr = 0.91", 'ffr = 0.91\nwaveform = "beat.csv"')
    (tmp_path / "case.toml").write_text(text)
    outcome = command("sweep", tmp_path / "case.toml", "--alpha", "0.1:0.2:3", "--json")
    assert outcome.status == 0, outcome.stderr
    # mean of the piecewise linear beat: the mean of its uniform samples
    mean = np.mean([float(row.split(",")[1]) for row in rows])
    assert outcome.json["rows"][0]["mean_P_aorta_mmHg"] == pytest.approx(mean, rel=1e-10)


def test_show_prints_what_run_printed(small_run, case_file, command):
    folder = case_file.parent / "small-results"
    for result in (folder, folder / "result.json"):
        shown = command("show", result)
        assert shown.status == 0
        assert shown.stdout == small_run.stdout
        assert shown.stderr == ""


def test_show_json_and_report_again(small_run, case_file, command, tmp_path):
    folder = case_file.parent / "small-results"
    shown = command("show", folder, "--json", folder=tmp_path)
    assert shown.json["patient"] == "small"
    assert (tmp_path / "report.html").read_text() == (folder / "report.html").read_text()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "other"}', "\x00\xff", "{" * 9999])
def test_show_refuses_what_is_no_result(command, tmp_path, text):
    file = tmp_path / "result.json"
    file.write_text(text)
    shown = command("show", file)
    assert shown.status == 2
    assert shown.stdout == ""
    assert "result.json" in shown.stderr


def test_show_refuses_a_damaged_result(command, tmp_path):
    file = tmp_path / "result.json"
    file.write_text('{"format": "jaxfsi 1", "kind": "run", "patient": "x"}')
    shown = command("show", file)
    assert shown.status == 2
    assert "the result is damaged: verdict, or a part below it," in shown.stderr


BAD_CASES = {
    "empty": "",
    "no TOML": "[patient\n",
    "FFR above one": CASE.replace("ffr = 0.91", "ffr = 1.2"),
    "no resting ratio": CASE.replace("ffr = 0.91\n", ""),
    "no rest": CASE.replace("condition.rest", "condition.other"),
    "no resistance": CASE.replace("R0_dyn_s_per_cm5 = 5.0e3", 'law = "quadratic"'),
    "unknown key": CASE.replace("period_s = 0.80", "periode_s = 0.80"),
    "wrong unit": CASE.replace("P_systolic_mmHg = 110.0", "P_systolic_kPa = 14.7"),
    "ratio below the venous pressure": CASE.replace("ffr = 0.91", "ffr = 0.2")
    + "[coronary]\nP_venous_mmHg = 30.0\n",
    "contours that are none": CASE.replace(
        "[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3",
        '[anatomy]\nkind = "ivus"\ncontours = "bad.toml"\n[surrogate]',
    ),
}


@pytest.mark.parametrize("claim", list(BAD_CASES))
@pytest.mark.parametrize("json_flag", [[], ["--json"]])
def test_bad_case_is_refused_and_leaves_nothing(claim, json_flag, command, tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text(BAD_CASES[claim])
    outcome = command("run", file, *json_flag)
    assert outcome.status == 2, outcome.stderr
    assert outcome.stdout == ""
    assert "bad.toml" in outcome.stderr
    assert "try:" in outcome.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def test_sweep_refuses_conditions_and_rules_that_are_not_there(case_file, command, tmp_path):
    for wrong in (
        ["--condition", "sleep"],
        ["--rule", "all"],
        ["--condition", "exercise", "--rule", "none"],
    ):
        outcome = command("sweep", case_file, "--alpha", "0.1:1:3", *wrong, folder=tmp_path / "out")
        assert outcome.status == 2
        assert "try:" in outcome.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["1:2", "2:1:5", "0:1:5", "a:b:c", "0.1:1:1", "0.1:inf:5"])
def test_bad_alpha_range_is_refused(case_file, command, text):
    outcome = command("sweep", case_file, "--alpha", text)
    assert outcome.status == 2
    assert "--alpha" in outcome.stderr


def test_alpha_range_runs_in_equal_ratios():
    # powers of ten to round-off
    np.testing.assert_allclose(
        np.geomspace(*alpha_range("0.01:100:5")), [0.01, 0.1, 1.0, 10.0, 100.0], rtol=1e-14
    )


@pytest.mark.parametrize("arguments", [[], ["run"], ["nonsense"], ["run", "a", "--demo"]])
def test_senseless_arguments_exit_with_2(command, arguments):
    assert command(*arguments).status == 2


@pytest.mark.parametrize("name", ["run", "calibrate", "sweep", "show", "template"])
def test_help_has_examples(command, name):
    outcome = command(name, "--help")
    assert outcome.status == 0
    assert f"jaxfsi {name}" in outcome.stdout
    assert "examples:" in outcome.stdout


def test_output_into_a_file_or_the_package_is_refused(case_file, command):
    for folder in (case_file, pathlib.Path(study.cli.commands.__file__).parents[1] / "data/out"):
        outcome = command("run", case_file, folder=folder)
        assert outcome.status == 2
        assert "--out" in outcome.stderr


def test_results_of_the_bundled_case_never_lie_beside_it(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    request = parse(["run", str(demo_case_path())])
    assert result_folder(request, demo_case_path()) == pathlib.Path("case-results")


def fail_with(error):
    def fail(*_, **__):
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (RuntimeError("No solution was found: cause. Try this."), 1, "Try this"),
        (ZeroDivisionError("odd"), 1, "JAXFSI_TRACEBACK"),
        (KeyboardInterrupt(), 130, "nothing was written"),
        (OSError(28, "No space left on device"), 1, "No space left"),
    ],
)
def test_failures_have_their_exit_status_and_keep_older_results(
    monkeypatch, case_file, small_run, command, error, status, words
):
    folder = case_file.parent / "small-results"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    log = before.pop("run.log")
    where = "write_files" if isinstance(error, OSError) else "run_case"
    monkeypatch.setattr(f"study.cli.pipeline_commands.{where}", fail_with(error))
    outcome = command("run", case_file)
    assert outcome.status == status
    assert words in outcome.stderr
    assert outcome.stdout == ""
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert after.pop("run.log").startswith(log)
    assert after == before


def test_template_is_printed_and_can_be_written_once(command, tmp_path):
    printed = command("template")
    assert printed.status == 0
    assert command("template", "--json").json["template"] == printed.stdout
    assert command("template", folder=tmp_path / "new").status == 0
    written = (tmp_path / "new/case.toml").read_text()
    assert written == f"#:schema ./case.schema.json\n{printed.stdout}"
    assert command("template", folder=tmp_path / "new").status == 2


def test_run_gives_each_ffr_an_interval_where_asked(case_file, command, tmp_path):
    outcome = command("run", case_file, "--uncertainty", folder=tmp_path / "out")
    assert outcome.status == 0, outcome.stderr
    assert "With all uncertainties included: FFR" in outcome.stdout
    (entry,) = outcome.written()["uncertainty"]
    low, high = entry["interval_90"]
    assert low < entry["median"] < high
    assert sum(cause["share"] for cause in entry["causes"]) == pytest.approx(1.0)
    page = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "What would help most under exercise" in page
    assert f"{entry['median']:.2f} [{low:.2f}, {high:.2f}] under exercise" in page


def test_run_gives_none_where_not_asked(small_result):
    assert "uncertainty" not in small_result
