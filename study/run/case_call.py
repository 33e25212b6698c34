"""The command of one case of a cohort as a function: wherever it is called, the case runs there.

The case runs in a child process that ends with the one that called, whose end of its standard input
it watches. What it finds lies in its folder, which caller and cohort share; the call gives its exit
status alone. A case that was ended, however, goes on there when it is called again.

A `CaseProcess` takes case after case: what one has imported and compiled serves the next. It reads
a case a line, `{"arguments": [...], "log": "..."}`, and answers each with its exit status and
whether it takes another one, `0 1`. The program of the child is `study.cli.case_process`.
"""

import contextlib
import dataclasses
import enum
import json
import os
import pathlib
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

CORE = "JAXFSI_CORE"
"""Environment variable that tells a child on which core to run."""

INTERRUPTED = 130

CHILD = "study.cli.case_process"
"""Module that runs `jaxfsi` as a child."""

_LOOK_SECONDS = 0.2
_AGAIN_SECONDS = 1.0
_INTERRUPTS = 30  # a second apart, before what still runs is killed
_LEAVE_SECONDS = 5.0


class CaseStopped(RuntimeError):
    """Somebody ended the case on purpose, as by scancel: it is not submitted again."""


class Wish(enum.Enum):
    """What is wanted of a case at work."""

    RUN = "go on"
    END = "end in order"
    KILL = "end at once"


@dataclasses.dataclass(frozen=True)
class CaseCall:
    """The command of a case.

    Attributes:
        name: of the case.
        arguments: of `jaxfsi`, paths absolute.
        log: file that its output goes to.
        module: the program that runs it.
    """

    name: str
    arguments: tuple[str, ...]
    log: pathlib.Path
    module: str

    def __call__(self) -> int:
        """Run the case to its end in a process of its own; see `CaseProcess.run`."""
        process = CaseProcess()
        try:
            return process.run(self)
        finally:
            process.end()


class CaseProcess:
    """A child process that takes case after case; one that has ended is followed by another."""

    def __init__(self, core: int | None = None):
        """No process runs yet.

        Args:
            core: to run on; None: any.
        """
        self._core = core
        self._child: _Child | None = None

    def run(self, call: CaseCall, wish: Callable[[], Wish] | None = None) -> int:
        """Run a case to its end.

        Args:
            call: the case.
            wish: asked now and then what is wanted.

        Returns:
            Its exit status, or the negative number of the signal that ended its process.
        """
        call.log.parent.mkdir(parents=True, exist_ok=True)
        call.log.unlink(missing_ok=True)  # an earlier result may hold it as well
        call.log.touch()
        if self._child is None or not self._child.takes(call):
            self.end()
            self._child = _Child(call, self._core)
        child = self._child
        try:
            child.begin(call)
            return child.ended(wish or _go_on)
        except BaseException:  # the caller is to end, as a job is before its time limit
            child.ended(lambda: Wish.END)
            self.end()
            raise

    def end(self) -> None:
        """End the process, which is at no case; nothing where none runs."""
        child, self._child = self._child, None
        if child is not None:
            child.leave()


class _Child:
    """A process and what it answers."""

    def __init__(self, call: CaseCall, core: int | None):
        alone = {} if core is None else {CORE: str(core)}  # beside it runs another case
        with call.log.open("ab") as log:  # for what goes wrong before the first case
            self._process = subprocess.Popen(
                [sys.executable, "-m", call.module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, **alone},
                start_new_session=True,
            )
        self._module, self._kept = call.module, True
        self._answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()

    def takes(self, call: CaseCall) -> bool:
        """Whether the process can run a case."""
        return self._kept and self._module == call.module and self._process.poll() is None

    def begin(self, call: CaseCall) -> None:
        """Hand a case over; a process that has gone is told of by its end."""
        line = json.dumps({"arguments": call.arguments, "log": str(call.log)})
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()

    def ended(self, wish: Callable[[], Wish]) -> int:
        """Wait for the end of a case; where it is to end, ask it to, more than once.

        Python drops an interrupt that reaches it in a callback, as one in four did during a child's
        imports.
        """
        asked = 0
        while True:
            with contextlib.suppress(queue.Empty):
                return self._status(
                    self._answers.get(timeout=_AGAIN_SECONDS if asked else _LOOK_SECONDS)
                )
            wanted = wish()
            if wanted is Wish.KILL or asked >= _INTERRUPTS:
                self._process.kill()
            elif wanted is Wish.END:
                with contextlib.suppress(ProcessLookupError):
                    self._process.send_signal(signal.SIGINT)
                asked += 1

    def leave(self) -> None:
        """End the process: it leaves where its input ends."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(_LEAVE_SECONDS)
        except BaseException as error:
            self._process.kill()
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            self._process.wait()

    def _status(self, answer: bytes) -> int:
        """Exit status of a case; without an answer that of the process, which did not finish it."""
        if not answer:
            self._kept = False
            self._answers.put(answer)  # there is no other one
            return self._process.wait() or 1
        status, kept = map(int, answer.split())
        self._kept = bool(kept)
        return status

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            for line in answers:
                self._answers.put(line)
        self._answers.put(b"")


def _go_on() -> Wish:
    return Wish.RUN


def cores() -> list[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
