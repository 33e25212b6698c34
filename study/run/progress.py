"""Progress on standard error: the step at work and the time left, for what takes over 2 seconds.

Each step, and what it says of itself every ten seconds, is logged too (logger `study.run.progress`,
level INFO).

The time left is that of the plan, each step scaled by how long it took on this machine before, and
all by how the steps of this command went. One step moves the scale little, and one that was found
finished not at all; what a step says of itself takes over within half a minute.
"""

import contextlib
import json
import logging
import math
import os
import pathlib
import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.store.cache_folder import cache_folder

QUIET_SECONDS = 2.0
"""Work that ends sooner shows nothing."""

_REDRAWN = 0.5
"""Seconds between two drawings of the bar."""

_LOG = logging.getLogger(__name__)

_LOGGED_EVERY = 10.0
"""Least time between two lines of the log within a step [s]."""

_BAR = 20
"""Characters of the bar."""

_DOUBT = 60.0
"""Seconds of the plan that weigh as much as those that went by, in the scale."""

_SETTLING = 15.0
"""Seconds in which an estimate follows what a step says of itself, by 63 %."""

_LATE = 1.5
"""A step that says nothing of its end is late after so many times the expected time."""

_LATE_WORDS = "longer than usual: other work on this machine, or code that is compiled once"

_FINISHED = 0.2
"""A step that takes less than this part of its time was found finished."""

_FEWEST = 2.0
"""Expected seconds below which the duration of a step is not remembered."""

_MOST_EXTREME = 20.0
"""Factor by which a remembered duration differs from the plan at most."""

_MOST_TELLING = math.log(3.0)
"""Logarithm of a step's duration over the expected one that counts for the others at most."""


