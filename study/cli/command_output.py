"""What a command gives back, and how it is told: results to files, words to the terminal."""

import pathlib
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple


class Answer(NamedTuple):
    """What a command found.

    Attributes:
        document: the result.
        written: the paths written, the document last.
        ending: raised once the result is told: why a run ended early.
    """

    document: Mapping[str, Any]
    written: list[pathlib.Path]
    ending: BaseException | None = None


def note(text: str) -> None:
    """Say a sentence to the user beside the result."""
    print(text, file=sys.stderr)


def note_written(written: list[pathlib.Path]) -> None:
    """Say where the result lies."""
    for path in written:
        note(f"wrote {path}")
