"""A process that runs commands one after another, and the handle of the one who asks.

The process has imported everything and keeps what was compiled: a command takes what its own work
takes. It is watched from outside, and ended where a command takes too long or too much memory.
"""

import dataclasses
import json
import os
import pathlib
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence

from tests.fuzz.execute import Outcome, execute

MEMORY_MB = 5000.0
"""Memory at which a command is ended [MiB]."""
IDLE_SECONDS = 1.0
"""A command that has used no more than this after its time on the clock waits for something."""
LIFE = 150
"""Commands after which a new process takes over: compiled code is never released."""


def serve() -> None:
    """Run the commands that come in by line, and answer each."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    import study.cli.entry  # noqa: F401  the wait before the first command

    print(json.dumps("ready"), file=answers, flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        os.chdir(order["cwd"])
        found = execute(order["argv"], order["stop"])
        print(json.dumps(dataclasses.asdict(found)), file=answers, flush=True)


class Worker:
    """Handle of such a process; a context manager."""

    def __init__(self, environment: dict[str, str] | None = None):
        self._environment = {**os.environ, "NPROC": "1", **(environment or {})}
        self._process: subprocess.Popen[bytes] | None = None
        self._done = 0

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def run(
        self, argv: Sequence[str], cwd: pathlib.Path, stop: Sequence[str], limit: float
    ) -> Outcome:
        """Run a command in a folder for at most some seconds of processor time.

        The machine may be shared: what counts is not the clock.
        """
        process = self._ready()
        order = {"argv": list(argv), "cwd": str(cwd), "stop": list(stop)}
        assert process.stdin is not None
        process.stdin.write(json.dumps(order).encode() + b"\n")
        process.stdin.flush()
        already = used(process.pid)
        start, peak, children = time.monotonic(), 0.0, 0.0
        self._done += 1
        while True:
            line = self._line(0.05 if time.monotonic() - start < 2.0 else 0.3)
            seconds = time.monotonic() - start
            if line:
                answer = json.loads(line)
                answer["peak_mb"] = max(answer["peak_mb"], children)
                return Outcome(**answer)
            own, below = family_mb(process.pid)
            peak, children = max(peak, own + below), max(children, below)
            status = ""
            if process.poll() is not None:
                status = "died"
            elif peak > MEMORY_MB:
                status = "memory"
            elif seconds > limit and not IDLE_SECONDS < used(process.pid) - already < limit:
                status = "timeout"
            if status:
                self._end()
                return Outcome(status, "", f"ended from outside: {status}", seconds, peak)

    def _line(self, seconds: float) -> bytes:
        assert self._process is not None
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], seconds)
        return self._process.stdout.readline() if ready else b""

    def _ready(self) -> subprocess.Popen[bytes]:
        if self._done >= LIFE or (self._process is not None and self._process.poll() is not None):
            self._end()
        if self._process is None:
            self._done = 0
            self._process = subprocess.Popen(
                [sys.executable, "-c", "from tests.fuzz.worker import serve; serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=self._environment,
                start_new_session=True,
            )
            if not self._line(600.0):
                raise RuntimeError("the process that runs the commands did not start")
        return self._process

    def _end(self) -> None:
        if self._process is None:
            return
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self._process.wait()
        self._process = None


def descent(pid: int) -> list[int]:
    """A process and its descendants."""
    found, waiting = [], [pid]
    while waiting:
        found.append(waiting.pop())
        try:
            for thread in pathlib.Path(f"/proc/{found[-1]}/task").iterdir():
                waiting += [int(x) for x in (thread / "children").read_text().split()]
        except (OSError, ValueError):
            continue
    return found


def used(pid: int) -> float:
    """Processor time of a process and its descendants [s]."""
    total = 0
    for process in descent(pid):
        try:
            text = pathlib.Path(f"/proc/{process}/stat").read_text()
        except OSError:
            continue
        total += sum(int(x) for x in text.rpartition(")")[2].split()[11:15])
    return total / os.sysconf("SC_CLK_TCK")


def family_mb(pid: int) -> tuple[float, float]:
    """Resident memory of a process and of its descendants [MiB]."""
    sizes = []
    for process in descent(pid):
        try:
            pages = int(pathlib.Path(f"/proc/{process}/statm").read_text().split()[1])
        except (OSError, IndexError, ValueError):
            pages = 0
        sizes.append(pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
    return sizes[0], sum(sizes[1:])