class Progress:
    """Shows steps of known weight; a context manager.

    On a terminal a bar is drawn anew every half second; elsewhere a line is added at most every
    `line_every` seconds.
    """

    def __init__(
        self,
        *,
        stream: Any = None,
        quiet_seconds: float = QUIET_SECONDS,
        line_every: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
        memory: pathlib.Path | None = None,
    ):
        """Set up; nothing is shown before the first step.

        Args:
            stream: text stream to write to; standard error by default.
            quiet_seconds: shortest work that is shown [s].
            line_every: least time between two lines where the stream is no terminal [s].
            clock: gives the time [s].
            memory: file with how long steps took before; None: in the user's cache.
        """
        self._stream = sys.stderr if stream is None else stream
        is_terminal = bool(getattr(self._stream, "isatty", lambda: False)())
        self._show = self._redraw if is_terminal and os.environ.get("TERM") != "dumb" else self._add
        self._quiet, self._line_every = quiet_seconds, line_every
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._plan: list[tuple[str, float]] = []
        self._last: list[tuple[str, float]] = []
        self._at = -1
        self._clock = clock
        self._start = self._step_start = clock()
        self._memory = _Memory(memory)
        self._done: list[tuple[float, float]] = []  # weight, logarithm of taken over expected
        self._spent: dict[str, float] = {}
        self._told: str | None = None
        self._logged = -math.inf
        self._end: tuple[float, float] | None = None  # of the step, and when that was said
        self._thread: threading.Thread | None = None

    def __enter__(self) -> "Progress":
        """Start the clock."""
        self._start = self._step_start = self._clock()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the clock and clear the line."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        if kind is None:
            with self._lock:
                self._finish(self._clock())
        self._memory.write()

    def plan(self, steps: dict[str, float]) -> None:
        """Name the steps to come, each with the seconds that it usually takes."""
        with self._lock:
            begun = self._plan[: max(self._at, 0)]
            self._plan = [*begun, *steps.items(), *self._last]

    def plan_last(self, steps: dict[str, float]) -> None:
        """Name steps that come after those of every plan."""
        with self._lock:
            self._last = list(steps.items())
            self._plan += self._last

    def step(self, name: str) -> None:
        """Begin a step of the plan; the steps before it count as done."""
        with self._lock:
            now = self._clock()
            names = [entry for entry, _ in self._plan]
            if name not in names[self._at + 1 :]:
                self._plan.insert(self._at + 1, (name, 1.0))
                names = [entry for entry, _ in self._plan]
            self._finish(now)
            self._at, self._step_start = names.index(name, self._at + 1), now
            self._told = self._end = None
            self._logged = now
        _LOG.info("%s", name)

    def _finish(self, now: float) -> None:
        """Take note of how long the step at work took."""
        if self._at < 0:
            return
        name, usual = self._plan[self._at]
        taken = now - self._step_start
        self._spent[name] = self._spent.get(name, 0.0) + taken
        expected = self._expected(self._at)
        if taken > _FINISHED * expected:
            self._done.append((expected, _telling(taken / expected)))
            self._memory.learn(name, usual, taken)

    def tell(self, text: str, left: float | None = None) -> None:
        """Say what the current step is at, and the seconds that it still takes.

        Args:
            text: what to show.
            left: seconds; None where the plan knows better.
        """
        with self._lock:
            now = self._clock()
            if left is not None:
                end, said = self._end or (now + self._current(now), now)
                follow = -math.expm1((said - now) / _SETTLING)
                self._end = (end + follow * (now + left - end), now)
            self._told = text
            due = now - self._logged >= _LOGGED_EVERY
            self._logged = now if due else self._logged
        if due:
            _LOG.info("%s", text)

    def message(self) -> str:
        """What is shown now."""
        with self._lock:
            now = self._clock()
            name = self._plan[self._at][0] if self._at >= 0 else "starting"
            left = _LATE_WORDS if self._late(now) else _left(self._rest(now))
            return f"{self._told or name} ({_span(now - self._start)} so far, {left})"

    def share(self) -> float:
        """Part of the whole time that went by."""
        with self._lock:
            now = self._clock()
            spent = now - self._start
            return spent / max(spent + self._rest(now), 1e-9)

    def spent(self) -> dict[str, float]:
        """Seconds that each step took so far, by name; a step of the same name adds to it."""
        with self._lock:
            spent = dict(self._spent)
            if self._at >= 0:
                name = self._plan[self._at][0]
                spent[name] = spent.get(name, 0.0) + self._clock() - self._step_start
            return spent

    def left(self) -> float:
        """Seconds until the end of the plan."""
        with self._lock:
            return self._rest(self._clock())

    def _rest(self, now: float) -> float:
        later = sum(self._expected(k) for k in range(self._at + 1, len(self._plan)))
        return self._current(now) + later * self._pace(now)

    def _current(self, now: float) -> float:
        """Seconds left of the step at work."""
        if self._at < 0:
            return 0.0
        if self._end is not None:
            return max(self._end[0] - now, 0.0)
        usual = self._expected(self._at) * self._pace(now)
        return max(usual - (now - self._step_start), 0.1 * usual)

    def _late(self, now: float) -> bool:
        """Whether the time left is not known: the step at work is beyond what was expected."""
        if self._at < 0 or self._end is not None:
            return False
        usual = self._expected(self._at) * self._pace(now)
        return now - self._step_start > max(_LATE * usual, _FEWEST + usual)

    def _expected(self, at: int) -> float:
        name, seconds = self._plan[at]
        return seconds * self._memory.factor(name)

    def _pace(self, now: float) -> float:
        """How much longer than expected things take: a mean of logarithms, with doubt.

        A step that says how long it still takes counts as far as it has come, so that nothing
        jumps when it ends.
        """
        seen = list(self._done)
        if self._end is not None and self._at >= 0:
            taken = now - self._step_start
            whole, expected = max(taken, self._end[0] - self._step_start), self._expected(self._at)
            if whole > _FINISHED * expected:
                seen.append((expected * taken / whole, _telling(whole / expected)))
        weight = sum(weight for weight, _ in seen) + _DOUBT
        return math.exp(sum(weight * log for weight, log in seen) / weight)

    def _watch(self) -> None:
        # the reader may have gone: progress is not worth an error
        with contextlib.suppress(OSError, ValueError):
            if not self._stop.wait(self._quiet):
                self._show()

    def _redraw(self) -> None:
        """Draw a bar with the message anew until the end, and clear it."""
        from rich import console, progress  # slow to import: most commands end before they show

        columns = (
            progress.BarColumn(_BAR),
            progress.TextColumn("{task.description}", markup=False),
        )
        terminal = console.Console(file=self._stream, force_terminal=True, highlight=False)
        with progress.Progress(
            *columns,
            console=terminal,
            auto_refresh=False,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        ) as bar:
            task = bar.add_task("", total=1.0)
            while True:
                bar.update(task, description=self.message(), completed=self.share(), refresh=True)
                if self._stop.wait(_REDRAWN):
                    return

    def _add(self) -> None:
        """Add a line with the message now and then until the end."""
        while True:
            self._stream.write(f"{self.message()}\n")
            self._stream.flush()
            if self._stop.wait(self._line_every):
                return


def _left(seconds: float) -> str:
    return f"about {_span(seconds)} left" if seconds >= 1.0 else "nearly done"


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


class _Memory:
    """How much longer than planned each step took on this machine, by its name."""

    def __init__(self, path: pathlib.Path | None):
        """Read what is remembered; where nothing can be read, nothing is."""
        folder = cache_folder()
        self._path = path or (None if folder is None else folder / "durations.json")
        self._known: dict[str, float] = {}
        self._new: dict[str, float] = {}
        with contextlib.suppress(OSError, ValueError, AttributeError, TypeError):
            if self._path is not None:
                found = json.loads(regular_text(self._path))
                self._known = {str(name): _bounded(value) for name, value in found.items()}

    def factor(self, name: str) -> float:
        """What the planned seconds of a step are multiplied by."""
        return self._known.get(name, 1.0)

    def learn(self, name: str, usual: float, taken: float) -> None:
        """Take note of a step; half of it counts, as the machine may have been at other work."""
        if usual >= _FEWEST:
            self._new[name] = math.sqrt(self.factor(name) * _bounded(taken / usual))

    def write(self) -> None:
        """Keep it for the next command; what cannot be kept costs nothing."""
        if self._path is None or not self._new:
            return
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, json.dumps({**self._known, **self._new}), shared=True)


def _telling(ratio: float) -> float:
    return min(max(math.log(ratio), -_MOST_TELLING), _MOST_TELLING)


def _bounded(factor: float) -> float:
    return min(max(float(factor), 1.0 / _MOST_EXTREME), _MOST_EXTREME)
