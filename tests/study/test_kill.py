"""A study and a cohort with the real march, killed at any moment, end with the same numbers."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]
PROGRAM = "import sys; from study.cli import main; sys.exit(main(sys.argv[1:]))"
QUICK = ("--dt", "1e-2", "--ramp-rate", "300", "--no-paper")


def _start(cache, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAXFSI_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _finished(cache, *arguments):
    process = _start(cache, *arguments)
    _, err = process.communicate(timeout=1200)
    assert process.returncode == 0, err
    return err


def _killed(cache, after, *arguments):
    """Kill a command after some seconds; whether it was still at work."""
    process = _start(cache, *arguments)
    try:
        process.communicate(timeout=after)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.communicate()
        return True
    return False


def _numbers(folder):
    document = json.loads((folder / "study.json").read_text())
    return {part: document[part] for part in ("ramp", "calibrations", "loop", "rows", "runs")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory, tube):
    """Case, cache and folder of a study that ran through, and what it took with a warm cache."""
    folder = tmp_path_factory.mktemp("whole")
    case, cache = tube.write_case(folder / "a"), folder / "cache"
    _finished(cache, "study", case, *QUICK, "--out", folder / "cold")
    begin = time.monotonic()
    _finished(cache, "study", case, *QUICK, "--out", folder / "out")
    return case, cache, folder / "out", time.monotonic() - begin


@pytest.mark.slow  # four minutes: compiles, then starts again after each kill
def test_study_killed_at_any_moment_ends_the_same(whole, tmp_path):
    case, cache, reference, span = whole
    rng, hit = np.random.default_rng(0), 0
    arguments = ("study", case, *QUICK, "--out", tmp_path / "out")
    for _ in range(4):
        hit += _killed(cache, span * rng.uniform(0.3, 0.8), *arguments)
    assert hit >= 2
    _finished(cache, *arguments)
    assert _numbers(tmp_path / "out") == _numbers(reference)


@pytest.mark.slow
def test_killed_cohort_ends_the_same_and_leaves_no_process(whole, tmp_path, tube):
    _, cache, reference, span = whole
    for name in "ab":
        tube.write_case(tmp_path / "cases" / name)
    out = tmp_path / "out"
    arguments = ("cohort", tmp_path / "cases", "--mode", "3d", "--workers", "1", "--out", out)
    arguments = (*arguments, "--", *QUICK)
    hit = sum(_killed(cache, span * share, *arguments) for share in (0.8, 1.2))
    assert hit == 2
    _finished(cache, *arguments)
    for name in "ab":
        assert _numbers(out / name) == _numbers(reference)
    document = json.loads((out / "cohort.json").read_text())
    assert [p["status"] for p in document["patients"]] == [0, 0]
