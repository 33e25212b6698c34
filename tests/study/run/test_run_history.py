"""What a run writes of its steps, and how long it says that they take."""

import types

import numpy as np
import pytest

import study.run.simulation as simulation_run
from jaxfsi.simulation import ProgressRecord, StepHistory
from study.run.simulation import write_history
from study.run.simulation_data import Schedule

NAMES = ("aorta_inlet", "outer_wall", "anomalous_outlet")


def _record(n=3):
    ones, counts = np.ones(n), np.ones(n, int)
    P = np.array([[1.0, 2.0, 3.0]] * n) * 1333.22
    return StepHistory(ones, ones, ones, P, P, counts, counts, ones, ones, ones)


def test_outside_of_the_wall_is_no_opening_of_the_history(tmp_path):
    write_history(tmp_path, _record(), NAMES)
    head, first, *_ = (tmp_path / "history.csv").read_text().splitlines()
    row = dict(zip(head.split(","), map(float, first.split(",")), strict=True))
    assert not [name for name in row if "outer_wall" in name]
    assert row["P_aorta_inlet_mmHg"] == pytest.approx(1.0, rel=1e-4)
    assert row["P_anomalous_outlet_mmHg"] == pytest.approx(3.0, rel=1e-4)


def test_time_of_a_step_is_the_one_that_is_shown_and_leaves_compiling_out(tmp_path, monkeypatch):
    now, told = [0.0], []
    monkeypatch.setattr(simulation_run.time, "monotonic", lambda: now[0])
    progress = types.SimpleNamespace(tell=lambda text, left=None: told.append((text, left)))
    setup = types.SimpleNamespace(schedule=Schedule(1e-3, 40, 40, 10, 0.04))
    watch = simulation_run._Watch(setup, tmp_path, progress)  # pyright: ignore
    for chunk in range(4):
        now[0] += 60.0 if chunk == 0 else 5.0
        P = np.zeros(3)
        watch.look(ProgressRecord(10.0 * (chunk + 1), 40, 0.0, 1e-3, NAMES, P, P, 1, _record()))
    assert watch.pace == pytest.approx(0.5)
    assert told[0][1] is None  # nothing is known but the time of compiling
    assert "s a step" not in told[0][0]
    assert "0.5 s a step" in told[-1][0]
    assert told[1][1] == pytest.approx(10.0)
