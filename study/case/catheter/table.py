"""The text of a console's export as a table of numbers, whatever its separator and decimal mark.

Lines above the numbers are headers; the last of them that has as many cells as the rows names the
columns, and a line of units may follow it. Cells without a number become NaN.
"""

import collections
import dataclasses
import pathlib
import re

import numpy as np

from jaxfsi.text_files import regular_bytes
from study.case.faults import CaseError, Fault, unreadable

LARGEST_SIZE = 2**26
"""Largest file [bytes]: an hour at 200 Hz."""

FEWEST_ROWS = 50
"""Rows of numbers below which there is no recording."""

_SEPARATORS = (";", "\t", ",", "|", None)
_MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "inf"))
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?", re.IGNORECASE)
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?")
_UNIT = re.compile(
    r"[\[(]?(s|sec|seconds?|ms|msec|min|mm ?hg|kpa|hz|ml/min|bpm|1/min|cm/s|mv|v|%|-|)[\])]?",
    re.IGNORECASE,
)
_RUN = 8
"""Rows in which most must hold numbers where the table begins."""


@dataclasses.dataclass(frozen=True)
class ConsoleTable:
    """Numbers of an export.

    Attributes:
        path: the file.
        header: names of the columns; empty texts where the file has none.
        units: unit of each column where a line below the names gives it, else empty texts.
        values: rows × columns, NaN where there is no number.
        lines: line of the file of each row, from 1.
        remarks: what was left out or read in an unusual way, in sentences.
        roles: what the file itself says that each column holds, by a code; empty: it does not.
    """

    path: pathlib.Path
    header: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    lines: np.ndarray
    remarks: tuple[str, ...]
    roles: tuple[str, ...] = ()


def refusal(
    path: pathlib.Path, problem: str, cure: str, *, key: str = "", value: object = None
) -> CaseError:
    """The error that refuses a file with one sentence and a cure."""
    return CaseError([Fault(path, key, value, problem, "", cure)])


def read_console_table(path: pathlib.Path) -> ConsoleTable:
    """Read an export.

    Args:
        path: the file.

    Raises:
        CaseError: it cannot be read, or holds no table of numbers.
    """
    lines = _text(path).splitlines()
    separator = _separator(lines)
    rows = [_cells(line, separator) for line in lines]
    start = _start(rows)
    if start is None:
        cure = "export the traces as text: one row a sample, a column each for time and pressures"
        raise refusal(path, "no rows of numbers were found", cure)
    width = collections.Counter(len(row) for row in rows[start:] if row).most_common(1)[0][0]
    header, units = _names(rows[:start], width)
    if separator == ",":
        _check_decimal_commas(path, rows[start:], rows[:start], width)
    remarks = []
    body = [(k + 1, row) for k, row in enumerate(rows) if k >= start and row]
    if len(body[-1][1]) < width:
        body.pop()
        remarks.append("The last line is cut off and was left out.")
    odd = sum(len(row) != width for _, row in body)
    if odd > 0.1 * len(body):
        problem = f"{odd} of {len(body)} rows have other than {width} cells"
        raise refusal(path, problem, "export it again, with one separator throughout")
    if odd:
        remarks.append(f"{odd} rows with a wrong number of cells count as lost samples.")
    values = np.full((len(body), width), np.nan)
    for k, (_, row) in enumerate(body):
        if len(row) == width:
            values[k] = [_number(cell) for cell in row]
    if len(body) < FEWEST_ROWS:
        cure = "export some ten seconds at least"
        raise refusal(path, f"only {len(body)} rows of numbers", cure)
    numbers = np.array([number for number, _ in body])
    return ConsoleTable(path, header, units, values, numbers, tuple(remarks))


def _text(path: pathlib.Path) -> str:
    cure = "give the text (CSV) or DICOM file that the console exports"
    try:
        if path.is_dir():
            raise refusal(path, "this is a folder", "name the files in it, such as DIR/*.csv")
        if path.is_file() and path.stat().st_size > LARGEST_SIZE:
            problem = f"larger than a recording ({LARGEST_SIZE // 2**20} MiB)"
            raise refusal(path, problem, "cut it to the minutes of one condition")
        content = regular_bytes(path)
    except OSError as error:
        raise refusal(path, unreadable(error), cure) from None
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError:
            raise refusal(path, "its UTF-16 text is damaged", "export it again") from None
    if b"\0" in content:
        raise refusal(path, "this is no text file", cure)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _cells(line: str, separator: str | None) -> list[str]:
    if not line.strip():
        return []
    return [cell.strip().strip('"').strip() for cell in line.strip("\r\n").split(separator)]


def _number(cell: str) -> float:
    if _NUMBER.fullmatch(cell):
        return float(cell.replace(",", "."))
    clock = _CLOCK.fullmatch(cell)
    if clock is None:
        return float("nan")
    first, second, third = clock.groups()
    if third is None:
        return 60.0 * int(first) + int(second)
    return 3600.0 * int(first) + 60.0 * int(second) + float(third.replace(",", "."))


def _holds_numbers(row: list[str]) -> bool:
    """Whether a row has two numbers and is not mostly text."""
    found = sum(bool(_NUMBER.fullmatch(c) or _CLOCK.fullmatch(c)) for c in row)
    known = found + sum(cell.lower() in _MISSING for cell in row)
    return found >= 2 and 2 * known >= len(row)


def _separator(lines: list[str]) -> str | None:
    """The separator that makes rows of numbers of most lines."""
    sample = [line for line in lines if line.strip()][:2000]

    def rows(separator: str | None) -> int:
        return sum(_holds_numbers(_cells(line, separator)) for line in sample)

    counts = [rows(separator) for separator in _SEPARATORS]
    return _SEPARATORS[counts.index(max(counts))]


def _start(rows: list[list[str]]) -> int | None:
    """The first row of the table: numbers in it, and in most of the rows below it."""
    good = [_holds_numbers(row) for row in rows]
    for k, row in enumerate(rows):
        run = [a for a, r in zip(good[k:], rows[k:], strict=True) if r][:_RUN]
        if good[k] and len(row) > 1 and sum(run) > 0.5 * _RUN:
            return k
        if k > 2000 and not any(good[: k + 1]):
            return None
    return None


def _names(above: list[list[str]], width: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns, from the lines above the numbers."""
    full = [row for row in above if row and len(row) in (width, width - 1)]
    full = [[*row, *[""] * (width - len(row))] for row in full]
    empty = ("",) * width
    units = empty
    if len(full) > 1 and all(_UNIT.fullmatch(cell) for cell in full[-1]) and any(full[-1]):
        units = tuple(full.pop())
    return (tuple(full[-1]) if full else empty), units


def _check_decimal_commas(
    path: pathlib.Path, rows: list[list[str]], above: list[list[str]], width: int
) -> None:
    """Refuse commas that are decimal marks and separators at once."""
    heads = [len(row) for row in above if row and not _holds_numbers(row)]
    if not heads or heads[-1] < 2 or width < 2 * heads[-1] - 1:
        return
    whole = [cell for row in rows[:200] for cell in row]
    if all("." not in cell for cell in whole):
        problem = f"{heads[-1]} names of columns, but {width} cells a row"
        cure = "commas separate cells and decimals: export with semicolons, or decimal points"
        raise refusal(path, problem, cure)
