"""Many cases side by side: each in a process of its own, and what became of them.

A case is a child process that runs `jaxfsi study` (mode `3d`) or `jaxfsi run` (mode `curve`) into a
folder of its own; `study.run.executors` says where. Their results are kept there: the same call
goes on with those that are not finished. A case that fails says why and does not stop the others.
"""

import contextlib
import dataclasses
import json
import logging
import pathlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait

from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.case.faults import CaseError
from study.case.read import read_case
from study.run import case_call as case_process
from study.run.case_call import INTERRUPTED, CaseCall, CaseStopped, cores
from study.run.executors import LocalProcesses, at_work_on
from study.run.members import Member, MemberResult
from study.store.case_inputs import input_files
from study.store.options import Mode
from study.store.provenance import sha256
from study.store.result_files import RESULT_FILE, STUDY_FILE
from study.store.stages import stage_key
from study.store.stored_document import load_document

STATUS_FILE, LOG_FILE = "status.json", "log.txt"

MOST_AGAIN = 3
"""How often a case is submitted again that was lost on the way."""

UNFINISHED = -1
"""Status of a case that no command has brought to its end."""

_LOOK_SECONDS = 0.5
_LOG = logging.getLogger(__name__)


def member_key(member: Member, mode: Mode, extra: Sequence[str]) -> str:
    """Hash of the input files and options of a case."""
    files = [sha256(path) for path in input_files(read_case(member.path))]
    return stage_key("member", mode, tuple(extra), files)


def run_cohort(
    members: Sequence[Member],
    mode: Mode,
    *,
    extra: Sequence[str] = (),
    executor: Executor | None = None,
    workers: int | None = None,
    expected: float = 60.0,
    tell: Callable[[str, float, float], None] | None = None,
) -> list[MemberResult]:
    """Run all cases that are not finished.

    A case whose process or machine was lost on the way is submitted again, `MOST_AGAIN` times at
    most, and goes on where it was.

    Args:
        members: the cases.
        mode: `curve` in 0D, `3d` the whole algorithm.
        extra: further options of the command of each case.
        executor: where they run; shut down at the end. None: processes of this machine.
        workers: cases at a time, where no executor says so; None: one a core.
        expected: seconds that a case usually takes.
        tell: told of what is at work, the share done and the seconds left.

    Returns:
        What became of each, in their order.

    Raises:
        KeyboardInterrupt: the user interrupted; what runs is ended and can be resumed. It says how
            many cases are finished.
    """
    at_a_time = max(1, workers or len(cores()))
    keys = {member.name: _key(member, mode, extra) for member in members}
    known = {member.name: _kept(member, mode, keys[member.name]) for member in members}
    results = {name: result for name, result in known.items() if result is not None}
    begun, done = time.monotonic(), 0
    at = executor or LocalProcesses(workers)
    with _kept_said(results, len(members)), at_work_on(at) as place:
        pending: dict[Future[int], _Submitted] = {}
        for member in members:
            if member.name not in results:
                _submit(place, pending, _Submitted(member, case_call(member, mode, extra)))
        while pending:
            looked = time.monotonic()
            for future, case in pending.items():
                if case.begun is None and future.running():
                    pending[future] = dataclasses.replace(case, begun=looked)
            for future in wait(pending, _LOOK_SECONDS, FIRST_COMPLETED).done:
                case = pending.pop(future)
                status, reason = _outcome(future)
                if reason and case.times <= MOST_AGAIN:
                    _submit(place, pending, case.again())
                    continue
                start = looked if case.begun is None else case.begun
                name = case.member.name
                results[name] = _ended(case.member, mode, keys[name], status, start, reason)
                done += 1
            if tell is not None:
                spent = time.monotonic() - begun
                pace = spent / done if done else expected / at_a_time
                left = _left(pace, len(pending), spent, done)
                tell(_told(results, members, pending), len(results) / len(members), left)
    return [results[member.name] for member in members]


@contextlib.contextmanager
def _kept_said(results: Mapping[str, MemberResult], cases: int) -> Iterator[None]:
    """An interrupt says what is kept."""
    try:
        yield
    except KeyboardInterrupt as stop:
        kept = f"{len(results)} of {cases} cases are finished and kept"
        why = f"interrupted; {kept}. Run the same command again to resume"
        raise KeyboardInterrupt(str(stop) or why) from None


def gathered(members: Sequence[Member], mode: Mode, extra: Sequence[str]) -> list[MemberResult]:
    """What became of each case so far; none is run.

    Args:
        members: the cases.
        mode: `curve` in 0D, `3d` the whole algorithm.
        extra: further options of the command of each case.
    """
    found = [finished_member(member, mode, extra) for member in members]
    return [
        result or MemberResult(member, UNFINISHED, 0.0, None, _unfinished(member))
        for member, result in zip(members, found, strict=True)
    ]


