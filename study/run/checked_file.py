"""Case files and records as `check` reads them: faults at once, the rest where there are none."""

import contextlib
import dataclasses
import importlib
import pathlib

from study.case.faults import CaseError, Fault
from study.case.read import read_case
from study.case.record import RECORD_FILE, read_record, record_path
from study.case.toml_file import read_document

_RECORD_ALONE = ("noise", "prior")
"""Tables that only a record has."""

_CLOSER = "study.run.checking"
"""Imported for a file without faults: it takes seconds."""


@dataclasses.dataclass(frozen=True)
class CheckedFile:
    """What was found of a file.

    Attributes:
        file: the case file or record.
        kind: `case` or `record`.
        faults: what is wrong with it and the files that it names.
        parts: what it describes, in words, by `patient`, `conditions`, `anatomy`, ....
        runs: commands that it can be given to.
        lacks: what is missing for each of the others.
    """

    file: pathlib.Path
    kind: str
    faults: list[Fault]
    parts: dict[str, str] = dataclasses.field(default_factory=dict)
    runs: list[str] = dataclasses.field(default_factory=list)
    lacks: dict[str, list[Fault]] = dataclasses.field(default_factory=dict)


def check_file(path: pathlib.Path) -> CheckedFile:
    """Check a case file, a record, or the folder of a record."""
    try:
        if _is_record(path):
            read = read_record(path, needs_data=False)
            return importlib.import_module(_CLOSER).checked_record(path, *read)
        case = read_case(path)
        return importlib.import_module(_CLOSER).checked_case(case)
    except CaseError as error:
        return CheckedFile(path, "file", error.faults)


def _is_record(path: pathlib.Path) -> bool:
    if path.name == RECORD_FILE or (path.is_dir() and record_path(path).exists()):
        return True
    with contextlib.suppress(CaseError):
        document = read_document(path)
        conditions = document.get("condition")
        return isinstance(conditions, list) or any(name in document for name in _RECORD_ALONE)
    return False
