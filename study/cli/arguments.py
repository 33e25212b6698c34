"""The parser of the command line: commands, their common options, and what they parse to.

Only the arguments of the command that was named are made ready: the help of all takes no time.
"""

import argparse
import importlib
import pathlib
from collections.abc import Sequence
from typing import Any

from study.cli.command_names import ON_CASES, ON_RECORDS, PLANNED, WITHOUT_FOLDER
from study.cli.help_texts import DESCRIPTION, EPILOG, HELP
from study.cli.request import Request
from study.store.options import Options

_ARGUMENTS = "study.cli.command_arguments"


def parse(argv: Sequence[str]) -> Request[Options]:
    """Parse the arguments of one command.

    Args:
        argv: arguments without the program's name.

    Returns:
        The command with its options.

    Raises:
        SystemExit: help was asked for (0), or the arguments make no sense (2).
    """
    given = list(argv)
    rest: list[str] | None = None
    if "--" in given and given[:1] == ["cohort"]:
        at = given.index("--")
        given, rest = given[:at], given[at + 1 :]
    named = tuple(word for word in given if word in HELP)[:1]
    found = vars(command_parser(named).parse_args(given))
    values: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in found.items()}
    values["options"] = None if rest is None else tuple(rest)
    options = importlib.import_module(_ARGUMENTS).OPTIONS[values["command"]].of(values)
    return Request(
        values["command"],
        options,
        ("jaxfsi", *argv),
        values.get("out"),
        values["json"],
        values["quiet"],
        values.get("dry_run", False),
    )


def command_parser(named: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """Parser of the command line; the reference page is made from it.

    Args:
        named: commands whose arguments are needed; None: those of all.
    """
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        "jaxfsi", description=DESCRIPTION, epilog=EPILOG, formatter_class=raw
    )
    parser.add_argument("--version", action=_Version, help="print version and commit, and end")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (help_, epilog) in HELP.items():
        command = commands.add_parser(
            name,
            help=help_,
            description=f"{help_[0].upper()}{help_[1:]}.",
            epilog=epilog,
            formatter_class=raw,
        )
        if named is None or name in named:
            importlib.import_module(_ARGUMENTS).add_arguments(name, command)
            _common_arguments(name, command)
    return parser


def _common_arguments(name: str, command: argparse.ArgumentParser) -> None:
    """Add what commands have in common, last in the help."""
    where = "folder for the output"
    if name in ON_CASES:
        where += " (default: CASE-results beside the case; ./results for --demo)"
    if name in ON_RECORDS:
        where += " (default: RECORD-results beside the record)"
    if name == "import-record":
        where += " (default: ID-record beside the first file)"
    if name not in WITHOUT_FOLDER:
        command.add_argument("--out", type=pathlib.Path, metavar="DIR", help=where)
    if name in PLANNED:
        told = "say what would be computed, what is kept and where results go; write nothing"
        command.add_argument("--dry-run", action="store_true", help=told)
    command.add_argument("--json", action="store_true", help="print one JSON object, only")
    command.add_argument("--quiet", action="store_true", help="print nothing but what is wrong")


class _Version(argparse.Action):
    """Prints version and commit, which are looked up only when they are asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, **kwargs: Any):
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **kwargs)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        provenance = importlib.import_module("study.store.provenance")
        version = provenance.installed("jaxfsi")
        commit = provenance.commit()
        print(f"jaxfsi {version or 'not installed'}{f', commit {commit}' if commit else ''}")
        parser.exit()
