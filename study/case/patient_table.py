"""Many patients from one CSV file: a row a patient, a column a key of a case file.

A column is named as its key with the table before it: `patient.id`, `condition.rest.ffr`,
`surrogate.R0_dyn_s_per_cm5`. An empty cell leaves its key out. Separators are commas, or
semicolons, beside which a decimal comma is read too. Files that cells name lie relative to the CSV
file.
"""

import csv
import dataclasses
import functools
import io
import pathlib
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from jaxfsi.text_files import read_text, why
from study.case.advice import nearest
from study.case.condition import CONDITION_NAME
from study.case.faults import CaseError, Fault
from study.case.model import Case, require
from study.case.parameters import STRESS_FACTORS, ThicknessBounds
from study.case.read import case_of
from study.case.schema import FREE_TEXT, Flag, Key, Location, Quantity, Word, keys_of, spellings
from study.case.sections import CASE, CONDITION_SLOT
from study.case.template import written

ID = "patient.id"
"""Column of the name of a patient."""

MOST_PATIENTS = 100_000
"""Rows beyond which a file is taken for something else than a table of patients."""

_KIND = Word(name="kind", field="kind")
_SLOT = re.compile(rf"condition\.({CONDITION_NAME})\.(\w+)")
_FLAGS = {"true": True, "false": False}


class PatientRow(NamedTuple):
    """A patient of a table.

    Attributes:
        name: of the patient, its `patient.id`.
        case: the case that the row describes.
        text: the same as a case file, the files that it names by their full paths.
    """

    name: str
    case: Case
    text: str


@dataclasses.dataclass(frozen=True)
class _Row:
    """A row as read: its number, its line in the file, and its cells by column."""

    number: int
    line: int
    cells: dict[str, str]


def read_patients(file: pathlib.Path, command: str) -> list[PatientRow]:
    """Read a table of patients.

    Args:
        file: the CSV file.
        command: what each case is for, one of `study.case.model.REQUIREMENTS`.

    Raises:
        CaseError: the file cannot be read or holds faults; each names its row and column.
    """
    header, rows = _table(file)
    keys = {name: key for name in header if (key := column_key(name)) is not None}
    faults = list(_header_faults(file, header, keys))
    if faults:
        raise CaseError(faults)
    found: list[PatientRow] = []
    first: dict[str, int] = {}
    for row in rows:
        name = row.cells.get(ID, "")
        if name and name in first:
            problem = f"row {first[name]} has the same"
            faults.append(_fault(file, row, ID, name, problem, "give each patient its own id"))
        first.setdefault(name, row.number)
        try:
            found.append(_patient(file, row, keys, command))
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError(faults)
    return found


def column_key(name: str) -> Key | None:
    """The key that a column stands for; None where there is no such key.

    Args:
        name: of the column, the dotted name of a key.
    """
    return _columns().get(_slotted(name))


def _slotted(name: str) -> str:
    """A column with NAME in place of its condition."""
    found = _SLOT.fullmatch(name)
    return name if found is None else f"{CONDITION_SLOT}.{found[2]}"


@functools.cache
def _columns() -> dict[str, Key]:
    """Every column that a table may have, conditions under NAME, with its key."""
    tables = [(section.heading, section.keys) for section in CASE]
    tables += [("stress.factors", STRESS_FACTORS), ("anatomy", (_KIND,))]
    tables += [("wall.thickness_per_radius", keys_of(ThicknessBounds))]
    found: dict[str, Key] = {}
    for heading, keys in tables:
        texts = [Word(name=name, field=name) for name in FREE_TEXT]
        for key in (spelled for one in (*keys, *texts) for spelled in spellings(one)):
            found.setdefault(f"{heading}.{key.key}", key)
    return found


def _table(file: pathlib.Path) -> tuple[list[str], list[_Row]]:
    """Columns and rows of a file; rows without any value are left out.

    Raises:
        CaseError: there is no table in it.
    """
    try:
        text = read_text(file)
    except ValueError as error:
        problem, _, cure = str(error).removeprefix(f"{file}: ").rstrip(".").rpartition(". ")
        cure += "; a spreadsheet must be saved as CSV in UTF-8"
        raise CaseError([Fault(file, "", None, problem, "", cure)]) from error
    first = text.split("\n", 1)[0]
    comma = ";" if first.count(";") > first.count(",") else ","
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=comma)
    header: list[str] = []
    rows: list[_Row] = []
    try:
        for cells in reader:
            cells = [cell.strip() for cell in cells]
            if not any(cells):
                continue
            if not header:
                header = cells
                continue
            rows.append(_row(file, header, cells, len(rows) + 1, reader.line_num))
            if comma == ";":
                rows[-1] = _with_points(rows[-1])
    except csv.Error as error:
        problem = f"no row of a table ({why(error)})"
        fault = Fault(file, "", None, problem, "", "save it as CSV again", reader.line_num)
        raise CaseError([fault]) from error
    if not rows or len(rows) > MOST_PATIENTS:
        problem = f"{len(rows)} patients below the line of columns"
        cure = 'start from "jaxfsi template --csv": a line of columns, then one row per patient'
        raise CaseError([Fault(file, "", None, problem, f"1 to {MOST_PATIENTS}", cure)])
    return header, rows


