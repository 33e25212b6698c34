"""The command `completion`: what a shell needs to complete commands and options, by `shtab`."""

import argparse
import importlib
import pathlib
from collections.abc import Iterator
from types import ModuleType

from study.cli.arguments import command_parser
from study.cli.command_output import Answer
from study.cli.request import CompletionOptions, Request

_FOLDERS = ("out", "folder", "beside")
"""Arguments that take folders alone."""


def completion_command(request: Request[CompletionOptions]) -> Answer:
    """Print the script for a shell."""
    shell = request.options.shell
    text = completion_script(shell)
    return Answer({"shell": shell, "script": text}, [], text=text)


def completion_script(shell: str) -> str:
    """The script for a shell, with the arguments of all commands.

    Raises:
        RuntimeError: `shtab` is not installed.
    """
    shtab = _library()
    parser = command_parser()
    for action in _actions(parser):
        if action.type is pathlib.Path:
            kind = shtab.DIRECTORY if action.dest in _FOLDERS else shtab.FILE
            setattr(action, "complete", kind)  # noqa: B010
    return shtab.complete(parser, shell)


def _library() -> ModuleType:
    try:
        return importlib.import_module("shtab")
    except ImportError:
        raise RuntimeError(
            "the package shtab is not installed, which makes the script.\n"
            "    try: pip install shtab"
        ) from None


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
