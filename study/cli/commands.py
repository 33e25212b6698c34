"""The commands: what each reads and where its body is, and how it ends.

Results go to files; a summary, or with `--json` one JSON object, goes to standard output;
everything else to standard error.

What a command computes with is imported once its input has been read: a refusal takes no second.
"""

import importlib
import os
import pathlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from study.case import json_schema
from study.case.catheter.columns import ExportFormat
from study.case.catheter.exports import read_exports
from study.case.demo import demo_cohort_path
from study.case.faults import CaseError
from study.case.model import require
from study.case.read import read_case, read_cases
from study.case.record import OLDER, read_record, record_path
from study.case.template import (
    EXAMPLE_FILE,
    RECORD_FILE,
    case_template,
    example_traces,
    record_template,
)
from study.cli.arguments import parse
from study.cli.command_output import Answer, note, note_written
from study.cli.entry import Signals
from study.cli.request import ImportOptions, Request, ShowOptions, TemplateOptions
from study.report.documents import schema_text
from study.report.summary import summary
from study.run.members import find_members
from study.store.cache_folder import use_cache
from study.store.options import CaseOptions, CohortOptions, RecordOptions, case_path
from study.store.output import OutputRefused, check_folder, write_files
from study.store.stored_document import load_document, readable, to_json, without_waveforms

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130

CASE_FILE = "case.toml"


