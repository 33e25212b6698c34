"""Files appear whole or not at all; provenance; progress; the compilation cache."""

import io
import json
import os
import pathlib
import re

import pytest

from study import Progress, demo_case_path, read_case
from study.store.cache_folder import VARIABLE, cache_folder
from study.store.case_inputs import input_files, inputs_of, provenance
from study.store.json_form import as_json, from_json
from study.store.options import RunOptions
from study.store.output import OutputRefused, check_folder, write_files
from study.store.provenance import Provenance
from study.store.stored_document import to_json


def content(folder: pathlib.Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_files_are_written_and_nothing_else_stays(tmp_path):
    written = write_files(tmp_path / "a/b", {"x.txt": "1", "y.txt": "2"})
    assert [path.name for path in written] == ["x.txt", "y.txt"]
    assert content(tmp_path / "a/b") == {"x.txt": "1", "y.txt": "2"}


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_failure_in_the_middle_leaves_the_older_result(tmp_path, monkeypatch, step, error):
    write_files(tmp_path, {"x.txt": "old", "y.txt": "old"})
    calls = []

    def fail(*arguments):
        calls.append(arguments)
        if len(calls) == (2 if step == "fsync" else 1):
            raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(type(error)):
        write_files(tmp_path, {"x.txt": "new", "y.txt": "new"})
    assert content(tmp_path) == {"x.txt": "old", "y.txt": "old"}


def test_failure_removes_folders_made_for_it(tmp_path, monkeypatch):
    def fail(*arguments):
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        write_files(tmp_path / "a/b", {"x.txt": "new"})
    assert list(tmp_path.iterdir()) == []


def test_files_get_the_usual_permissions(tmp_path):
    (path,) = write_files(tmp_path, {"x.txt": "1"})
    other = tmp_path / "other"
    other.write_text("1")
    assert path.stat().st_mode == other.stat().st_mode


def test_folder_that_is_a_file_is_refused(tmp_path):
    file = tmp_path / "taken"
    file.write_text("")
    for folder in (file, file / "below"):
        with pytest.raises(OutputRefused, match="--out"):
            check_folder(folder)


def test_numbers_that_json_lacks_are_refused():
    with pytest.raises(ValueError, match="JSON"):
        to_json({"ffr": float("nan")})


def copy_of_demo(folder: pathlib.Path) -> pathlib.Path:
    for file in demo_case_path().parent.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    return folder / "case.toml"


def test_hash_of_the_contours_changes_with_them(tmp_path):
    path = copy_of_demo(tmp_path)
    before = {e.file: e.sha256 for e in inputs_of(read_case(path))}
    contours = tmp_path / "rest_diastole_contours.csv"
    text = contours.read_text()
    contours.write_text(text.replace(text[:12], text[:12], 1) + "\n")
    after = {e.file: e.sha256 for e in inputs_of(read_case(path))}
    assert before.keys() == after.keys()
    assert {name for name in before if before[name] != after[name]} == {contours.name}


def test_measured_beats_are_inputs(tmp_path):
    path = copy_of_demo(tmp_path)
    rows = [f"{k * 0.043:.4f},{95 + 20 * (k % 7) / 7:.2f}" for k in range(20)]
    (tmp_path / "beat.csv").write_text("\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n")
    text = path.read_text().replace("ffr = 0.91 ", 'waveform = "beat.csv"\nffr = 0.91 ')
    path.write_text(text)
    assert tmp_path / "beat.csv" in input_files(read_case(path))


def test_provenance_is_json():
    options = RunOptions(demo=True)
    made = provenance(read_case(demo_case_path()), ["jaxfsi", "run"], options)
    stored = json.loads(to_json(as_json(made)))
    assert from_json(Provenance, stored) == made
    assert RunOptions.read(stored["options"]) == options
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", made.date)


def test_short_work_shows_no_progress():
    stream = io.StringIO()
    with Progress(stream=stream) as progress:
        progress.plan({"a": 1.0})
        progress.step("a")
    assert stream.getvalue() == ""


def test_long_work_shows_the_step_and_the_time_left():
    stream = io.StringIO()
    with Progress(stream=stream, quiet_seconds=0.0) as progress:
        progress.plan({"solving": 5.0, "writing": 60.0})
        progress.step("solving")
        text = progress.message()
    assert re.fullmatch(r"solving \(0 s so far, about 1 min \d+ s left\)", text)
    assert stream.getvalue().endswith("\n")


def test_progress_forgives_a_step_that_was_not_planned():
    with Progress(stream=io.StringIO()) as progress:
        progress.step("surprise")
        assert progress.message().startswith("surprise")


def test_cache_lies_in_the_users_cache_folder(monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "jaxfsi"


@pytest.mark.parametrize(("value", "expected"), [("off", None), ("", None), ("/x/y", "/x/y")])
def test_cache_can_be_moved_or_switched_off(monkeypatch, value, expected):
    monkeypatch.setenv(VARIABLE, value)
    assert cache_folder() == (None if expected is None else pathlib.Path(expected))


def test_no_cache_without_a_home(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as where there is none
    assert cache_folder() is None
