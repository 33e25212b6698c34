"""`run.log` beside the results: what was done in a folder, line by line with its time.

Each command adds to it: command line, versions and machine, every step of its progress, notes,
warnings, and how it ended, a failure with its traceback. A command that is refused, or interrupted
before there is anything else in the folder, leaves no trace.
"""

import contextlib
import logging
import os
import pathlib
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

from study.case.faults import CaseError
from study.store.options import Options
from study.store.output import OutputRefused
from study.store.provenance import made_by
from study.store.result_files import HOLDER_FILE, LOCK_FILE, LOG_FILE

_LOG = logging.getLogger(__name__)
_ALL = logging.getLogger("study")
_FORMAT = logging.Formatter("%(asctime)s  %(message)s", "%Y-%m-%d %H:%M:%S%z")
_NOT_FOLLOWED = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


@contextlib.contextmanager
def run_log(folder: pathlib.Path, words: Sequence[str], options: Options) -> Iterator[None]:
    """Keep the log of a folder while a command is at work there.

    Args:
        folder: of the results, which this process holds the lock of.
        words: the command line.
        options: of the command.
    """
    path = folder / LOG_FILE
    before = path.stat().st_size if path.is_file() else None
    handler = _opened(path)
    if handler is None:
        yield
        return
    level, start = _ALL.level, time.monotonic()
    _ALL.setLevel(logging.INFO)
    _ALL.addHandler(handler)
    undo = False
    try:
        with _warnings_too():
            _begin(words, options)
            yield
        _LOG.info("ended after %.1f s", time.monotonic() - start)
    except (CaseError, OutputRefused):
        undo = True
        raise
    except KeyboardInterrupt as stop:
        undo = before is None and _alone(folder)
        _LOG.info("interrupted. %s", stop)
        raise
    except Exception:
        _LOG.info("failed after %.1f s\n%s", time.monotonic() - start, traceback.format_exc())
        raise
    finally:
        _ALL.removeHandler(handler)
        _ALL.setLevel(level)
        if undo:
            handler.cut(before or 0)
        handler.close()
        if undo and before is None:
            path.unlink(missing_ok=True)


def _begin(words: Sequence[str], options: Options) -> None:
    origin = made_by([], words, options)
    versions = ", ".join(f"{name} {found}" for name, found in origin.versions.items() if found)
    _LOG.info("%s", " ".join(origin.command))
    _LOG.info("in %s on %s", os.getcwd(), origin.platform)
    _LOG.info("%s; commit %s", versions, origin.commit or "not known")


def _alone(folder: pathlib.Path) -> bool:
    """Whether a folder holds nothing but log and lock."""
    own = {LOG_FILE, LOCK_FILE, HOLDER_FILE}
    return all(path.name in own for path in folder.iterdir())


@contextlib.contextmanager
def _warnings_too() -> Iterator[None]:
    """Let warnings of Python reach the log as well as standard error."""
    show = warnings.showwarning

    def both(message: Any, category: Any, filename: str, lineno: int, *more: Any) -> None:
        _LOG.warning("%s: %s (%s:%d)", category.__name__, message, filename, lineno)
        show(message, category, filename, lineno, *more)

    warnings.showwarning = both
    try:
        yield
    finally:
        warnings.showwarning = show


class _File(logging.Handler):
    """Lines at the end of an open file; what cannot be written costs no result."""

    def __init__(self, descriptor: int):
        logging.Handler.__init__(self)
        self.setFormatter(_FORMAT)
        self._descriptor = descriptor

    def emit(self, record: logging.LogRecord) -> None:
        with contextlib.suppress(OSError):
            os.write(self._descriptor, f"{self.format(record)}\n".encode(errors="replace"))

    def cut(self, size: int) -> None:
        """Take back what was written since the file had a size."""
        with contextlib.suppress(OSError):
            os.truncate(self._descriptor, size)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._descriptor)
        logging.Handler.close(self)


def _opened(path: pathlib.Path) -> _File | None:
    """The log; None where no regular file can be opened in its place."""
    if path.exists() and not path.is_file():
        return None
    try:
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | _NOT_FOLLOWED
        return _File(os.open(path, flags, 0o666))
    except OSError:
        return None