def run(argv: Sequence[str] | None, signals: Signals) -> int:
    """Run one command.

    Args:
        argv: arguments without the program's name; by default those of the process.
        signals: told when there is work to be ended in order, and when it has ended.

    Returns:
        The exit status.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        request = parse(given)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else REFUSED
    try:
        _run(request, signals)
    except (CaseError, OutputRefused) as refusal:
        note(str(refusal))
        return REFUSED
    except BrokenPipeError:
        # The reader of the output has gone; a second complaint at exit would help nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt as stop:
        signals.deaf()
        note(str(stop) or "interrupted; nothing was written")
        return INTERRUPTED
    except OSError as error:
        note(f"the output could not be written: {_reason(error)}")
        note("    try: another folder with --out, or free some space")
        return FAILED
    except Exception as error:
        if os.environ.get("JAXFSI_TRACEBACK"):
            raise
        note(f"the computation failed: {error or type(error).__name__}")
        if not isinstance(error, ValueError | RuntimeError):
            note("    try: again with JAXFSI_TRACEBACK=1 for the place, and report it")
        return FAILED
    return DONE


def _reason(error: OSError) -> str:
    """What the system said, without its number."""
    if error.strerror is None:
        return str(error)
    place = error.filename2 or error.filename
    return f"{place}: {error.strerror}" if place else error.strerror


def _run(request: Request[Any], signals: Signals) -> None:
    """Read the input, compute, write, tell."""
    if request.command == "template":
        return _template(request)
    if request.command == "show" and request.options.schema is not None:
        return _schema(request)
    command = _COMMANDS[request.command]
    given = command.read(request)
    answer = Answer(given[0], [])
    if request.command != "show" or request.out is not None:
        use_cache()
        body = getattr(importlib.import_module(command.module), command.name)
        signals.working()
        answer = body(request, *given)
    if request.json:
        files = {"files": [str(path) for path in answer.written]} if answer.written else {}
        print(to_json({**without_waveforms(dict(answer.document)), **files}), end="")
    else:
        print(summary(answer.document), end="")
    note_written(answer.written)
    if answer.ending is not None:
        raise answer.ending


def _case(request: Request[CaseOptions]) -> tuple[Any, ...]:
    """The case, and the checked folder for its results."""
    path = case_path(request.options)
    case = read_case(path)
    if request.command in ("calibrate-wall", "mesh", "simulate", "study"):
        require(case, request.command)
    return case, check_folder(_folder(request, path))


def _folder(request: Request[CaseOptions], case: pathlib.Path) -> pathlib.Path:
    """Where results go: as asked, else beside the case, and never into the package itself."""
    package = pathlib.Path(__file__).resolve().parents[1]
    if request.out is not None:
        folder = request.out
        if folder.resolve().is_relative_to(package):
            raise OutputRefused(
                f"{folder}: this is inside the package, where results would be lost. "
                "Name another folder: --out."
            )
        return folder
    if request.options.demo:
        return pathlib.Path("results")
    folder = case.parent / f"{case.stem}-results"
    return pathlib.Path(folder.name) if folder.resolve().is_relative_to(package) else folder


def _cohort(request: Request[CohortOptions]) -> tuple[Any, ...]:
    """The cases of a cohort, what each holds, and the checked folder for its results."""
    place = request.options.folder or demo_cohort_path()
    beside = pathlib.Path(f"{place.name}-results")
    fallback = pathlib.Path("results") if request.options.demo else place.parent / beside
    folder = check_folder(request.out or fallback)
    members = find_members(place, folder)
    cases = read_cases(member.path for member in members)
    return members, {m.name: c for m, c in zip(members, cases, strict=True)}, folder


def _record(request: Request[RecordOptions]) -> tuple[Any, ...]:
    """The record, what it lacks, and the checked folder for its results."""
    given = request.options.record
    record, remarks = read_record(given, needs_data=request.command == "diagnose")
    for remark in remarks:
        if remark.startswith(OLDER):
            note(remark)
    place = record_path(given).resolve().parent
    folder = place.parent / f"{place.name}-results" if request.out is None else request.out
    return record, remarks, check_folder(folder)


def _catheter(request: Request[ImportOptions]) -> tuple[Any, ...]:
    """The catheter files with their beats, and the checked folder for the record."""
    options = request.options
    given = ExportFormat(options.columns or {}, options.unit, options.time_unit, options.rate)
    spans = {name: (low, high) for name, low, high in options.span or ()}
    found = read_exports(options.files, given, spans, options.id)
    folder = request.out or found.folder / f"{found.patient}-record"
    if (folder / RECORD_FILE).exists():
        raise OutputRefused(f"{folder / RECORD_FILE}: exists already. Name another --out.")
    return found, check_folder(folder)


def _stored(request: Request[ShowOptions]) -> tuple[Any, ...]:
    """A stored result."""
    result = request.options.result
    assert result is not None, "else a schema is shown"
    if request.options.beside and request.out is None:
        raise OutputRefused("--beside is for the page that --out writes. Give --out, or leave it.")
    document = load_document(result)
    readable(result, document, lambda: (summary(document), without_waveforms(document)))
    return (document,)


def _template(request: Request[TemplateOptions]) -> None:
    files = {CASE_FILE: case_template()}
    if request.options.record:
        files = {EXAMPLE_FILE: example_traces(), RECORD_FILE: record_template()}
    if request.options.schema:
        kind = "record" if request.options.record else "case"
        files = {f"{kind}.schema.json": json_schema.schema_text(kind)}
    text, written = list(files.values())[-1], _new_files(request.out, files)
    if request.json:
        print(to_json({"template": text, "files": [str(path) for path in written]}), end="")
    elif not written:
        print(text, end="")
    note_written(written)


def _schema(request: Request[ShowOptions]) -> None:
    kind = request.options.schema
    assert kind is not None, "else a result is shown"
    text = schema_text(kind)
    written = _new_files(request.out, {f"{kind}.schema.json": text})
    if request.json or not written:
        print(text, end="")
    note_written(written)


def _new_files(out: pathlib.Path | None, files: Mapping[str, str]) -> list[pathlib.Path]:
    """Write texts into a folder, if one is given; a file that is there already is refused."""
    if out is None:
        return []
    folder = check_folder(out)
    for name in files:
        if (folder / name).exists():
            raise OutputRefused(f"{folder / name}: exists already. Name another --out.")
    return write_files(folder, files)


class _Command(NamedTuple):
    """How a command reads its input, and where its body is.

    Attributes:
        read: gives what the body takes after the options; refuses faulty input.
        module: the module of the body.
        name: of the body there.
    """

    read: Callable[[Request[Any]], tuple[Any, ...]]
    module: str
    name: str


_COMMANDS = {
    "run": _Command(_case, "study.cli.pipeline_commands", "run_command"),
    "calibrate": _Command(_case, "study.cli.pipeline_commands", "calibrate_command"),
    "calibrate-wall": _Command(_case, "study.cli.wall_command", "wall_command"),
    "sweep": _Command(_case, "study.cli.pipeline_commands", "sweep_command"),
    "mesh": _Command(_case, "study.cli.mesh_command", "mesh_command"),
    "simulate": _Command(_case, "study.cli.simulate_command", "simulate_command"),
    "study": _Command(_case, "study.cli.algorithm_command", "algorithm_command"),
    "cohort": _Command(_cohort, "study.cli.cohort_command", "cohort_command"),
    "diagnose": _Command(_record, "study.cli.record_command", "diagnose_command"),
    "plan-measurement": _Command(_record, "study.cli.record_command", "plan_command"),
    "import-record": _Command(_catheter, "study.cli.import_command", "import_command"),
    "show": _Command(_stored, "study.cli.show_command", "show_command"),
}
