"""Cases of a cohort, one after another in this process: `python -m study.cli.case_process`.

What `study.run.case_call.CaseProcess` begins, and the other end of its lines. The process ends with
the one that began it, which holds the other end of its standard input, and where no case comes for
a while. It works on the core that the environment names, if any.

A case is a command as any other: its output goes to its log, and its results are those of a process
of its own. The next case finds modules imported and functions compiled. It is left to another
process where a case failed or was interrupted, and where this one has grown or grown old.
"""

import importlib
import json
import os
import queue
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any

CORE = "JAXFSI_CORE"
"""Environment variable with the core to run on."""

MOST_CASES = 25
"""Cases of a process: code compiled for each takes memory maps, of which it may have 65 530."""

MOST_MEMORY = 2_000_000_000
"""Bytes that a process may have taken at most and still get another case."""

_INTERRUPTED = 130
_KEPT_AFTER = (0, 2)  # done, or the input was refused: nothing is left half done
_IDLE_SECONDS = 30.0


def main() -> int:
    """Run cases by `jaxfsi`; gives the exit status of the process."""
    for name in ("SIGUSR1", "SIGUSR2"):  # a batch system tells whoever started this
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    core = os.environ.get(CORE, "")
    if core and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    return serve(lambda words: importlib.import_module("study.cli.entry").main(words))


def serve(run: Callable[[list[str]], int]) -> int:
    """Run the cases that standard input names, until it ends or this process is not to go on.

    Args:
        run: gives the exit status of a command from its arguments.

    Returns:
        The exit status of the process.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    answers = os.dup(1)
    requests: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(os.dup(0), requests), daemon=True).start()
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)  # what a case starts reads none of the lines
    try:
        for number in range(1, MOST_CASES + 1):
            request = requests.get(timeout=_IDLE_SECONDS)
            _write_to(request["log"])
            with warnings.catch_warnings():  # one that was shown before is shown again
                status = run(request["arguments"])
            kept = status in _KEPT_AFTER and number < MOST_CASES and _memory() < MOST_MEMORY
            _flush()
            os.write(answers, f"{status} {int(kept)}\n".encode())
            if not kept:
                return status
    except (KeyboardInterrupt, queue.Empty):
        pass
    return _INTERRUPTED


def _listen(lines: int, requests: "queue.SimpleQueue[dict[str, Any]]") -> None:
    with os.fdopen(lines, "rb") as file:
        for line in file:
            requests.put(json.loads(line))
    os._exit(_INTERRUPTED)


def _write_to(log: str) -> None:
    """Let all output go to a file from now on, that of libraries too."""
    with open(log, "ab") as file:
        for number in (1, 2):
            os.dup2(file.fileno(), number)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()


def _memory() -> int:
    """Most bytes of memory that this process has had; 0 where the system does not say.

    Linux tells it by VmHWM; `ru_maxrss` there holds the memory of the process that began this one.
    """
    try:
        with open("/proc/self/status", encoding="ascii", errors="replace") as file:
            lines = [line.split() for line in file]
        return next(1024 * int(words[1]) for words in lines if words[0] == "VmHWM:")
    except (OSError, StopIteration, IndexError):
        pass
    try:
        resource = importlib.import_module("resource")
    except ImportError:
        return 0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


if __name__ == "__main__":
    sys.exit(main())
