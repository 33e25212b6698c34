"""Faults of an input file and the one error that reports all of them together."""

import collections
import dataclasses
import datetime
import pathlib
import re
import reprlib
from collections.abc import Sequence

from jaxfsi.text_files import bad_byte, regular_bytes
from jaxfsi.toml_lines import KeyLines, key_lines

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]{1,80}")
_LARGEST_SHOWN_INTEGER = 10**18

LARGEST_SIZE = 2**20
"""Size beyond which a file is taken for something else than TOML [bytes]."""

MOST_SHOWN = 10
"""Faults of one file that are said in full; of those beyond only the number is."""

_short = reprlib.Repr()
_short.maxstring = 80
_short.maxother = 80
_short.maxlevel = 2


@dataclasses.dataclass(frozen=True)
class Fault:
    """One thing that is wrong with an input file.

    Attributes:
        file: the file at fault.
        key: dotted name of the key, empty when the file as a whole is at fault.
        value: the value found there; None when nothing was found.
        problem: what is wrong.
        allowed: what would have been accepted; empty when that needs no saying.
        cure: what to try.
        line: where it stands in the file, from 1; None where that is not known.
    """

    file: pathlib.Path
    key: str
    value: object
    problem: str
    allowed: str
    cure: str
    line: int | None = None

    def __str__(self) -> str:
        """The fault in two lines: what happened, and what to try."""
        return f"{self.where}: {self.what}\n    try: {self.cure}"

    @property
    def where(self) -> str:
        """The file, with the line where it is known."""
        return printable(self.file) + ("" if self.line is None else f":{self.line}")

    @property
    def what(self) -> str:
        """The key with its value, what is wrong with it, and what is allowed."""
        found = "" if self.value is None else f" = {shown(self.value)}"
        allowed = f" (allowed: {self.allowed})" if self.allowed else ""
        return f"{f'{self.key}{found}: ' if self.key else ''}{self.problem}{allowed}"


class CaseError(ValueError):
    """An input file was refused; every fault found in it is reported at once.

    The lines at which their keys stand are looked up here, whoever found them.

    Attributes:
        faults: the faults, in the order in which the tables are read.
    """

    def __init__(self, faults: Sequence[Fault]):
        ValueError.__init__(self, list(faults))
        self.faults: list[Fault] = _located(faults)

    def __str__(self) -> str:
        """The first faults of each file, two lines each, and how many there are beyond."""
        count = len(self.faults)
        lines = ["the input was refused: " + ("1 fault" if count == 1 else f"{count} faults")]
        said: collections.Counter[pathlib.Path] = collections.Counter()
        for fault in self.faults:
            if said[fault.file] < MOST_SHOWN:
                lines.append(str(fault))
            said[fault.file] += 1
        lines += [
            f"{printable(file)}: and {number - MOST_SHOWN} more"
            for file, number in said.items()
            if number > MOST_SHOWN
        ]
        return "\n".join(lines)


def _located(faults: Sequence[Fault]) -> list[Fault]:
    """The faults with the lines of their keys, where their files are TOML."""
    known: dict[pathlib.Path, KeyLines | None] = {}
    found = []
    for fault in faults:
        if fault.key and fault.line is None:
            if fault.file not in known:
                known[fault.file] = _lines_of(fault.file)
            lines = known[fault.file]
            line = None if lines is None else lines.line(fault.key)
            fault = dataclasses.replace(fault, line=line)
        found.append(fault)
    return found


def _lines_of(file: pathlib.Path) -> KeyLines | None:
    try:
        if file.stat().st_size > LARGEST_SIZE:
            return None
        return key_lines(regular_bytes(file).decode("utf-8-sig"))
    except (OSError, ValueError):
        return None


def shown(value: object) -> str:
    """A value as it may be printed: short, on one line, whatever it is."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= _LARGEST_SHOWN_INTEGER:
        return f"an integer of {value.bit_length()} bits"
    if isinstance(value, int | float):
        return f"{value:.10g}"
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    try:
        return _short.repr(value)
    except ValueError:  # an integer too long to print, inside a list or table
        return f"a {type(value).__name__}"


def printable(text: object) -> str:
    """A text without control characters, quoted only where it holds any."""
    plain = str(text)
    return plain if plain.isprintable() else repr(plain)


def shown_key(name: str) -> str:
    """A key as it is written in TOML: bare where that is allowed, quoted otherwise."""
    return name if _BARE_KEY.fullmatch(name) else _short.repr(name)


def unreadable(error: OSError | ValueError) -> str:
    """Why a text file cannot be read: the first byte that is no UTF-8, or what the system says."""
    if isinstance(error, UnicodeDecodeError):
        return f"not a UTF-8 text ({bad_byte(error)})"
    reason = error.strerror if isinstance(error, OSError) else "its path is no path of a file"
    return f"the file cannot be read: {reason or 'the system does not say why'}"
