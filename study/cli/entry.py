"""The command line, `jaxfsi`: what a signal does, before anything else is imported.

Exit status: 0 done, 1 the computation failed, 2 the input was refused, 130 interrupted. SIGTERM and
SIGHUP act as Ctrl-C does: 3D runs keep their last whole chunk. One that comes while the command is
still imported ends it at once; a second one within a second of the first is the same one.
"""

import atexit
import contextlib
import importlib
import os
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Any

INTERRUPTED = 130

LOG_LEVEL = "TF_CPP_MIN_LOG_LEVEL"
"""Environment variable that XLA reads when it is loaded: below which severity it logs nothing."""
_FATAL_ALONE = "3"

_SAME_SECONDS = 1.0
_AGAIN_SECONDS = 0.05
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments without the program's name; by default those of the process.

    Returns:
        The exit status.
    """
    # XLA logs its alarms ("Very slow compile?") as errors; what fails is raised besides.
    if not os.environ.get("JAXFSI_TRACEBACK"):
        os.environ.setdefault(LOG_LEVEL, _FATAL_ALONE)
    with Signals(alone=argv is None) as signals:
        try:
            status = importlib.import_module("study.cli.commands").run(argv, signals)
        except KeyboardInterrupt:  # before the command began, or a second one at its very end
            status = INTERRUPTED
    if argv is None and (status == INTERRUPTED or not os.environ.get("JAXFSI_TRACEBACK")):
        _leave(status)
    return status


def _leave(status: int) -> None:
    """End the process at once: JAX takes a second to free its programs.

    A thread that compiles would keep an interrupted process for up to half a minute. What modules
    do at the end of a process is done; profilers that wait for the end of the program need
    JAXFSI_TRACEBACK.
    """
    if status != INTERRUPTED:
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status)


class Signals:
    """Turns signals that end a process into `KeyboardInterrupt`; a context manager.

    Handlers are set in the main thread alone, and not for signals that the process ignores, as
    under nohup.
    """

    def __init__(self, *, alone: bool):
        """Nothing is set yet.

        Args:
            alone: whether the process does nothing but this command, so that it may be ended.
        """
        self._alone = self._exits = alone
        self._deaf = False
        self._raised = -_SAME_SECONDS
        self._before: dict[int, Any] = {}
        self._unraisable = sys.unraisablehook

    def __enter__(self) -> "Signals":
        """Set the handlers."""
        try:
            for number in _SIGNALS:
                if signal.getsignal(number) != signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._handle)
            if self._before and hasattr(signal, "setitimer"):
                self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._handle)
                sys.unraisablehook = self._dropped
        except ValueError:  # not the main thread
            pass
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put the handlers of before back; a process that ends now ignores signals."""
        sys.unraisablehook = self._unraisable
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._alone else handler)

    def working(self) -> None:
        """From now on there is work to be ended in order."""
        self._exits = False

    def deaf(self) -> None:
        """From now on signals change nothing: the command is at its end."""
        self._deaf = True

    def _handle(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self._deaf or (number != signal.SIGALRM and now - self._raised < _SAME_SECONDS):
            return
        if self._exits:
            os.write(2, b"interrupted; nothing was written\n")
            os._exit(INTERRUPTED)
        self._raised = now
        raise KeyboardInterrupt

    def _dropped(self, dropped: Any) -> None:
        """Raise an interrupt again that reached Python where it cannot be raised, in a callback."""
        if dropped.exc_type is KeyboardInterrupt:
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_SECONDS)
        else:
            self._unraisable(dropped)