def case_call(member: Member, mode: Mode, extra: Sequence[str]) -> CaseCall:
    """The command of a case.

    Args:
        member: the case.
        mode: `curve` in 0D, `3d` the whole algorithm.
        extra: further options of the command.
    """
    command = "study" if mode == "3d" else "run"
    path, folder = member.path.absolute(), member.folder.absolute()
    arguments = (command, str(path), *extra, "--out", str(folder))
    return CaseCall(member.name, arguments, folder / LOG_FILE, case_process.CHILD)


@dataclasses.dataclass(frozen=True)
class _Submitted:
    """A case that was submitted.

    Attributes:
        member: the case.
        call: its command.
        times: how often it was submitted.
        begun: when it was first seen at work [s]; None: it waits.
    """

    member: Member
    call: CaseCall
    times: int = 1
    begun: float | None = None

    def again(self) -> "_Submitted":
        """The case, submitted once more."""
        _LOG.info("case %s was lost on the way: it is submitted again", self.member.name)
        return dataclasses.replace(self, times=self.times + 1)


def _submit(place: Executor, pending: dict[Future[int], _Submitted], case: _Submitted) -> None:
    pending[place.submit(case.call)] = case


def _outcome(future: Future[int]) -> tuple[int, str]:
    """Exit status of a case, and why it was lost on the way; empty where it came to an end."""
    try:
        status = future.result()
    except (Exception, CancelledError) as error:
        if isinstance(error, CaseStopped):
            return INTERRUPTED, ""
        return 1, " ".join(f"{type(error).__name__}: {error}".split())[:300]
    if status < 0:
        return status, f"ended by signal {-status}"
    return status, "interrupted" if status == INTERRUPTED else ""


def _told(
    results: Mapping[str, MemberResult],
    members: Sequence[Member],
    pending: Mapping[Future[int], _Submitted],
) -> str:
    names = [case.member.name for future, case in pending.items() if future.running()]
    count = f"{len(results)} of {len(members)} cases done"
    return (
        f"{count}; at work: {', '.join(names)}" if names else f"{count}; {len(pending)} submitted"
    )


def _left(pace: float, cases: int, spent: float, done: int) -> float:
    """Seconds left: those of the cases, less what has passed since the last one ended."""
    return max(pace * cases - (spent - pace * done), 0.2 * pace)


def _result_file(member: Member, mode: Mode) -> pathlib.Path:
    return member.folder / (STUDY_FILE if mode == "3d" else RESULT_FILE)


def finished_member(member: Member, mode: Mode, extra: Sequence[str]) -> MemberResult | None:
    """What became of a case before; None where it must be run."""
    return _kept(member, mode, _key(member, mode, extra))


def _key(member: Member, mode: Mode, extra: Sequence[str]) -> str | None:
    """Its `member_key`; None where the case cannot be read, which its own process will say."""
    try:
        return member_key(member, mode, extra)
    except (OSError, ValueError):
        return None


def _kept(member: Member, mode: Mode, key: str | None) -> MemberResult | None:
    try:
        status = json.loads(regular_text(member.folder / STATUS_FILE))
        if key is None or status["key"] != key or status["status"] != 0:
            return None
        seconds = float(status["seconds"])
        document = load_document(_result_file(member, mode))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return MemberResult(member, 0, seconds, document, "", kept=True)


def _ended(
    member: Member,
    mode: Mode,
    key: str | None,
    status: int,
    start: float,
    lost: str = "",
) -> MemberResult:
    """What became of a case; `key` is that of its input before it began, which may change."""
    seconds = time.monotonic() - start
    document, reason = None, ""
    if status == 0:
        try:
            document = load_document(_result_file(member, mode))
        except CaseError as error:
            return MemberResult(member, 1, seconds, None, " ".join(str(error).split()))
        kept = {"key": key, "status": 0, "seconds": seconds}
        write_whole(member.folder / STATUS_FILE, json.dumps(kept))
    elif lost:
        again = f"submitted {MOST_AGAIN + 1} times and lost each time"
        reason = f"{again}: {lost}. {_last_lines(member)}".strip()
    else:
        reason = _last_lines(member) or f"ended with status {status}"
    return MemberResult(member, status, seconds, document, reason)


def _unfinished(member: Member) -> str:
    return f"not finished. {_last_lines(member)}".strip()


def _last_lines(member: Member) -> str:
    """The end of what a case said; empty where it has said nothing."""
    try:
        text = (member.folder / LOG_FILE).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    lines = [line for line in text.splitlines() if line.strip()]
    return " ".join(lines[-3:])[-600:]
