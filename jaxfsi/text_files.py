"""Texts and tables from files, and why a file cannot be read, said without any parser's words."""

import binascii
import csv
import errno
import io
import json
import lzma
import pathlib
import xml.etree.ElementTree as ET
import xml.parsers.expat
import zipfile
import zlib
from collections.abc import Iterator

AGAIN = "Save it again as UTF-8"


class Malformed(ValueError):
    """What is wrong with the content of a file, in words for its user."""


def bad_byte(error: UnicodeDecodeError) -> str:
    """The first byte of a file that is no UTF-8, and its place."""
    return f"byte {error.start} is {error.object[error.start]:#04x}"


def why(error: Exception) -> str:
    """Why a file cannot be read, from whatever a parser raised."""
    match error:
        case Malformed():
            return str(error)
        case UnicodeDecodeError():
            return f"it is no UTF-8 text ({bad_byte(error)})"
        case json.JSONDecodeError():
            return f"it is no valid JSON at line {error.lineno}, column {error.colno}"
        case ET.ParseError():
            line, column = error.position
            return f"it is no valid XML at line {line}, column {column + 1}"
        case xml.parsers.expat.ExpatError():
            return f"it is no valid XML at line {error.lineno}, column {error.offset + 1}"
        case OSError() if error.strerror:
            return error.strerror[:1].lower() + error.strerror[1:]
        case zlib.error() | lzma.LZMAError() | zipfile.BadZipFile() | binascii.Error() | EOFError():
            return "its packed data are damaged or break off"
        case MemoryError():
            return "it announces more than there is memory for"
        case RecursionError():
            return "it is nested too deeply"
        case csv.Error():
            return "a cell of its table is longer than any number, or a quote is never closed"
    return "what it announces and what it holds do not fit together"


def regular_bytes(path: pathlib.Path) -> bytes:
    """The content of a file; a device or a pipe, which has no end, is not opened.

    Raises:
        OSError: the file cannot be opened, or is no regular one.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    return path.read_bytes()


def regular_text(path: pathlib.Path) -> str:
    """The text of a file, see `regular_bytes`.

    Raises:
        OSError: the file cannot be opened, or is no regular one.
        UnicodeDecodeError: it is no UTF-8 text.
    """
    return regular_bytes(path).decode("utf-8")


def read_text(path: pathlib.Path) -> str:
    """The text of a file; a byte-order mark is skipped.

    Raises:
        ValueError: the file cannot be opened, or is no UTF-8 text.
    """
    try:
        return regular_text(path).removeprefix("\ufeff")
    except OSError as error:
        raise ValueError(f"{path}: cannot be opened ({why(error)}). Check the path.") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not a UTF-8 text ({bad_byte(error)}). {AGAIN}.") from error


def read_separated(path: pathlib.Path, separator: str) -> str:
    """A text whose first line decides how it is separated, with one separator in the end.

    Spreadsheets write semicolons, and decimal commas beside them, or commas where tabs are wanted.

    Args:
        path: the file.
        separator: a tab or a comma.

    Raises:
        ValueError: the file cannot be read.
    """
    text = read_text(path)
    first = text.lstrip().partition("\n")[0]
    if "\t" in first:
        return text
    if ";" in first:
        return text.replace(",", ".").replace(";", separator)
    return text.replace(",", separator)


def read_table(path: pathlib.Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Rows of a table by the names of its first line, each with its line.

    Cells are separated by commas, or by semicolons, where decimal commas are allowed. Cells that
    are missing are empty, those beyond the header left out.

    Raises:
        ValueError: the file cannot be read, or holds no such table.
    """
    reader = csv.DictReader(io.StringIO(read_separated(path, ","), newline=""), restval="")
    try:
        for row in reader:
            yield reader.line_num, {key: cell for key, cell in row.items() if key is not None}
    except csv.Error as error:
        raise ValueError(
            f"{path}: line {reader.line_num} is no row of a table ({why(error)}). Save it as"
            " comma-separated text."
        ) from error
