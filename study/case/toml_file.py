"""The text of a TOML file, parsed; an unreadable file gives one clear fault."""

import pathlib
import re
import tomllib
from typing import Any

from study.case.faults import LARGEST_SIZE, CaseError, Fault, shown, unreadable

MOST_PARTS = 32
"""Parts of a dotted key beyond which a file is refused: reading takes the square of them."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MOST_PARTS}}}")

_SYNTAX = (
    ("Cannot overwrite a value", "the key appears twice, or also as a table"),
    ("Cannot declare", "the table appears twice"),
    ("Cannot redefine", "the table appears twice"),
    ("Cannot mutate", "the table is complete already, and cannot be added to here"),
    ("Duplicate inline table key", "a key appears twice between braces"),
    ("Expected '=' after a key", "no = after the key"),
    ("Expected ']", "no closing bracket after the name of a table"),
    ("Invalid initial character", "a key cannot begin like this"),
    ("Invalid statement", "a key cannot begin like this"),
    ("Expected newline", "there is something after the value"),
    ("Unclosed array", "a list without its closing bracket"),
    ("Unclosed inline table", "a table without its closing brace"),
    ("Unterminated string", "a text without its closing quote"),
    ("Expected '\"", "a text without its closing quote"),
    ("Expected \"'", "a text without its closing quote"),
    ("Unescaped", "a backslash in a text; write / or two of them"),
    ("Escaped character", "a backslash in a text; write / or two of them"),
    ("Invalid hex value", "a backslash in a text; write / or two of them"),
    ("Illegal character '\\n'", "a text without its closing quote"),
    ("Illegal character", "a control character"),
    ("Found invalid character", "a control character"),
    ("Invalid date", "no such date or time"),
    ("Invalid value", "neither a number, a text in quotes, true nor false"),
)
"""What the reader of TOML says, and what that means."""

_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_document(file: pathlib.Path) -> dict[str, Any]:
    """Parse a TOML file.

    Args:
        file: its path.

    Returns:
        The tables as nested dictionaries.

    Raises:
        CaseError: the file cannot be opened, is empty, is no text, or is no valid TOML.
    """
    text = _read_text(file)
    if not text.strip():
        raise _refusal(file, "the file is empty", "start from the template of a case file")
    long = _LONG_KEY.search(text)
    if long is not None:
        line = text.count("\n", 0, long.start()) + 1
        problem = f"a key in line {line} has more than {MOST_PARTS} parts, {shown(long[0])}"
        raise _refusal(file, problem, "a key has one part, or three: condition.rest.ffr", line)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        cure = "correct the syntax there: key = value, texts in quotes, each key once a table"
        where, line = _syntax(str(error), text)
        raise _refusal(file, f"not valid TOML{where}", cure, line) from None
    except RecursionError:
        cure = "a case file needs two levels of tables; remove the brackets that are too many"
        raise _refusal(file, "lists or tables are nested too deeply", cure) from None
    except ValueError:  # an integer with more digits than Python converts
        cure = "look for a number with a great many digits"
        raise _refusal(file, "a number is too long to be read", cure) from None


def _read_text(file: pathlib.Path) -> str:
    try:
        if file.is_dir():
            cure = "give the path of the case file inside it"
            raise _refusal(file, "a folder, where a case file is expected", cure)
        if not file.exists():
            raise _refusal(file, "no such file", "check the path and the spelling")
        if not file.is_file():
            raise _refusal(file, "not a regular file", "give the path of a case file on disk")
        if file.stat().st_size > LARGEST_SIZE:
            size = f"{file.stat().st_size / 2**20:.1f} MiB, too large for a case file"
            raise _refusal(file, size, "give the path of the .toml file, not of the data it names")
        content = file.read_bytes()
    except OSError as error:
        problem = f"the file cannot be opened: {error.strerror or 'the system does not say why'}"
        raise _refusal(file, problem, "check the path and the permission to read it") from None
    except ValueError as error:
        if isinstance(error, CaseError):
            raise
        raise _refusal(file, "this is no path of a file", "check the path") from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = unreadable(error)
        cure = "give a TOML text file; this one is binary or in another encoding"
        if content.startswith(_UTF16_MARKS):
            cure = "the file is in UTF-16: save it again as UTF-8"
        raise _refusal(file, problem, cure) from None


def _refusal(file: pathlib.Path, problem: str, cure: str, line: int | None = None) -> CaseError:
    return CaseError([Fault(file, "", None, problem, "", cure, line)])


def _syntax(said: str, text: str) -> tuple[str, int | None]:
    """Where a syntax error lies and what it is, from what the reader says, and its line."""
    meant = next((words for start, words in _SYNTAX if said.startswith(start)), "")
    reason = f": {meant}" if meant else ""
    place = re.search(r"\(at line (\d+), column (\d+)\)$", said)
    if place is None:
        return f" at its end{reason}", text.rstrip().count("\n") + 1
    lines = text.replace("\r\n", "\n").split("\n")
    line = lines[min(int(place[1]), len(lines)) - 1].strip()
    return f" at line {place[1]}, column {place[2]}{reason}, in {shown(line)}", int(place[1])
