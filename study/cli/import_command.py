"""The command `import-record`."""

import dataclasses
import datetime
import pathlib
import tempfile
from collections.abc import Mapping, Sequence

from study.case.catheter.exports import Exports
from study.case.catheter.record_text import record_texts
from study.case.faults import CaseError, Fault
from study.case.record import read_record
from study.cli.command_output import Answer
from study.cli.request import ImportOptions, Request
from study.report.catheter_figures import draw_beats
from study.report.imported_results import import_document
from study.store.output import write_files

PICTURE_FILE = "beats.png"


def import_command(request: Request[ImportOptions], found: Exports, folder: pathlib.Path) -> Answer:
    """Write the record of an examination, and conditions of a case file.

    Args:
        request: the command.
        found: what the files hold.
        folder: a checked folder.

    Raises:
        CaseError: the record would not be read, or would replace an export.
    """
    today = datetime.datetime.now(datetime.UTC).date()
    files = record_texts(found.patient, found.conditions, found.drift, today)
    drawn = (*found.conditions, *found.checks)
    _check_exports_stay([c.trace.path for c in drawn], files, folder)
    _check_readable(files, folder)
    written = write_files(folder, files, fill=lambda stage: draw_beats(drawn, stage / PICTURE_FILE))
    return Answer(import_document(found), written)


def _check_exports_stay(
    exports: Sequence[pathlib.Path], files: Mapping[str, str], folder: pathlib.Path
) -> None:
    """Refuse to write a file of the record over an export."""
    places = {(folder / name).resolve() for name in (*files, PICTURE_FILE)}
    problem = "a file of the record would replace this export"
    cure = "name another folder with --out"
    faults = [
        Fault(path, "--out", str(folder), problem, "a folder without the exports", cure)
        for path in exports
        if path.resolve() in places
    ]
    if faults:
        raise CaseError(faults)


def _check_readable(files: Mapping[str, str], folder: pathlib.Path) -> None:
    """Refuse a record that `diagnose` would refuse."""
    with tempfile.TemporaryDirectory() as place:
        for name, text in files.items():
            (pathlib.Path(place) / name).write_text(text, encoding="utf-8")
        try:
            read_record(pathlib.Path(place))
        except CaseError as error:
            moved = [dataclasses.replace(f, file=folder / f.file.name) for f in error.faults]
            raise CaseError(moved) from None
