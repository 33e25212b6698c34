"""What each command reads before anything is computed; faulty input is refused here."""

import pathlib
from typing import Any

from study.case.catheter.columns import ExportFormat
from study.case.catheter.exports import read_exports
from study.case.demo import demo_cohort_path
from study.case.model import require
from study.case.patient_table import read_patients
from study.case.read import read_case, read_cases
from study.case.record import OLDER, RECORD_FILE, read_record, record_path
from study.cli.command_output import note
from study.cli.request import ImportOptions, Request, ShowOptions
from study.report.summary import summary
from study.run.members import find_members, table_members
from study.store.options import CaseOptions, CohortOptions, RecordOptions, case_path
from study.store.output import OutputRefused, check_folder
from study.store.stored_document import load_document, readable, without_waveforms


def case_input(request: Request[CaseOptions]) -> tuple[Any, ...]:
    """The case, and the checked folder for its results."""
    path = case_path(request.options)
    case = read_case(path)
    if request.command in ("calibrate-wall", "mesh", "simulate", "study"):
        require(case, request.command)
    return case, check_folder(result_folder(request, path))


def result_folder(request: Request[CaseOptions], case: pathlib.Path) -> pathlib.Path:
    """Where results go: as asked, else beside the case, and never into the package itself."""
    package = pathlib.Path(__file__).resolve().parents[1]
    if request.out is not None:
        folder = request.out
        if folder.resolve().is_relative_to(package):
            raise OutputRefused(
                f"{folder}: this is inside the package, where results would be lost. "
                "Name another folder: --out."
            )
        return folder
    if request.options.demo:
        return pathlib.Path("results")
    folder = case.parent / f"{case.stem}-results"
    return pathlib.Path(folder.name) if folder.resolve().is_relative_to(package) else folder


def cohort_input(request: Request[CohortOptions]) -> tuple[Any, ...]:
    """The cases of a cohort, what each holds, and the checked folder for its results."""
    place = request.options.folder or demo_cohort_path()
    beside = pathlib.Path(f"{place.name}-results")
    fallback = pathlib.Path("results") if request.options.demo else place.parent / beside
    if place.is_file():
        rows = read_patients(place, "study" if request.options.mode == "3d" else "run")
        beside = place.parent / f"{place.stem}-results"
        folder = check_folder(request.out or beside)
        texts = {row.name: row.text for row in rows}
        return table_members(texts, folder), {row.name: row.case for row in rows}, folder
    folder = check_folder(request.out or fallback)
    members = find_members(place, folder)
    cases = read_cases(member.path for member in members)
    return members, {m.name: c for m, c in zip(members, cases, strict=True)}, folder


def record_input(request: Request[RecordOptions]) -> tuple[Any, ...]:
    """The record, what it lacks, and the checked folder for its results."""
    given = request.options.record
    record, remarks = read_record(given, needs_data=request.command == "diagnose")
    for remark in remarks:
        if remark.startswith(OLDER):
            note(remark)
    place = record_path(given).resolve().parent
    folder = place.parent / f"{place.name}-results" if request.out is None else request.out
    return record, remarks, check_folder(folder)


def catheter_input(request: Request[ImportOptions]) -> tuple[Any, ...]:
    """The catheter files with their beats, and the checked folder for the record."""
    options = request.options
    given = ExportFormat(options.columns or {}, options.unit, options.time_unit, options.rate)
    spans = {name: (low, high) for name, low, high in options.span or ()}
    found = read_exports(options.files, given, spans, options.id)
    folder = request.out or found.folder / f"{found.patient}-record"
    if (folder / RECORD_FILE).exists():
        raise OutputRefused(f"{folder / RECORD_FILE}: exists already. Name another --out.")
    return found, check_folder(folder)


def stored_input(request: Request[ShowOptions]) -> tuple[Any, ...]:
    """A stored result."""
    result = request.options.result
    assert result is not None, "else a schema is shown"
    if request.options.beside and request.out is None:
        raise OutputRefused("--beside is for the page that --out writes. Give --out, or leave it.")
    document = load_document(result)
    readable(result, document, lambda: (summary(document), without_waveforms(document)))
    return (document,)