def _row(file: pathlib.Path, header: list[str], cells: list[str], number: int, line: int) -> _Row:
    if any(cells[len(header) :]):
        problem = f"row {number} has {len(cells)} cells, and there are {len(header)} columns"
        cure = "put texts with a separator in quotes, or add the missing column"
        raise CaseError([Fault(file, "", None, problem, "", cure, line)])
    return _Row(number, line, dict(zip(header, cells, strict=False)))


def _with_points(row: _Row) -> _Row:
    """The row with decimal points; beside semicolons a comma is a decimal one."""
    cells = {
        name: cell.replace(",", ".")
        if isinstance(column_key(name), Quantity) and cell.count(",") == 1
        else cell
        for name, cell in row.cells.items()
    }
    return dataclasses.replace(row, cells=cells)


def _header_faults(
    file: pathlib.Path, header: list[str], keys: Mapping[str, Key]
) -> Iterator[Fault]:
    for name in dict.fromkeys(header):
        place = f"column {name}" if name else "column without a name"
        if header.count(name) > 1:
            yield Fault(file, place, None, "appears twice", "", "keep one of the two", 1)
        if name in keys:
            continue
        known = list(_columns())
        close = nearest(_slotted(name), known)
        slot = _SLOT.fullmatch(name)
        if close and slot:
            close = close.replace(".NAME.", f".{slot[1]}.")
        cure = f"the nearest valid column is {close}" if close else "name a key of a case file"
        allowed = "TABLE.KEY as in case files, such as condition.rest.ffr"
        yield Fault(file, place, None, "unknown column", allowed, cure, 1)
    if ID not in header:
        yield Fault(file, f"column {ID}", None, "missing", "", f"add a column {ID}", 1)


def _fault(
    file: pathlib.Path, row: _Row, column: str, value: object, problem: str, cure: str
) -> Fault:
    return Fault(file, _place(row, column), value, problem, "", cure, row.line)


def _place(row: _Row, column: str) -> str:
    return f"row {row.number}, column {column}" if column else f"row {row.number}"


def _patient(file: pathlib.Path, row: _Row, keys: Mapping[str, Key], command: str) -> PatientRow:
    """The patient of a row; faults of its keys name row and column."""
    _refuse_both(file, row)
    document: dict[str, Any] = {}
    for name, cell in row.cells.items():
        if cell:
            _put(document, name, _value(keys[name], cell))
    try:
        case = case_of(document, file)
        require(case, command)
    except CaseError as error:
        own = [
            dataclasses.replace(f, key=_place(row, f.key), line=row.line) if f.file == file else f
            for f in error.faults
        ]
        raise CaseError(own) from error
    for name, cell in row.cells.items():
        if cell and isinstance(keys[name], Location):
            _put(document, name, str((file.parent / cell).resolve()))
    return PatientRow(case.id, case, toml_text(document))


def _value(key: Key, cell: str) -> Any:
    """A cell as TOML would hold it; what is no number stays a text, which is refused later."""
    if isinstance(key, Flag):
        return _FLAGS.get(cell.lower(), cell)
    if isinstance(key, Quantity):
        try:
            return int(cell) if key.whole else float(cell)
        except ValueError:
            return cell
    return cell


def _put(document: dict[str, Any], name: str, value: Any) -> None:
    *tables, last = name.split(".")
    place = document
    for table in tables:
        place = place.setdefault(table, {})
    place[last] = value


def _refuse_both(file: pathlib.Path, row: _Row) -> None:
    """A key that is a number or a table is given as one of the two."""
    given = [name for name, cell in row.cells.items() if cell]
    faults = [
        _fault(file, row, name, row.cells[name], f"given beside {other}", "leave one of them empty")
        for name in given
        for other in given
        if other.startswith(f"{name}.")
    ]
    if faults:
        raise CaseError(faults)


def toml_text(document: Mapping[str, Any]) -> str:
    """A document of tables within tables as TOML."""
    lines: list[str] = []
    _add(document, "", lines)
    return "\n".join(lines).lstrip("\n") + "\n"


def _add(table: Mapping[str, Any], heading: str, lines: list[str]) -> None:
    plain = {name: value for name, value in table.items() if not isinstance(value, dict)}
    if plain and heading:
        lines += ["", f"[{heading}]"]
    lines += [f"{name} = {_exact(value)}" for name, value in plain.items()]
    for name, value in table.items():
        if isinstance(value, dict):
            _add(value, f"{heading}.{name}" if heading else name, lines)


def _exact(value: Any) -> str:
    """A value as TOML that reads back as the same."""
    return repr(value) if isinstance(value, float) else written(value)


_EXAMPLE: dict[str, str] = {
    ID: "patient-01",
    "condition.rest.P_systolic_mmHg": "110",
    "condition.rest.P_diastolic_mmHg": "65",
    "condition.rest.period_s": "0.8",
    "condition.rest.ffr": "0.91",
    "condition.rest.ifr": "",
    "condition.dobutamine.P_systolic_mmHg": "130",
    "condition.dobutamine.P_diastolic_mmHg": "70",
    "condition.dobutamine.period_s": "0.45",
    "condition.dobutamine.ffr": "",
    "surrogate.R0_dyn_s_per_cm5": "5000",
}


def patients_template() -> str:
    """A table of patients to start from: its columns and one row, which is a valid patient."""
    return ",".join(_EXAMPLE) + "\n" + ",".join(_EXAMPLE.values()) + "\n"
