"""Many cases side by side: each in a process of its own, and what became of them.

A case is a child process that runs `jaxfsi study` (mode `3d`) or `jaxfsi run` (mode `curve`) into a
folder of its own, on one core; it ends with the process that started it. Their results are kept
there: the same call goes on with those that are not finished. A case that fails says why and does
not stop the others.
"""

import contextlib
import dataclasses
import json
import os
import pathlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.case.faults import CaseError
from study.case.model import read_case
from study.run.members import Member
from study.store.options import Mode
from study.store.provenance import input_files, sha256
from study.store.result_files import RESULT_FILE, STUDY_FILE
from study.store.stages import stage_key
from study.store.stored_document import load_document

STATUS_FILE, LOG_FILE = "status.json", "log.txt"
CORE = "JAXFSI_CORE"
"""Environment variable that tells a child on which core to run."""

_PROGRAM = f"""
import os, signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
def leave():
    os.read(0, 1)  # ends with the process that started this one
    os._exit(130)
threading.Thread(target=leave, daemon=True).start()
core = os.environ.get("{CORE}", "")
if core and hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {{int(core)}})
from study.cli.entry import main
sys.exit(main())
"""
_LOOK_SECONDS = 0.5
_INTERRUPTS = 30  # a second apart, before what still runs is killed


@dataclasses.dataclass(frozen=True)
class Fate:
    """What became of a case.

    Attributes:
        member: the case.
        status: exit status of its command; 0 is done.
        seconds: that its last command took.
        document: its result; None where there is none.
        reason: why there is none.
        kept: whether an earlier command computed it.
    """

    member: Member
    status: int
    seconds: float
    document: dict[str, Any] | None
    reason: str
    kept: bool = False


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
) -> list[Fate]:
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
    fates: dict[str, Fate] = {}
    waiting: list[Member] = []
    for member in members:
        known = _finished(member, mode, extra)
        if known is None:
            waiting.append(member)
        else:
            fates[member.name] = known
    running: dict[str, tuple[Member, subprocess.Popen[bytes], float, int]] = {}
    begun, done = time.monotonic(), 0
    try:
        while waiting or running:
            free = [k for k in range(workers) if k not in {slot for *_, slot in running.values()}]
            while waiting and free:
                member, slot = waiting.pop(0), free.pop(0)
                core = cores[slot % len(cores)] if workers > 1 else None
                running[member.name] = (
                    member, _started(member, mode, extra, core), time.monotonic(), slot,
                )  # fmt: skip
            time.sleep(_LOOK_SECONDS)
            for name, (member, process, start, _) in list(running.items()):
                if process.poll() is None:
                    continue
                del running[name]
                _let_go(process)
                done += 1
                fates[name] = _ended(member, mode, extra, process.returncode, start)
            if tell is not None:
                left = len(waiting) + len(running)
                spent = time.monotonic() - begun
                pace = spent / done if done else expected / workers
                text = f"{len(fates)} of {len(members)} cases done; at work: {', '.join(running)}"
                tell(text, len(fates) / len(members), _left(pace, left, spent, done))
    except BaseException:
        _interrupt([process for _, process, _, _ in running.values()])
        raise
    return [fates[member.name] for member in members]


def _left(pace: float, cases: int, spent: float, done: int) -> float:
    """Seconds left: those of the cases, less what has passed since the last one ended."""
    return max(pace * cases - (spent - pace * done), 0.2 * pace)


def _cores() -> list[int]:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def _started(
    member: Member, mode: Mode, extra: Sequence[str], core: int | None
) -> subprocess.Popen[bytes]:
    member.folder.mkdir(parents=True, exist_ok=True)
    command = "study" if mode == "3d" else "run"
    arguments = [command, str(member.path), *extra, "--out", str(member.folder)]
    alone = {} if core is None else {CORE: str(core)}  # beside it runs another case
    (member.folder / LOG_FILE).unlink(missing_ok=True)  # an earlier result may hold it as well
    with (member.folder / LOG_FILE).open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *arguments],
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.PIPE,
            env={**os.environ, **alone},
            start_new_session=True,
        )


def _interrupt(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End processes in order, after some time at once.

    Asked more than once: Python drops an interrupt that reaches it in a callback, as one in
    four did during a child's imports.
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
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.wait()
        _let_go(process)


def _let_go(process: subprocess.Popen[bytes]) -> None:
    """Close what is held of a process that has ended."""
    if process.stdin is not None:
        process.stdin.close()


def _result_file(member: Member, mode: Mode) -> pathlib.Path:
    return member.folder / (STUDY_FILE if mode == "3d" else RESULT_FILE)


def _finished(member: Member, mode: Mode, extra: Sequence[str]) -> Fate | None:
    """What became of a case before; None where it must be run."""
    try:
        status = json.loads(regular_text(member.folder / STATUS_FILE))
        if status["key"] != member_key(member, mode, extra) or status["status"] != 0:
            return None
        seconds = float(status["seconds"])
        document = load_document(_result_file(member, mode))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return Fate(member, 0, seconds, document, "", kept=True)


def _ended(member: Member, mode: Mode, extra: Sequence[str], status: int, start: float) -> Fate:
    seconds = time.monotonic() - start
    document, reason = None, ""
    if status == 0:
        try:
            document = load_document(_result_file(member, mode))
        except CaseError as error:
            return Fate(member, 1, seconds, None, " ".join(str(error).split()))
        kept = {"key": member_key(member, mode, extra), "status": 0, "seconds": seconds}
        write_whole(member.folder / STATUS_FILE, json.dumps(kept))
    else:
        text = (member.folder / LOG_FILE).read_text(encoding="utf-8", errors="replace")
        lines = [line for line in text.splitlines() if line.strip()]
        reason = " ".join(lines[-3:])[-600:] or f"ended with status {status}"
    return Fate(member, status, seconds, document, reason)
