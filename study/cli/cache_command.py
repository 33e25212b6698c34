"""The command `cache`: what is kept between calls, counted or removed."""

import pathlib
import sys
from typing import Any

from study.cli.command_output import Answer, complain, note
from study.cli.request import CacheOptions, Request
from study.store.cache_contents import cache_contents, cache_problem, clear_cache, size_words
from study.store.cache_folder import VARIABLE, cache_folder
from study.store.output import OutputRefused

_NONE = f"no cache is kept: {VARIABLE} says so, or there is no home folder\n"


def cache_command(request: Request[CacheOptions]) -> Answer:
    """Count what is kept, or remove it.

    Raises:
        OutputRefused: nobody can be asked whether to remove it.
    """
    folder = cache_folder()
    if folder is None:
        return Answer({"kind": "cache", "folder": None}, [], text=_NONE)
    if request.options.action == "info":
        return _info(folder)
    return _clear(folder, request)


def _info(folder: pathlib.Path) -> Answer:
    found = cache_contents(folder)
    problem = cache_problem() if folder.exists() else None
    lines = [f"{folder}{'' if folder.exists() else ' (not made yet)'}"]
    lines += [
        f"  {kind:<24}{content.files:>7} files  {size_words(content.size)}"
        for kind, content in found.items()
    ]
    if problem is not None:
        lines.append(f"! {problem[0]}\n    try: {problem[1]}")
    document: dict[str, Any] = {
        "kind": "cache",
        "folder": str(folder),
        "contents": {
            kind: {"files": content.files, "bytes": content.size} for kind, content in found.items()
        },
        "problem": None if problem is None else problem[0],
    }
    return Answer(document, [], text="\n".join(lines) + "\n")


def _clear(folder: pathlib.Path, request: Request[CacheOptions]) -> Answer:
    found = cache_contents(folder)
    files = sum(content.files for content in found.values())
    size = size_words(sum(content.size for content in found.values()))
    document = {"kind": "cache", "folder": str(folder), "removed": 0}
    if files == 0:
        return Answer(document, [], text=f"{folder}: nothing to remove\n")
    asked = f"remove {files} files, {size}, from {folder}?"
    if not request.options.yes and not _agreed(asked, request):
        return Answer(document, [], text="nothing was removed\n")
    removed, failed = clear_cache(folder)
    for reason in failed:
        complain(f"could not be removed: {reason}")
    text = f"removed {removed} files, {size}, from {folder}\n"
    return Answer({**document, "removed": removed}, [], text=text, status=1 if failed else 0)


def _agreed(question: str, request: Request[CacheOptions]) -> bool:
    """Ask on the terminal."""
    if request.json or request.quiet or sys.stdin is None or not sys.stdin.isatty():
        raise OutputRefused(f"{question} Nobody can be asked here. Give --yes.")
    note(f"{question} [y/N]")
    return sys.stdin.readline().strip().lower() in ("y", "yes")
