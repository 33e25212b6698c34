"""From a request to what is printed: each command reads, computes, and is told.

What a command computes with is imported once its input has been read: a refusal takes no second.
"""

import importlib
import sys
from typing import Any, NamedTuple

from study.cli.command_output import Answer, note_written
from study.cli.entry import Signals
from study.cli.request import Request
from study.report.summary import summary
from study.store.cache_folder import use_cache
from study.store.stored_document import to_json, without_waveforms


class _Command(NamedTuple):
    """Where a command is.

    Attributes:
        module: of `study.cli`, with the body, which takes the request and what was read.
        name: of the body.
        read: function of `study.cli.inputs` that reads the input; empty: there is none.
        computes: whether it is worth a compilation cache, and may be ended in order.
    """

    module: str
    name: str
    read: str = ""
    computes: bool = False


_COMMANDS = {
    "run": _Command("pipeline_commands", "run_command", "case_input", True),
    "calibrate": _Command("pipeline_commands", "calibrate_command", "case_input", True),
    "calibrate-wall": _Command("wall_command", "wall_command", "case_input", True),
    "sweep": _Command("pipeline_commands", "sweep_command", "case_input", True),
    "mesh": _Command("mesh_command", "mesh_command", "case_input", True),
    "simulate": _Command("simulate_command", "simulate_command", "case_input", True),
    "study": _Command("algorithm_command", "algorithm_command", "case_input", True),
    "what-if": _Command("what_if_command", "what_if_command", "case_input", True),
    "cohort": _Command("cohort_command", "cohort_command", "cohort_input", True),
    "diagnose": _Command("record_command", "diagnose_command", "record_input", True),
    "plan-measurement": _Command("record_command", "plan_command", "record_input", True),
    "import-record": _Command("import_command", "import_command", "catheter_input", True),
    "show": _Command("show_command", "show_command", "stored_input"),
    "template": _Command("template_command", "template_command"),
    "check": _Command("check_command", "check_command"),
    "doctor": _Command("doctor_command", "doctor_command"),
    "cache": _Command("cache_command", "cache_command"),
    "completion": _Command("completion_command", "completion_command"),
}
_SCHEMA = _Command("template_command", "schema_command")
_DRY_RUN = _Command("dry_run_command", "dry_run_command")


def dispatch(request: Request[Any], signals: Signals) -> int:
    """Carry out a command and print its answer.

    Args:
        request: the command.
        signals: told when there is work to be ended in order.

    Returns:
        The exit status.

    Raises:
        CaseError: the input was refused.
        OutputRefused: the output folder cannot be used.
    """
    command = _command(request)
    answer = _answer(request, command, signals)
    if request.json:
        shown = dict(answer.document)
        shown = shown if answer.text is not None else without_waveforms(shown)
        files = {"files": [str(path) for path in answer.written]} if answer.written else {}
        print(to_json({**shown, **files}), end="")
    elif answer.text is not None:
        print(answer.text, end="")
    elif not (request.quiet and command.computes):
        print(summary(answer.document), end="")
    if sys.stdout is not None:
        sys.stdout.flush()  # a reader that has gone, or a full disk, is told of now
    note_written(answer.written)
    if answer.ending is not None:
        raise answer.ending
    return answer.status


def _command(request: Request[Any]) -> _Command:
    if request.command == "show" and request.options.schema is not None:
        return _SCHEMA
    command = _COMMANDS[request.command]
    return _DRY_RUN._replace(read=command.read) if request.dry_run else command


def _answer(request: Request[Any], command: _Command, signals: Signals) -> Answer:
    given: tuple[Any, ...] = ()
    if command.read:
        inputs = importlib.import_module("study.cli.inputs")
        given = getattr(inputs, command.read)(request)
    if command is _COMMANDS["show"] and request.out is None:
        return Answer(given[0], [])
    if command.computes or command is _COMMANDS["show"]:
        use_cache()
    body = getattr(importlib.import_module(f"study.cli.{command.module}"), command.name)
    if command.computes or command is _COMMANDS["show"]:
        signals.working()
    return body(request, *given)
