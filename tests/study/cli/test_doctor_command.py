"""The command `doctor`: what works, and every problem with its cure."""

import json
import os

import pytest

from jaxfsi.meshing.isolate import MeshingError, NotInstalledError
from study.cli.entry import main
from study.run import health, health_meshers
from study.store.cache_folder import VARIABLE
from study.store.folder_lock import HOLDER_FILE, LOCK_FILE, at_work


@pytest.fixture
def quick(monkeypatch, tmp_path):
    """Leaves out what takes seconds, in an empty folder with a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    trials = [("study.run.health", name) for name in ("packages", "machine", "folders", "locks")]
    monkeypatch.setattr("study.cli.doctor_command._TRIALS", trials)
    return tmp_path


def test_installation_that_runs_these_tests_meshes_and_compiles(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, "off")
    trials = [("study.run.health_trials", "compilation"), ("study.run.health_meshers", "meshers")]
    monkeypatch.setattr("study.cli.doctor_command._TRIALS", trials)
    status = main(["doctor", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (status, found["problems"]) == (0, 0), found
    said = {entry["name"]: entry["found"] for entry in found["findings"]}
    assert "tets" in said["Netgen (tetrahedra)"]
    assert "triangles" in said["Mmg (surfaces)"]
    assert "GB/s" in said["trial"]


def test_problem_has_a_cure_and_the_status_1(quick, monkeypatch, capsys):
    (quick / "file").touch()
    monkeypatch.setenv(VARIABLE, str(quick / "file/cache"))
    monkeypatch.setattr(
        health, "_required", lambda: ["surely-absent>=1", "numpy>=999", "x; extra=='a'"]
    )
    assert main(["doctor", "--quiet"]) == 1
    said = capsys.readouterr().out
    assert os.strerror(20) in said
    assert "try: make it writable" in said
    assert "pip install 'surely-absent>=1'" in said
    assert "pip install 'numpy>=999'" in said
    assert said.count("!!") == said.count("try:") == 3


def test_what_cannot_be_looked_at_is_a_problem_and_ends_nothing(quick, monkeypatch, capsys):
    monkeypatch.setattr("study.cli.doctor_command._TRIALS", [("study.run.no_such", "part")])
    assert main(["doctor"]) == 1
    assert "cannot be looked at: No module named" in capsys.readouterr().out


def test_locks_at_work_and_left_behind_are_told_apart(quick):
    (quick / "left").mkdir()
    (quick / "left" / LOCK_FILE).touch()
    (quick / "marked").mkdir()
    (quick / "marked" / HOLDER_FILE).write_text("1\nelsewhere\n")
    with at_work(quick / "busy"):
        found = {os.path.relpath(f.found.split(":")[0], quick): f for f in health.locks()}
    assert "at work" in found[f"busy/{LOCK_FILE}"].found
    assert "next one takes it" in found[f"left/{LOCK_FILE}"].found
    assert "remove" in found[f"marked/{HOLDER_FILE}"].cure
    assert "none" in next(iter(health.locks())).found or len(list(health.locks())) == 2


@pytest.mark.parametrize("error", [NotInstalledError("no module"), MeshingError("it crashed")])
def test_mesher_that_fails_is_a_problem_where_meshing_needs_it(error, monkeypatch):
    def fail(_):
        raise error

    monkeypatch.setattr(health_meshers, "run_isolated", fail)
    found = {entry.name: entry for entry in health_meshers.meshers()}
    assert "pip install" in found["Netgen (tetrahedra)"].cure
    missing = isinstance(error, NotInstalledError)
    assert bool(found["Gmsh (tetrahedra)"].problem) != missing
