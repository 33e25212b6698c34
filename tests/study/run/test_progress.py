"""The time left of a whole command, told with a clock of the test's own."""

import errno
import io
import itertools
import json
import re
import threading

import pytest

from study.run.progress import Progress


class _Clock:
    """A clock that stands still until it is moved."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return _Clock()


@pytest.fixture
def progress(clock, tmp_path):
    return Progress(stream=io.StringIO(), clock=clock, memory=tmp_path / "durations.json")


PLAN = {
    "reading": 2.0, "meshing": 40.0, "ramp": 100.0, "0D": 30.0,
    **{f"run {k}": 140.0 for k in range(4)}, "drawing": 40.0,
}  # fmt: skip
TAKEN = {"reading": 0.1, "meshing": 3.0, "ramp": 190.0, "0D": 4.0, "drawing": 50.0}
"""What a command takes on a machine of half the speed that finds its mesh and its 0D code kept."""


def _watched(progress, clock, taken):
    """Time left as told, every half second, beside the time."""
    progress.plan(PLAN)
    told = []
    for name in PLAN:
        progress.step(name)
        length = taken.get(name, 260.0)
        marching = name.startswith("run") or name == "ramp"
        if marching:
            progress.tell("compiling the step")
        for k in range(int(2 * length)):
            clock.now += 0.5
            if marching and k % 8 == 0 and k > 60:
                noise = 1.0 + 0.1 * (-1) ** (k // 8)
                progress.tell(f"step {k}", (length - k / 2) * noise)
            told.append((clock.now, progress.left()))
    return told


def test_time_left_does_not_swing(progress, clock):
    begun = clock.now
    told = _watched(progress, clock, TAKEN)
    end = clock.now
    for t, left in told:
        if t < begun + 60.0 or end - t < 60.0:
            continue
        assert 0.45 < left / (end - t) < 1.8, (t - begun, left, end - t)
    jumps = [abs(b - a + 0.5) for (_, a), (_, b) in itertools.pairwise(told)]
    assert max(jumps) < 100.0  # of a command of 21 minutes
    assert sorted(jumps)[int(0.99 * len(jumps))] < 12.0


def test_steps_that_were_found_finished_do_not_make_the_others_short(progress, clock):
    progress.plan({"a": 100.0, "b": 100.0, "c": 100.0})
    for name in ("a", "b"):
        progress.step(name)
        clock.now += 0.01
    progress.step("c")
    assert progress.left() == pytest.approx(100.0)


def test_first_word_of_a_step_without_an_estimate_leaves_that_of_the_plan(progress, clock):
    progress.plan({"running": 100.0, "drawing": 50.0})
    progress.step("running")
    clock.now += 10.0
    progress.tell("compiling the step")
    assert progress.left() == pytest.approx(140.0)
    assert progress.message().startswith("compiling the step (10 s so far, about 2 min 20 s left")


def test_a_step_beyond_its_time_promises_no_end(progress, clock):
    progress.plan({"fitting": 10.0, "drawing": 5.0})
    progress.step("fitting")
    clock.now += 12.0
    assert "left" in progress.message()
    clock.now += 8.0
    assert progress.message().startswith("fitting (20 s so far, longer than usual")
    progress.tell("fitting", 7.0)
    assert "left" in progress.message()
    progress.step("drawing")
    assert "left" in progress.message()


def test_what_a_step_says_of_itself_takes_over(progress, clock):
    progress.plan({"running": 1000.0})
    progress.step("running")
    for k in range(60):
        clock.now += 1.0
        progress.tell("step", 100.0 - k)
    assert progress.left() == pytest.approx(41.0, abs=20.0)


def test_durations_are_remembered_on_this_machine(clock, tmp_path):
    path = tmp_path / "cache/durations.json"
    for expected in (100.0, 141.4, 168.2):
        with Progress(
            stream=io.StringIO(), clock=clock, memory=path, quiet_seconds=60.0
        ) as progress:
            progress.plan({"ramp": 100.0, "end": 1.0})
            progress.step("ramp")
            assert progress.left() == pytest.approx(expected + 1.0, rel=1e-3)
            clock.now += 200.0
            progress.step("end")
    assert json.loads(path.read_text())["ramp"] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("content", ["", "[1]", '{"ramp": null}', '{"ramp": 1e300}', "\x00"])
def test_damaged_memory_is_no_error(clock, tmp_path, content):
    path = tmp_path / "durations.json"
    path.write_text(content)
    progress = Progress(stream=io.StringIO(), clock=clock, memory=path)
    progress.plan({"ramp": 1.0})
    progress.step("ramp")
    assert 0.0 < progress.left() <= 20.0


class _Terminal(io.StringIO):
    def isatty(self):
        return True


def test_bar_on_a_terminal_fits_its_line_and_is_cleared(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "60")
    stream, named = _Terminal(), "marching [mesh/1] " + 10 * "far "
    shown = threading.Event()
    # the bar may be drawn before the step has begun
    flush = lambda: "marching" in stream.getvalue() and shown.set()  # noqa: E731
    monkeypatch.setattr(stream, "flush", flush)
    with Progress(stream=stream, quiet_seconds=0.0) as progress:
        progress.plan({named: 100.0})
        progress.step(named)
        shown.wait(10.0)
    drawn = stream.getvalue()
    assert "marching [mesh/1]" in drawn
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn).replace("\r", "\n").split("\n")
    assert max(map(len, lines)) <= 60
    last = drawn[drawn.rindex("far") :]
    assert "\x1b[2K" in last  # the line is cleared
    assert "\x1b[?25h" in last  # the cursor is there again


def test_reader_that_has_gone_is_no_error(monkeypatch):
    for stream, error in ((io.StringIO(), errno.EPIPE), (_Terminal(), errno.EIO)):

        def gone(*_, error=error):
            raise OSError(error, "gone")

        monkeypatch.setattr(stream, "write", gone)
        with Progress(stream=stream, quiet_seconds=0.0) as progress:
            progress.step("marching")


def test_share_of_the_time_grows_to_one(progress, clock):
    progress.plan({"a": 10.0, "b": 10.0})
    told = []
    for name in ("a", "b"):
        progress.step(name)
        for _ in range(10):
            told.append(progress.share())
            clock.now += 1.0
    assert told == sorted(told)
    assert told[0] == pytest.approx(0.0, abs=1e-6)
    assert told[-1] > 0.8


def test_work_without_a_step_can_say_how_long_it_takes(progress, clock):
    with progress:
        clock.now += 2.0
        progress.tell("sweeping", left=10.0)
        clock.now += 1.0
        assert "sweeping (3 s so far" in progress.message()
        assert 0.0 < progress.share() <= 1.0
