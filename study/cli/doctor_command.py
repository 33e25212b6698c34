"""The command `doctor`."""

import dataclasses
import importlib
from collections.abc import Callable, Iterator

from study.cli.command_output import Answer
from study.cli.request import DoctorOptions, Request
from study.run.health import Finding

_TRIALS = (
    ("study.run.health", "packages"),
    ("study.run.health", "machine"),
    ("study.run.health", "folders"),
    ("study.run.health", "locks"),
    ("study.run.health_trials", "compilation"),
    ("study.run.health_meshers", "meshers"),
)


def doctor_command(request: Request[DoctorOptions]) -> Answer:
    """Look at every part of the installation; one that cannot be looked at is a problem."""
    found: list[Finding] = []
    for module, name in _TRIALS:
        found += _looked(module, name)
    problems = [entry for entry in found if entry.problem]
    lines = [line for entry in found for line in _lines(entry, quiet=request.quiet)]
    count = len(problems)
    told = f"{count} problem{'s' if count != 1 else ''}" if count else "all is well"
    lines += [] if request.quiet else [told]
    document = {
        "kind": "doctor",
        "findings": [dataclasses.asdict(entry) for entry in found],
        "problems": count,
    }
    text = "".join(f"{line}\n" for line in lines)
    return Answer(document, [], text=text, status=1 if problems else 0)


def _looked(module: str, name: str) -> list[Finding]:
    try:
        look: Callable[[], Iterator[Finding]] = getattr(importlib.import_module(module), name)
        return list(look())
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        problem, cure = f"cannot be looked at: {reason}", "install jaxfsi again: pip install jaxfsi"
        return [Finding(name, "", problem, cure)]


def _lines(entry: Finding, *, quiet: bool) -> Iterator[str]:
    if entry.problem:
        found = f"{entry.found}; " if entry.found else ""
        yield f"!! {entry.name:<22}{found}{entry.problem}"
        yield f"   {'':<22}try: {entry.cure}"
    elif not quiet:
        yield f"   {entry.name:<22}{entry.found}"
