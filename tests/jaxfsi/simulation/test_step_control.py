"""The ladder of step lengths, without any physics."""

import numpy as np
import pytest

from jaxfsi.simulation import StepControl
from jaxfsi.simulation.step_control import Position, after_steps, steps_to, stride, whole_steps


def _run(n_whole, control, fails=lambda tick, level: False, change=lambda tick, level: 0.0):
    """Lengths of the steps of a run whose steps fail where `fails` says so."""
    position, lengths, chunk = Position(), [], 20
    while whole_steps(position, control) < n_whole:
        stop = min(n_whole, (position.tick // stride(0, control) // chunk + 1) * chunk)
        unit = stride(position.level, control)
        n = min(chunk, steps_to(stop, position, control))
        assert n >= 1
        good, largest, trouble = 0, 0.0, False
        limit = control.change_limit
        for k in range(n):
            at = position.tick + k * unit
            if fails(at, position.level):
                trouble = True
                break
            good, now = good + 1, change(at, position.level)
            lengths.append(1.0 / 2**position.level)
            largest = max(largest, now)
            if limit is not None and position.level < control.max_halvings and now > limit:
                trouble = True
                break
        position = after_steps(good, trouble, largest, position, control)
        assert position.tick % stride(position.level, control) == 0
    return lengths, position


def test_without_trouble_all_steps_are_whole():
    lengths, position = _run(50, StepControl())
    assert lengths == [1.0] * 50
    assert position.level == 0


@pytest.mark.parametrize("at", [0, 7, 19, 20, 33])
def test_failed_steps_are_halved_and_grow_back_on_whole_steps(at):
    control = StepControl(max_halvings=3, good_steps=4)
    unit = stride(0, control)
    bad = range(at * unit + unit // 2, (at + 1) * unit)
    lengths, position = _run(
        50, control, fails=lambda tick, level: level < 2 and _covers(tick, level, bad, control)
    )
    assert np.sum(lengths) == pytest.approx(50.0)  # sums of powers of two are exact
    assert min(lengths) == 0.25
    assert lengths[-1] == 1.0
    assert position.tick == 50 * unit


def _covers(tick, level, bad, control):
    return any(tick <= b < tick + stride(level, control) for b in bad)


def test_adaptive_steps_follow_a_burst_of_change():
    control = StepControl(change_limit=0.1, good_steps=4)
    unit = stride(0, control)

    def change(tick, level):
        fast = 20 * unit <= tick < 30 * unit
        return (1.0 if fast else 0.005) / 4**level

    lengths, _ = _run(60, control, change=change)
    ends = np.cumsum(lengths)
    inside = (ends > 22.0) & (ends <= 30.0)
    assert np.all(np.asarray(lengths)[inside] == 0.25)  # 1/4² is the first below the limit
    assert np.all(np.asarray(lengths)[ends <= 20.0] == 1.0)
    assert lengths[-1] == 1.0
    assert ends[-1] == 60.0


@pytest.mark.parametrize(
    "fault", [{"max_halvings": -1}, {"good_steps": 3}, {"change_limit": 0.0}], ids=str
)
def test_choices_out_of_range_are_refused(fault):
    with pytest.raises(ValueError, match=next(iter(fault))):
        StepControl(**fault)
