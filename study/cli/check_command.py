"""The command `check`."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from study.case.faults import Fault, printable, shown
from study.cli.command_output import Answer
from study.cli.request import CheckOptions, Request
from study.run.checked_file import CheckedFile, check_file

_FAULTY = 2


def check_command(request: Request[CheckOptions]) -> Answer:
    """Say what is wrong with each file, and what can be run with it."""
    found = [_sorted(check_file(path)) for path in dict.fromkeys(request.options.cases)]
    lines = [line for checked in found for line in _lines(checked, quiet=request.quiet)]
    document = {"kind": "check", "checked": [_entry(checked) for checked in found]}
    status = _FAULTY if any(checked.faults for checked in found) else 0
    return Answer(document, [], text="".join(f"{line}\n" for line in lines), status=status)


def _sorted(checked: CheckedFile) -> CheckedFile:
    """The faults in the order of their lines, those without one first."""
    ordered = sorted(checked.faults, key=lambda fault: (str(fault.file), fault.line or 0))
    return dataclasses.replace(checked, faults=ordered)


def _lines(checked: CheckedFile, *, quiet: bool) -> Iterator[str]:
    for fault in checked.faults:
        yield f"{fault.where}: {fault.what}; {fault.cure}"
    if quiet or checked.faults:
        return
    yield f"{printable(checked.file)}: a {checked.kind} without faults"
    for name, words in checked.parts.items():
        yield f"  {name + ':':<14}{words}"
    yield f"  {'can be run:':<14}{', '.join(checked.runs)}"
    for command, faults in checked.lacks.items():
        reasons = "; ".join(f"{fault.key}: {fault.problem}" for fault in faults)
        yield f"  cannot {command}: {reasons}"


def _entry(checked: CheckedFile) -> dict[str, Any]:
    return {
        "file": str(checked.file),
        "of": checked.kind,
        "faults": [_fault(fault) for fault in checked.faults],
        **({} if checked.faults else {"describes": checked.parts}),
        "runs": checked.runs,
        "lacks": {name: [_fault(fault) for fault in of] for name, of in checked.lacks.items()},
    }


def _fault(fault: Fault) -> dict[str, Any]:
    return {
        "file": str(fault.file),
        "line": fault.line,
        "key": fault.key,
        "value": None if fault.value is None else shown(fault.value),
        "problem": fault.problem,
        "allowed": fault.allowed,
        "cure": fault.cure,
    }
