"""A run that is killed at any moment goes on to the same files, bit for bit."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

PROGRAM = pathlib.Path(__file__).with_name("pulsed_tube.py")
ROOT = PROGRAM.parents[3]


def _start(folder, n_steps, cache, *options):
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "JAX_COMPILATION_CACHE_DIR": str(cache),
    }
    command = [sys.executable, str(PROGRAM), str(folder), str(n_steps), *options]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _finish(process):
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    return out


def _kill_and_resume(content, tmp_path, kills, n_steps, *options):
    """Kill runs at random moments; what ends before its kill is compared and begun anew."""
    cache, whole = tmp_path / "cache", tmp_path / "whole"
    _finish(_start(tmp_path / "warm", 1, cache, *options))  # compiles
    begin = time.monotonic()
    _finish(_start(whole, n_steps, cache, *options))
    span = time.monotonic() - begin
    rng = np.random.default_rng(0)
    hit = ended = 0
    while hit < kills:
        broken = tmp_path / f"broken{ended}"
        begin = time.monotonic()
        process = _start(broken, n_steps, cache, *options)
        try:
            # the first half is the start of Python and the tracing of the step
            process.communicate(timeout=span * rng.uniform(0.5, 0.97))
            assert process.returncode == 0
            assert content(broken) == content(whole)
            ended += 1
            # the machine is less busy than it was
            span = time.monotonic() - begin
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            hit += 1
    broken = tmp_path / f"broken{ended}"
    _finish(_start(broken, n_steps, cache, *options))
    assert content(broken) == content(whole)


@pytest.mark.slow  # a minute: two runs are killed and started again
def test_run_killed_twice_ends_the_same(pulsed, tmp_path):
    _kill_and_resume(pulsed.content, tmp_path, 2, 600, "--rigid")


@pytest.mark.slow  # several minutes
def test_run_killed_ten_times_ends_the_same(pulsed, tmp_path):
    _kill_and_resume(pulsed.content, tmp_path, 10, 1500)
