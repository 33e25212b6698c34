"""The command of one case of a cohort as a function: wherever it is called, the case runs there.

The case is a child process that ends with the one that called, whose end of its standard input it
watches. What it finds lies in its folder, which caller and cohort share; the call gives its exit
status alone. A case that was ended, however, goes on there when it is called again.
"""

import contextlib
import dataclasses
import enum
import os
import pathlib
import signal
import subprocess
import sys
from collections.abc import Callable

CORE = "JAXFSI_CORE"
"""Environment variable that tells a child on which core to run."""

INTERRUPTED = 130

CHILD = "study.cli.case_process"
"""Module that runs `jaxfsi` as a child."""

_LOOK_SECONDS = 0.2
_AGAIN_SECONDS = 1.0
_INTERRUPTS = 30  # a second apart, before what still runs is killed


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
        module: run as a program with these arguments.
    """

    name: str
    arguments: tuple[str, ...]
    log: pathlib.Path
    module: str

    def __call__(self, core: int | None = None, wish: Callable[[], Wish] | None = None) -> int:
        """Run the case to its end.

        Args:
            core: to run on; None: any.
            wish: asked now and then what is wanted.

        Returns:
            Its exit status, or the negative number of the signal that ended it.
        """
        process = self._begun(core)
        try:
            return _waited(process, wish or _go_on)
        except BaseException:  # the caller is to end, as a job is before its time limit
            _waited(process, lambda: Wish.END)
            raise
        finally:
            if process.poll() is None:
                process.kill()
            if process.stdin is not None:
                process.stdin.close()

    def _begun(self, core: int | None) -> subprocess.Popen[bytes]:
        self.log.parent.mkdir(parents=True, exist_ok=True)
        alone = {} if core is None else {CORE: str(core)}  # beside it runs another case
        self.log.unlink(missing_ok=True)  # an earlier result may hold it as well
        with self.log.open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", self.module, *self.arguments],
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.PIPE,
                env={**os.environ, **alone},
                start_new_session=True,
            )


def _go_on() -> Wish:
    return Wish.RUN


def _waited(process: subprocess.Popen[bytes], wish: Callable[[], Wish]) -> int:
    """Wait for a process; where it is to end, ask it to, more than once.

    Python drops an interrupt that reaches it in a callback, as one in four did during a child's
    imports.
    """
    asked = 0
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(_AGAIN_SECONDS if asked else _LOOK_SECONDS)
        wanted = wish()
        if wanted is Wish.KILL or asked >= _INTERRUPTS:
            process.kill()
        elif wanted is Wish.END:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
            asked += 1


def cores() -> list[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
