"""A cohort as an array of jobs: the script, run by hand, and what it refuses."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest

from study.run.cohort import gathered
from study.run.job_files import LIST_FILE, SCRIPT_FILE
from study.run.members import find_members
from tests.study.least_case import LEAST_CASE

_STUB = """\
import json, pathlib, signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
case, folder = pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[-1])
with open(folder / "begun.txt", "a") as file:
    file.write("begun\\n")
name = folder.name
if name == "fails":
    sys.exit("no ratio can be reached")
while name == "waits" and not (folder / "go").exists():
    time.sleep(0.05)
(folder / "result.json").write_text(json.dumps({"format": "jaxfsi 2", "kind": "run",
    "words": sys.argv[3:-2]}))
"""


class _Array:
    """An array of jobs whose tasks are run by hand."""

    def __init__(self, folder, command):
        self.folder, self.command = folder, command
        self.members = find_members(folder / "the patients", folder / "out")

    def emit(self, *options):
        given = ("cohort", self.folder / "the patients", "--emit-jobs", self.folder / "jobs")
        return self.command(*given, *options, "--out", self.folder / "out", "--", "--no-mesh")

    def begin(self, number, **variables):
        job = {"SLURM_ARRAY_TASK_ID": str(number), "SLURM_ARRAY_JOB_ID": "7"}
        path = os.pathsep.join([str(self.folder / "bin"), os.environ["PATH"]])
        return subprocess.Popen(
            ["bash", self.folder / "jobs" / SCRIPT_FILE],
            env={**os.environ, **job, **variables, "PATH": path},
            stderr=subprocess.PIPE,
            text=True,
        )

    def task(self, number, **variables):
        process = self.begin(number, **variables)
        _, said = process.communicate(timeout=30.0)
        return process.returncode, said

    def requeued(self):
        path = self.folder / "requeued"
        return path.read_text().split() if path.exists() else []


@pytest.fixture
def array(tmp_path, command, monkeypatch):
    """Cases `fails`, `first` and `waits`, and programs in the place of `jaxfsi` and `scontrol`."""
    for name in ("fails", "first", "waits"):
        (tmp_path / "the patients" / name).mkdir(parents=True)
        (tmp_path / "the patients" / name / "case.toml").write_text(LEAST_CASE.format(name=name))
    (tmp_path / "bin").mkdir()
    control = f'#!/bin/bash\necho "$2" >> {str(tmp_path / "requeued")!r}\n'
    for name, text in (("jaxfsi", f"#!{sys.executable}\n{_STUB}"), ("scontrol", control)):
        (tmp_path / "bin" / name).write_text(text)
        (tmp_path / "bin" / name).chmod(0o755)
    monkeypatch.setattr("study.run.job_files._installed", lambda: str(tmp_path / "bin" / "jaxfsi"))
    return _Array(tmp_path, command)


def _until(condition):
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_tasks_leave_what_the_cohort_gathers(array):
    emitted = array.emit("--workers", "2")
    assert emitted.status == 0, emitted.stderr
    script = array.folder / "jobs" / SCRIPT_FILE
    assert f"submit: sbatch {script}\n" in emitted.stdout
    assert "gather: jaxfsi cohort" in emitted.stdout
    assert emitted.stdout.rstrip().endswith("--gather -- --no-mesh")
    assert not (array.folder / "out").exists()
    text = script.read_text()
    assert "#SBATCH --array=1-3%2\n" in text
    assert "#SBATCH --requeue --signal=B:USR1@120\n" in text
    (array.folder / "out" / "waits").mkdir(parents=True)
    (array.folder / "out" / "waits" / "go").touch()
    assert [array.task(number)[0] for number in (1, 2, 3)] == [1, 0, 0]
    failed, *found = gathered(array.members, "curve", ["--no-mesh"])
    assert failed.reason == "not finished. no ratio can be reached"
    assert [result.document["words"] for result in found] == [["--no-mesh"]] * 2
    assert array.requeued() == []
    again = array.emit("--json").json  # only what is not finished
    assert again["cases"] == ["fails"]


def test_finished_task_does_nothing_when_it_is_submitted_again(array):
    array.emit()
    assert [array.task(2)[0], array.task(2)[0]] == [0, 0]
    assert (array.folder / "out" / "first" / "begun.txt").read_text() == "begun\n"


@pytest.mark.parametrize(("restarts", "queued"), [(0, ["7_3"]), (2, ["7_3"]), (3, [])])
def test_time_limit_ends_the_case_in_order_and_queues_it_again(array, restarts, queued):
    array.emit()
    process = array.begin(3, SLURM_RESTART_COUNT=str(restarts))
    _until((array.folder / "out" / "waits" / "begun.txt").exists)
    process.send_signal(signal.SIGUSR1)
    _, said = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert array.requeued() == queued
    assert ("queued again" if queued else "ended 4 times; submit it again") in said
    (array.folder / "out" / "waits" / "go").touch()
    assert array.task(3)[0] == 0
    assert gathered(array.members, "curve", ["--no-mesh"])[2].document is not None


def test_killed_case_is_queued_again_and_a_cancelled_one_is_not(array):
    array.emit()
    place = array.folder / "out" / "waits" / "begun.txt"
    for number, ending in ((1, "case"), (2, "task")):
        process = array.begin(3)
        _until(lambda n=number: place.exists() and len(place.read_text().split()) == n)
        if ending == "case":
            children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children")
            os.kill(int(children.read_text().split()[0]), signal.SIGKILL)
        else:
            process.terminate()
        process.communicate(timeout=20.0)
        assert process.returncode == (137 if ending == "case" else 130)
        assert array.requeued() == ["7_3"]


def test_number_without_a_case_is_refused(array):
    array.emit()
    status, said = array.task(4)
    assert status == 2
    assert f"{LIST_FILE} has no case 4" in said


@pytest.mark.parametrize("name", [SCRIPT_FILE, LIST_FILE])
def test_foreign_file_stays(array, name):
    (array.folder / "jobs").mkdir()
    (array.folder / "jobs" / name).write_text("my own work\n")
    found = array.emit()
    assert found.status == 2
    assert "was not written by --emit-jobs and stays" in found.stderr
    assert [path.name for path in (array.folder / "jobs").iterdir()] == [name]
    assert (array.folder / "jobs" / name).read_text() == "my own work\n"


def test_jobs_and_dask_exclude_each_other(array):
    found = array.emit("--executor", "dask")
    assert found.status == 2
    assert "Leave out --executor dask" in found.stderr
    assert not (array.folder / "jobs").exists()


def test_options_of_slurm_go_into_the_script(array):
    array.emit("--executor", "slurm:partition=long,time=1-12,cpus=2")
    text = (array.folder / "jobs" / SCRIPT_FILE).read_text()
    assert "#SBATCH --partition=long\n#SBATCH --time=1-12\n#SBATCH --cpus-per-task=2\n" in text
