"""What `--dry-run` prints: parts with their state, and where results would go."""

import pathlib
from collections.abc import Callable, Iterator
from typing import Any

from study.cli.command_output import Answer
from study.cli.request import Request
from study.run import dry_run
from study.run.dry_run import ANEW, BEGUN, DryPart
from study.run.expected_times import CASE_SECONDS
from study.store.case_inputs import provenance
from study.store.earlier_run import overwritten
from study.store.json_form import as_json
from study.store.result_files import shown_files


def dry_run_command(request: Request[Any], *given: Any) -> Answer:
    """Say what a command would do with the input that it was given.

    Raises:
        CaseError: the command would be refused.
    """
    folder: pathlib.Path = given[-1]
    parts = _PARTS[request.command](request, given)
    aside = _set_aside(request, given, folder)
    document = {
        "kind": "dry run",
        "command": request.command,
        "folder": str(folder),
        "parts": as_json(parts),
        "makes_way": aside,
    }
    text = "".join(f"{line}\n" for line in _lines(request, folder, parts, aside))
    return Answer(document, [], text=text)


_PARTS: dict[str, Callable[[Request[Any], tuple[Any, ...]], list[DryPart]]] = {
    "run": lambda r, given: dry_run.dry_run_of_case(r.options, given[0]),
    "simulate": lambda r, given: dry_run.dry_run_of_simulation(r.options, *given),
    "study": lambda r, given: dry_run.dry_run_of_study(r.options, *given),
    "cohort": lambda r, given: dry_run.dry_run_of_cohort(
        r.options, given[0], CASE_SECONDS[r.options.mode]
    ),
    "diagnose": lambda r, given: dry_run.dry_run_of_diagnosis(r.options, given[0], given[-1]),
}


def _set_aside(request: Request[Any], given: tuple[Any, ...], folder: pathlib.Path) -> list[str]:
    """Kinds of results that would make way."""
    if not folder.is_dir():
        return []
    kind, options = request.command, request.options
    document: dict[str, Any] = {"kind": kind}
    if kind in ("run", "simulate", "study"):
        document["provenance"] = as_json(provenance(given[0], request.words, options))
    names = shown_files(kind, {})
    found = [other for other, _ in overwritten(folder, document, names)]
    # inputs of the others are not named by one case: whether these stay, the command finds out
    return found if "provenance" in document else [other for other in found if other != kind]


def _lines(
    request: Request[Any], folder: pathlib.Path, parts: list[DryPart], aside: list[str]
) -> Iterator[str]:
    yield f"{request.command}: nothing is computed and nothing is written"
    yield f"  results go to {folder}{'' if folder.is_dir() else ', which will be created'}"
    for kind in aside:
        yield f"  the earlier result of {kind} there will be moved to a folder earlier-N"
    for part in parts:
        known = part.seconds is not None and part.state != dry_run.KEPT
        usual = f"  about {_span(part.seconds or 0.0)}" if known else ""
        yield f"  {part.state:<12}{part.name}{usual}"
    if any(part.state in (ANEW, BEGUN) and part.seconds for part in parts):
        yield "times are those of a usual machine with 2 cores; the first run on a machine also"
        yield "compiles, for one to four minutes"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
