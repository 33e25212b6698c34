"""Many cases side by side: each in a process of its own, and what became of them.

A case is a child process that runs `jaxfsi study` (mode `3d`) or `jaxfsi run` (mode `curve`) into a
folder of its own, on one core; it ends with the process that started it. Their results are kept
there: the same call goes on with those that are not finished. A case that fails says why and does
not stop the others.
"""

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.case.faults import CaseError
from study.case.read import read_case
from study.run.members import Member, MemberResult
from study.store.case_inputs import input_files
from study.store.options import Mode
from study.store.provenance import sha256
from study.store.result_files import RESULT_FILE, STUDY_FILE
from study.store.stages import stage_key
from study.store.stored_document import load_document

STATUS_FILE, LOG_FILE = "status.json", "log.txt"
CORE = "JAXFSI_CORE"
"""Environment variable that tells a child on which core to run."""

_CHILD = "study.cli.case_process"
_LOOK_SECONDS = 0.5
_INTERRUPTS = 30  # a second apart, before what still runs is killed
_NOT_BEGUN = 130


def member_key(member: Member, mode: Mode, extra: Sequence[str]) -> str:
    """Hash of the input files and options of a case."""
    files = [sha256(path) for path in input_files(read_case(member.path))]
    return stage_key("member", mode, tuple(extra), files)


def run_cohort(
    members: Sequence[Member],
    mode: Mode,
    *,
    extra: Sequence[str] = (),
    workers: int | None = None,
    expected: float = 60.0,
    tell: Callable[[str, float, float], None] | None = None,
) -> list[MemberResult]:
    """Run all cases that are not finished, some at a time.

    Args:
        members: the cases.
        mode: `curve` in 0D, `3d` the whole algorithm.
        extra: further options of the command of each case.
        workers: cases at a time; None: one a core.
        expected: seconds that a case usually takes.
        tell: told of what is at work, the share done and the seconds left.

    Returns:
        What became of each, in their order.

    Raises:
        KeyboardInterrupt: the user interrupted; what runs is ended and can be resumed.
    """
    cores = _cores()
    workers = max(1, workers or len(cores))
    known = {member.name: finished_member(member, mode, extra) for member in members}
    results = {name: result for name, result in known.items() if result is not None}
    shared = [cores[k % len(cores)] for k in range(workers)] if workers > 1 else []
    children = _Children(shared)
    begun, done = time.monotonic(), 0
    with ThreadPoolExecutor(workers) as pool:
        waiting = [member for member in members if member.name not in results]
        try:
            pending = {pool.submit(_run, member, mode, extra, children) for member in waiting}
            while pending:
                ended, pending = wait(pending, _LOOK_SECONDS, FIRST_COMPLETED)
                for result in (future.result() for future in ended):
                    results[result.member.name] = result
                done += len(ended)
                if tell is not None:
                    spent = time.monotonic() - begun
                    pace = spent / done if done else expected / workers
                    text = (
                        f"{len(results)} of {len(members)} cases done; at work: {children.names()}"
                    )
                    tell(text, len(results) / len(members), _left(pace, len(pending), spent, done))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            children.end()
            raise
    return [results[member.name] for member in members]


class _Children:
    """The processes at work; none begins once they are ended."""

    def __init__(self, cores: Sequence[int]):
        """Nothing is at work yet.

        Args:
            cores: one for each process that may be at work, given out in turn; none: any core.
        """
        self._lock, self._closed = threading.Lock(), False
        self._free = list(cores)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def names(self) -> str:
        """Names of the cases at work."""
        return ", ".join(list(self._running))

    def run(self, member: Member, arguments: Sequence[str]) -> int:
        """Run a case to its end; gives its exit status."""
        with self._lock:
            if self._closed:
                return _NOT_BEGUN
            core = self._free.pop(0) if self._free else None
            process = self._running[member.name] = _started(member, arguments, core)
        try:
            return process.wait()
        finally:
            with self._lock:
                del self._running[member.name]
                self._free += [] if core is None else [core]
            if process.stdin is not None:
                process.stdin.close()

    def end(self) -> None:
        """End all in order, after some time or a second interrupt at once."""
        with self._lock:
            self._closed = True
            running = list(self._running.values())
        try:
            _interrupt(running)
        finally:
            for process in running:
                if process.poll() is None:
                    process.kill()


def _run(member: Member, mode: Mode, extra: Sequence[str], children: _Children) -> MemberResult:
    start = time.monotonic()
    command = "study" if mode == "3d" else "run"
    arguments = [command, str(member.path), *extra, "--out", str(member.folder)]
    return _ended(member, mode, extra, children.run(member, arguments), start)


def _left(pace: float, cases: int, spent: float, done: int) -> float:
    """Seconds left: those of the cases, less what has passed since the last one ended."""
    return max(pace * cases - (spent - pace * done), 0.2 * pace)


def _cores() -> list[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def _started(member: Member, arguments: Sequence[str], core: int | None) -> subprocess.Popen[bytes]:
    member.folder.mkdir(parents=True, exist_ok=True)
    alone = {} if core is None else {CORE: str(core)}  # beside it runs another case
    (member.folder / LOG_FILE).unlink(missing_ok=True)  # an earlier result may hold it as well
    with (member.folder / LOG_FILE).open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-m", _CHILD, *arguments],
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.PIPE,
            env={**os.environ, **alone},
            start_new_session=True,
        )


def _interrupt(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Ask processes to end, more than once.

    Python drops an interrupt that reaches it in a callback, as one in four did during a child's
    imports.
    """
    for _ in range(_INTERRUPTS):
        alive = [process for process in processes if process.poll() is None]
        if not alive:
            break
        for process in alive:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            alive[-1].wait(1.0)


def _result_file(member: Member, mode: Mode) -> pathlib.Path:
    return member.folder / (STUDY_FILE if mode == "3d" else RESULT_FILE)


def finished_member(member: Member, mode: Mode, extra: Sequence[str]) -> MemberResult | None:
    """What became of a case before; None where it must be run."""
    try:
        status = json.loads(regular_text(member.folder / STATUS_FILE))
        if status["key"] != member_key(member, mode, extra) or status["status"] != 0:
            return None
        seconds = float(status["seconds"])
        document = load_document(_result_file(member, mode))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return MemberResult(member, 0, seconds, document, "", kept=True)


def _ended(
    member: Member, mode: Mode, extra: Sequence[str], status: int, start: float
) -> MemberResult:
    seconds = time.monotonic() - start
    document, reason = None, ""
    if status == 0:
        try:
            document = load_document(_result_file(member, mode))
        except CaseError as error:
            return MemberResult(member, 1, seconds, None, " ".join(str(error).split()))
        kept = {"key": member_key(member, mode, extra), "status": 0, "seconds": seconds}
        write_whole(member.folder / STATUS_FILE, json.dumps(kept))
    else:
        text = (member.folder / LOG_FILE).read_text(encoding="utf-8", errors="replace")
        lines = [line for line in text.splitlines() if line.strip()]
        reason = " ".join(lines[-3:])[-600:] or f"ended with status {status}"
    return MemberResult(member, status, seconds, document, reason)
