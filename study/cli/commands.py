"""The commands: what each reads and where its body is, and how it ends.

Results go to files; a summary, or with `--json` one JSON object, goes to standard output;
everything else to standard error.

What a command computes with is imported once its input has been read: a refusal takes no second.
"""

import argparse
import importlib
import os
import pathlib
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from study.case.demo import demo_case_path, demo_cohort_path
from study.case.faults import CaseError
from study.case.model import read_case, require
from study.case.record import read_record, record_path
from study.case.record_template import EXAMPLE_FILE, RECORD_FILE, example_traces, record_template
from study.case.template import case_template
from study.cli.arguments import parse
from study.cli.command_output import Answer, note, note_written
from study.cli.entry import Signals
from study.report.summary import summary
from study.run.members import check_members, find_members
from study.store.cache_folder import use_cache
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
        options = parse(given)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else REFUSED
    options.command_line = ["jaxfsi", *given]
    try:
        _run(options, signals)
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


def _run(options: argparse.Namespace, signals: Signals) -> None:
    """Read the input, compute, write, tell."""
    if options.command == "template":
        return _template(options)
    command = _COMMANDS[options.command]
    given = command.read(options)
    answer = Answer(given[0], [])
    if options.command != "show" or options.out is not None:
        use_cache()
        body = getattr(importlib.import_module(command.module), command.name)
        signals.working()
        answer = body(options, *given)
    if options.json:
        files = {"files": [str(path) for path in answer.written]} if answer.written else {}
        print(to_json({**without_waveforms(dict(answer.document)), **files}), end="")
    else:
        print(summary(answer.document), end="")
    note_written(answer.written)
    if answer.ending is not None:
        raise answer.ending


def _case(options: argparse.Namespace) -> tuple[Any, ...]:
    """The case, and the checked folder for its results."""
    path = demo_case_path() if options.demo else options.case
    case = read_case(path)
    if options.command in ("mesh", "simulate", "study"):
        require(case, options.command)
    return case, check_folder(_folder(options, path))


def _folder(options: argparse.Namespace, case: pathlib.Path) -> pathlib.Path:
    """Where results go: as asked, else beside the case, and never into the package itself."""
    package = pathlib.Path(__file__).resolve().parents[1]
    if options.out is not None:
        folder = options.out
        if folder.resolve().is_relative_to(package):
            raise OutputRefused(
                f"{folder}: this is inside the package, where results would be lost. "
                "Name another folder: --out."
            )
        return folder
    if options.demo:
        return pathlib.Path("results")
    folder = case.parent / f"{case.stem}-results"
    return pathlib.Path(folder.name) if folder.resolve().is_relative_to(package) else folder


def _cohort(options: argparse.Namespace) -> tuple[Any, ...]:
    """The cases of a cohort, all read once, and the checked folder for its results."""
    if options.demo:
        options.folder = demo_cohort_path()
    beside = pathlib.Path(f"{options.folder.name}-results")
    fallback = pathlib.Path("results") if options.demo else options.folder.parent / beside
    folder = check_folder(options.out or fallback)
    members = find_members(options.folder, folder)
    check_members(members)
    return members, folder


def _record(options: argparse.Namespace) -> tuple[Any, ...]:
    """The record, what it lacks, and the checked folder for its results."""
    record, remarks = read_record(options.record, needs_data=options.command == "diagnose")
    place = record_path(options.record).resolve().parent
    folder = place.parent / f"{place.name}-results" if options.out is None else options.out
    return record, remarks, check_folder(folder)


def _stored(options: argparse.Namespace) -> tuple[Any, ...]:
    """A stored result."""
    document = load_document(options.result)
    readable(options.result, document, lambda: (summary(document), without_waveforms(document)))
    return (document,)


def _template(options: argparse.Namespace) -> None:
    files = {CASE_FILE: case_template()}
    if options.record:
        files = {EXAMPLE_FILE: example_traces(), RECORD_FILE: record_template()}
    text, written = list(files.values())[-1], []
    if options.out is not None:
        folder = check_folder(options.out)
        for name in files:
            if (folder / name).exists():
                raise OutputRefused(f"{folder / name}: exists already. Name another --out.")
        written = write_files(folder, files)
    if options.json:
        print(to_json({"template": text, "files": [str(path) for path in written]}), end="")
    elif not written:
        print(text, end="")
    note_written(written)


class _Command(NamedTuple):
    """How a command reads its input, and where its body is.

    Attributes:
        read: gives what the body takes after the options; refuses faulty input.
        module: the module of the body.
        name: of the body there.
    """

    read: Callable[[argparse.Namespace], tuple[Any, ...]]
    module: str
    name: str


_COMMANDS = {
    "run": _Command(_case, "study.cli.pipeline_commands", "run_command"),
    "calibrate": _Command(_case, "study.cli.pipeline_commands", "calibrate_command"),
    "sweep": _Command(_case, "study.cli.pipeline_commands", "sweep_command"),
    "mesh": _Command(_case, "study.cli.mesh_command", "mesh_command"),
    "simulate": _Command(_case, "study.cli.simulate_command", "simulate_command"),
    "study": _Command(_case, "study.cli.algorithm_command", "algorithm_command"),
    "cohort": _Command(_cohort, "study.cli.cohort_command", "cohort_command"),
    "diagnose": _Command(_record, "study.cli.record_command", "diagnose_command"),
    "plan-measurement": _Command(_record, "study.cli.record_command", "plan_command"),
    "show": _Command(_stored, "study.cli.show_command", "show_command"),
}
