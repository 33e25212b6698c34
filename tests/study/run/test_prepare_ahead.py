"""What is prepared in a second thread beside the mesh and the ramp of a study."""

import threading

import pytest

from study.run import prepare_ahead
from study.run.prepare_ahead import prepared_ahead


@pytest.fixture
def gate(monkeypatch):
    """Tasks that wait for an event, and what they did."""
    opened, done = threading.Event(), []

    def task(name):
        def run(_):
            assert opened.wait(60.0)
            done.append(name)
            raise RuntimeError("fails again where it is called")

        return run

    monkeypatch.setattr(prepare_ahead, "_calibration", task("calibration"))
    monkeypatch.setattr(prepare_ahead, "_rest", task("rest"))
    return opened, done


def test_both_are_prepared_one_after_the_other_and_failures_stay_there(gate):
    opened, done = gate
    with prepared_ahead(None) as rest:
        rest(None)
        assert not done
        opened.set()
    assert done == ["calibration", "rest"]


def test_exception_of_the_block_is_not_held_up(gate):
    opened, done = gate

    def interrupted():
        with prepared_ahead(None) as rest:
            rest(None)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not done  # it waits for nothing; what has not begun never does
    opened.set()
    for thread in threading.enumerate():
        if thread.name.startswith("prepare-ahead"):
            thread.join(60.0)
    assert done == ["calibration"]
