"""A command in this process: its exit status, what it printed, how long it took, its memory."""

import contextlib
import dataclasses
import io
import os
import pathlib
import resource
import sys
import tempfile
from collections.abc import Iterator, Sequence

STARTED = "started"
LIMIT_OF_TEXT = 400_000
FRESH_MB = 350.0
"""Memory of a process that has imported everything."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a command.

    Attributes:
        status: exit status; `started` where it was stopped as it began to compute, `timeout`,
            `memory` or `died` where its process was ended.
        stdout: what it printed.
        stderr: what it said.
        seconds: of processor time that it took, its children included; the machine may be shared.
        peak_mb: largest memory that it would take in a process of its own [MiB]: what this one took
            more than before, and what a fresh one has; or the largest child.
    """

    status: int | str
    stdout: str
    stderr: str
    seconds: float
    peak_mb: float


class Started(BaseException):
    """The command has accepted its input and begins to compute."""


@contextlib.contextmanager
def stopping(steps: Sequence[str]) -> Iterator[None]:
    """Stop commands at steps whose names begin so."""
    import study.run.progress

    original = study.run.progress.Progress.step

    def step(self, name: str) -> None:
        if "*" in steps or name.startswith(tuple(steps)):
            raise Started(name)
        original(self, name)

    study.run.progress.Progress.step = step
    try:
        yield
    finally:
        study.run.progress.Progress.step = original


@contextlib.contextmanager
def captured() -> Iterator[tuple[pathlib.Path, pathlib.Path]]:
    """Standard output and error of the whole process, those of C++ too, go to two files."""
    with tempfile.TemporaryDirectory() as folder:
        paths = pathlib.Path(folder, "out"), pathlib.Path(folder, "err")
        sys.stdout.flush()
        sys.stderr.flush()
        kept = os.dup(1), os.dup(2)
        streams = sys.stdout, sys.stderr
        for number, path in zip((1, 2), paths, strict=True):
            target = os.open(path, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
            os.dup2(target, number)
            os.close(target)
        sys.stdout = io.TextIOWrapper(
            io.FileIO(1, "w", closefd=False), "utf-8", line_buffering=True
        )
        sys.stderr = io.TextIOWrapper(
            io.FileIO(2, "w", closefd=False), "utf-8", line_buffering=True
        )
        try:
            yield paths
        finally:
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):
                    stream.flush()
            sys.stdout, sys.stderr = streams
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)


def execute(argv: Sequence[str], stop: Sequence[str] = ()) -> Outcome:
    """Run a command of `jaxfsi` in this process."""
    from study.cli.entry import main

    _forget_peak()
    already = _memory_mb("VmRSS")
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    start = _processor_seconds()
    with captured() as (out, err):
        status: int | str
        try:
            with stopping(stop):
                status = main(list(argv))
        except Started:
            status = STARTED
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
        except BaseException:
            import traceback

            traceback.print_exc()
            status = "died"
        sys.stdout.flush()
        sys.stderr.flush()
        texts = [_text(path) for path in (out, err)]
    after = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    largest = _memory_mb("VmHWM")
    # a child counts what the process held that it was forked from, this one
    children = after / 1024 if after > before and after / 1024 > 1.05 * largest else 0.0
    own = largest - already + FRESH_MB
    return Outcome(status, *texts, _processor_seconds() - start, max(own, children))


def _text(path: pathlib.Path) -> str:
    with path.open("rb") as file:
        return file.read(LIMIT_OF_TEXT).decode("utf-8", "backslashreplace")


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        pathlib.Path("/proc/self/clear_refs").write_text("5")


def _memory_mb(name: str) -> float:
    with contextlib.suppress(OSError):
        for line in pathlib.Path("/proc/self/status").read_text().splitlines():
            if line.startswith(name):
                return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _processor_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)
