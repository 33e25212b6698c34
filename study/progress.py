"""Progress on standard error: the step at work and the time left, for what takes over 2 seconds."""

import sys
import threading
import time
from types import TracebackType
from typing import Any

QUIET_SECONDS = 2.0
"""Work that ends sooner shows nothing."""


class Progress:
    """Shows steps of known weight; a context manager.

    On a terminal one line is rewritten every half second; elsewhere a line is added at most
    every `line_every` seconds. The time left scales the expected seconds of the steps not yet
    done by how the done ones went.
    """

    def __init__(
        self,
        *,
        stream: Any = None,
        quiet_seconds: float = QUIET_SECONDS,
        line_every: float = 5.0,
    ):
        """Set up; nothing is shown before the first step.

        Args:
            stream: text stream to write to; standard error by default.
            quiet_seconds: shortest work that is shown [s].
            line_every: least time between two lines where the stream is no terminal [s].
        """
        self._stream = sys.stderr if stream is None else stream
        self._terminal = bool(getattr(self._stream, "isatty", lambda: False)())
        self._quiet, self._line_every = quiet_seconds, line_every
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._plan: list[tuple[str, float]] = []
        self._last: list[tuple[str, float]] = []
        self._at = -1
        self._start = self._step_start = time.monotonic()
        self._spent, self._expected = 0.0, 0.0
        self._told: tuple[str, float] | None = None
        self._shown = False
        self._thread: threading.Thread | None = None

    def __enter__(self) -> "Progress":
        """Start the clock."""
        self._start = self._step_start = time.monotonic()
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
        if self._shown and self._terminal:
            self._write("\r\x1b[K")

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
            now = time.monotonic()
            names = [entry for entry, _ in self._plan]
            if name not in names[self._at + 1 :]:
                self._plan.insert(self._at + 1, (name, 1.0))
                names = [entry for entry, _ in self._plan]
            at = names.index(name, self._at + 1)
            if self._at >= 0:
                self._spent += now - self._step_start
                self._expected += sum(seconds for _, seconds in self._plan[self._at : at])
            self._at, self._step_start = at, now
            self._told = None

    def tell(self, text: str, left: float) -> None:
        """Say what the current step is at, and the seconds that it still takes."""
        with self._lock:
            self._told = (text, time.monotonic() + left)

    def message(self) -> str:
        """What is shown now."""
        with self._lock:
            now = time.monotonic()
            if self._told is not None:
                text, end = self._told
                pace = (self._spent + 1.0) / (self._expected + 1.0)
                later = sum(seconds for _, seconds in self._plan[self._at + 1 :]) * pace
                left = _left(max(end - now, 0.0) + later)
                return f"{text} ({_span(now - self._start)} so far, {left})"
            name = self._plan[self._at][0] if self._at >= 0 else "starting"
            pace = (self._spent + 1.0) / (self._expected + 1.0)
            current = self._plan[self._at][1] * pace if self._at >= 0 else 0.0
            later = sum(seconds for _, seconds in self._plan[self._at + 1 :]) * pace
            left = max(current - (now - self._step_start), 0.0) + later
        elapsed = now - self._start
        return f"{name} ({_span(elapsed)} so far, {_left(left)})"

    def _watch(self) -> None:
        if self._stop.wait(self._quiet):
            return
        while True:
            self._shown = True
            text = self.message()
            self._write(f"\r\x1b[K{text}" if self._terminal else f"{text}\n")
            if self._stop.wait(0.5 if self._terminal else self._line_every):
                return

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the reader has gone: progress is not worth an error
            self._stop.set()


def _left(seconds: float) -> str:
    return f"about {_span(seconds)} left" if seconds >= 1.0 else "nearly done"


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
