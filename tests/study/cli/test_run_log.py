"""`run.log`: what is written, what a refusal takes back, what --quiet leaves out."""

import logging
import os
import pathlib
import re
import sys
import warnings

import pytest

from study.case.faults import CaseError, Fault
from study.cli.command_output import complain, note, told
from study.cli.request import Request
from study.cli.run_log import LOG_FILE
from study.cli.work import work
from study.store.options import CalibrateOptions

TIMED = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d{4}  ")


def request(**more):
    words = ("jaxfsi", "calibrate", "case.toml")
    return Request("calibrate", CalibrateOptions(), words, None, False, **more)


def test_log_holds_command_versions_steps_notes_warnings_and_is_added_to(tmp_path, monkeypatch):
    monkeypatch.setattr(warnings, "showwarning", lambda *_, **__: None)
    for _ in range(2):
        with work(request(), tmp_path / "out") as progress:
            progress.step("counting")
            note("a note, 100 % of it")
            with warnings.catch_warnings():
                warnings.simplefilter("always")
                warnings.warn("odd numbers", RuntimeWarning, stacklevel=1)
            (tmp_path / "out/result.json").touch()
    text = (tmp_path / "out" / LOG_FILE).read_text()
    assert all(TIMED.match(line) for line in text.splitlines()), text
    for said in (
        "jaxfsi calibrate case.toml", "jaxlib ", "commit ", "CPUs", "counting",
        "a note, 100 % of it", "RuntimeWarning: odd numbers", "ended after",
    ):  # fmt: skip
        assert text.count(said) == 2, said
    assert logging.getLogger("study").handlers == []


def refused():
    return CaseError([Fault(pathlib.Path("case.toml"), "", None, "wrong", "", "no")])


def test_refusal_takes_its_lines_back_and_makes_no_folder(tmp_path):
    with pytest.raises(CaseError), work(request(), tmp_path / "out"):
        raise refused()
    assert not (tmp_path / "out").exists()
    with work(request(), tmp_path / "out"):
        pass
    before = (tmp_path / "out" / LOG_FILE).read_bytes()
    with pytest.raises(CaseError), work(request(), tmp_path / "out"):
        raise refused()
    assert (tmp_path / "out" / LOG_FILE).read_bytes() == before


def test_interrupt_before_anything_was_written_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), work(request(), tmp_path / "out"):
        raise KeyboardInterrupt
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/checkpoint.npz").touch()
    with pytest.raises(KeyboardInterrupt), work(request(), tmp_path / "out"):
        raise KeyboardInterrupt("the same command goes on")
    assert "interrupted. the same command goes on" in (tmp_path / "out" / LOG_FILE).read_text()


def test_failure_is_logged_with_its_traceback(tmp_path):
    with pytest.raises(ZeroDivisionError), work(request(), tmp_path / "out"):
        _ = 1 / 0
    text = (tmp_path / "out" / LOG_FILE).read_text()
    assert "Traceback" in text
    assert "ZeroDivisionError" in text


@pytest.mark.skipif(os.name != "posix", reason="links and pipes of POSIX")
@pytest.mark.parametrize("kind", ["folder", "link", "pipe"])
def test_what_is_no_file_in_the_place_of_the_log_is_left_alone(kind, tmp_path):
    place = tmp_path / LOG_FILE
    (tmp_path / "elsewhere").write_text("mine")
    {
        "folder": place.mkdir,
        "link": lambda: place.symlink_to(tmp_path / "elsewhere"),
        "pipe": lambda: os.mkfifo(place),
    }[kind]()
    with work(request(), tmp_path):
        pass
    assert (tmp_path / "elsewhere").read_text() == "mine"


def test_quiet_leaves_notes_out_and_says_complaints(capsys, tmp_path):
    for quiet in (False, True):
        with told(quiet=quiet):
            note("wrote it")
            complain("it failed")
        assert capsys.readouterr().err == ("" if quiet else "wrote it\n") + "it failed\n"
    with told(quiet=True), work(request(quiet=True), tmp_path) as progress:
        progress.step("counting")
        assert progress._stream is not sys.stderr


def test_closed_standard_error_costs_no_result(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    with told(quiet=False):
        note("nobody hears it")
