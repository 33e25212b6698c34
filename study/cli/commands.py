"""One command from its arguments to its exit status.

Results go to files; a summary, or with `--json` one JSON object, goes to standard output;
everything else to standard error. Little is imported before it is known what is asked for.
"""

import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from study.case.faults import CaseError
from study.cli.arguments import parse
from study.cli.command_output import complain, told
from study.cli.entry import Signals
from study.cli.request import Request
from study.store.output import OutputRefused

FAILED, REFUSED, INTERRUPTED = 1, 2, 130


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
    with told(quiet=request.quiet):
        return _ended(request, signals)


def _ended(request: Request[Any], signals: Signals) -> int:
    """Carry the command out; how it ended is said where it was not well."""
    try:
        return importlib.import_module("study.cli.dispatch").dispatch(request, signals)
    except (CaseError, OutputRefused) as refusal:
        complain(str(refusal))
        return REFUSED
    except BrokenPipeError:
        # The reader of the output has gone; a second complaint at exit would help nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt as stop:
        signals.deaf()
        complain(str(stop) or "interrupted; nothing was written")
        return INTERRUPTED
    except OSError as error:
        complain(f"the output could not be written: {_reason(error)}")
        complain("    try: another folder with --out, or free some space")
        return FAILED
    except Exception as error:
        if os.environ.get("JAXFSI_TRACEBACK"):
            raise
        complain(f"the computation failed: {error or type(error).__name__}")
        if not isinstance(error, ValueError | RuntimeError):
            complain("    try: run again with JAXFSI_TRACEBACK=1 to see where, and report it")
        return FAILED


def _reason(error: OSError) -> str:
    """What the system said, without its number."""
    if error.strerror is None:
        return str(error)
    place = error.filename2 or error.filename
    return f"{place}: {error.strerror}" if place else error.strerror
