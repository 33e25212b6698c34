"""What a command gives back, and how it is told: results to files, words to the terminal."""

import contextlib
import logging
import pathlib
import sys
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

_TOLD = logging.getLogger("study.told")


class Answer(NamedTuple):
    """What a command found.

    Attributes:
        document: the result.
        written: the paths written, the document last.
        ending: raised once the result is told: why a run ended early.
        text: the result for the terminal; None: the summary of a document of its kind.
        status: exit status.
    """

    document: Mapping[str, Any]
    written: list[pathlib.Path]
    ending: BaseException | None = None
    text: str | None = None
    status: int = 0


def note(text: str) -> None:
    """Say a sentence to the user beside the result."""
    _TOLD.info("%s", text)


def complain(text: str) -> None:
    """Say why a command ends without a result."""
    _TOLD.error("%s", text)


def note_written(written: list[pathlib.Path]) -> None:
    """Say where the result lies."""
    for path in written:
        note(f"wrote {path}")


@contextlib.contextmanager
def told(*, quiet: bool) -> Iterator[None]:
    """Let sentences go to standard error; with `quiet` only complaints do."""
    terminal, before = _Terminal(logging.ERROR if quiet else logging.INFO), _TOLD.level
    _TOLD.setLevel(logging.INFO)
    _TOLD.addHandler(terminal)
    try:
        yield
    finally:
        _TOLD.removeHandler(terminal)
        _TOLD.setLevel(before)


class _Terminal(logging.Handler):
    """Standard error as it is when something is said; None where it was closed."""

    def emit(self, record: logging.LogRecord) -> None:
        if sys.stderr is not None:
            with contextlib.suppress(OSError, ValueError):
                print(record.getMessage(), file=sys.stderr, flush=True)
