"""A file that stands for a lock where the file system grants none.

It names host and process, and is made whole or not at all. One whose process is gone is recognised
on the same host and replaced; one of another host cannot be judged from here.
"""

import contextlib
import json
import os
import pathlib
import platform
import tempfile
import time
from typing import Any

from study.case.faults import CaseError, Fault

HOLDER_FILE = ".at-work.json"

BUSY = "another jaxfsi is at work in this folder"
WAIT = "wait until it ends, end it, or name another folder with --out"
_TRIES = 20


def lock_refusal(path: pathlib.Path, problem: str, cure: str) -> CaseError:
    """The refusal to work in a folder."""
    return CaseError([Fault(path, "", None, problem, "", cure)])


def hold(folder: pathlib.Path) -> pathlib.Path:
    """Put down who is at work in a folder; gives the file, which the holder removes at its end.

    Raises:
        CaseError: another process is at work there.
    """
    path = folder / HOLDER_FILE
    own = {**_this_process(), "since": time.strftime("%Y-%m-%d %H:%M:%S %z")}
    for _ in range(_TRIES):
        if _placed(path, json.dumps(own)):
            return path
        text = _text(path)
        if text is None:  # it has just gone
            continue
        holder = _parsed(text)
        if not _is_gone(holder):
            by = "process {process} on {host} since {since}".format_map(_Named(holder))
            raise lock_refusal(folder, f"{BUSY} ({by})", f"{WAIT}; if it has ended, remove {path}")
        _remove(path, text)
    raise lock_refusal(path, "changes again and again", "name another folder with --out")


class _Named(dict[str, Any]):
    """Parts of a holder; what is not there is unknown."""

    def __missing__(self, key: str) -> str:
        return "unknown"


def _this_process() -> dict[str, Any]:
    return {"host": platform.node(), "process": os.getpid(), "begun": _begun(os.getpid())}


def _begun(process: int) -> int | None:
    """When a process began, in ticks since the start of its host; None where that is not told."""
    try:
        text = pathlib.Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        return int(text.rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return None


def _is_gone(holder: dict[str, Any]) -> bool:
    """Whether the process of a holder is known to have ended."""
    process = holder.get("process")
    if os.name != "posix" or holder.get("host") != platform.node() or type(process) is not int:
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:
        return False
    begun = _begun(process)
    return begun is not None and holder.get("begun") not in (None, begun)


def _placed(path: pathlib.Path, text: str) -> bool:
    """Make a file with its content, unless there is one; a link at its place is none of ours."""
    handle, name = tempfile.mkstemp(prefix=f"{path.name}.", dir=path.parent)
    part = pathlib.Path(name)
    try:
        with open(handle, "w", encoding="utf-8") as file:
            file.write(text)
        try:
            os.link(part, path)
        except FileExistsError:
            return False
        except OSError:  # no hard links either
            return _made(path, text)
        return True
    finally:
        part.unlink(missing_ok=True)


def _made(path: pathlib.Path, text: str) -> bool:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        return False
    return True


def _text(path: pathlib.Path) -> str | None:
    """What a holder's file says; None where there is none."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        problem = "no regular file, where jaxfsi keeps the lock of its folder"
        raise lock_refusal(path, problem, "remove it, or name another folder with --out")
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None


def _parsed(text: str) -> dict[str, Any]:
    with contextlib.suppress(ValueError):
        found = json.loads(text)
        return found if isinstance(found, dict) else {}
    return {}


def _remove(path: pathlib.Path, text: str) -> None:
    """Remove the file of a process that is gone, and no other that has come in its place."""
    aside = path.with_name(f"{path.name}.{os.getpid()}")
    with contextlib.suppress(FileNotFoundError):
        os.replace(path, aside)
        if _text(aside) != text:
            with contextlib.suppress(OSError):
                os.link(aside, path)
        aside.unlink()
