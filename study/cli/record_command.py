"""The commands on records, `diagnose` and `plan-measurement`."""

import dataclasses
import pathlib

from diagnosis import Record
from study.case.read import read_case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.diagnosis_lumen import with_lumen
from study.report.diagnosis_report import diagnosis_report
from study.report.diagnosis_results import diagnosis_document
from study.report.documents.diagnose import DiagnoseDocument
from study.report.plan_results import plan_document
from study.run.diagnosis import diagnose_record, plan_record, record_origin, study_of, with_case
from study.run.diagnosis_lumen import found_reach, study_lumen
from study.run.patient import load_patient
from study.run.progress import Progress
from study.run.ratio_uncertainty import uncertain_ratios
from study.run.reduced_results import Intervals
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import DiagnoseOptions, PlanOptions, RecordOptions
from study.store.output import write_files
from study.store.result_files import DIAGNOSIS_FILE, DIAGNOSIS_PAGE, PLAN_FILE
from study.store.stored_document import to_json


def diagnose_command(
    request: Request[DiagnoseOptions],
    record: Record,
    remarks: tuple[str, ...],
    folder: pathlib.Path,
) -> Answer:
    """Diagnose a record and write its page; then, where asked for, the gap in 3D beside it.

    Args:
        request: the command.
        record: the record.
        remarks: what it lacks.
        folder: a checked folder.

    Raises:
        CaseError: the case is faulty.
        RuntimeError: a 3D run failed; the diagnosis without it is written.
        KeyboardInterrupt: the user interrupted one; likewise.
    """
    options = request.options
    record, remarks = _known(options, record, remarks)
    with work(request, folder) as progress:
        origin = record_origin(request.words, options)
        study = None
        if options.in_3d is not None:
            from study.run.diagnosis_in_3d import study_in_3d  # imports the 3D core

            study = study_in_3d(options, record, progress)
        lumen = study_lumen(None if options.case is None else study_of(options.case))
        diagnosis = diagnose_record(record, options.richness, progress)
        progress.step("writing the report")
        document = diagnosis_document(record, remarks, diagnosis, origin.took(progress.spent()))
        document = with_lumen(document, found_reach(diagnosis, lumen))
        written = _write(folder, document)
        if study is not None:
            from study.run.diagnosis_in_3d import gap_in_3d

            part = gap_in_3d(record, diagnosis, study, options.in_3d or (), folder, progress)
            progress.step("writing the report")
            origin = origin.took(progress.spent())
            document = dataclasses.replace(document, in_3d=part, provenance=origin)
            written = _write(folder, document)
    return Answer(as_json(document), written)


def plan_command(
    request: Request[PlanOptions],
    record: Record,
    remarks: tuple[str, ...],
    folder: pathlib.Path,
) -> Answer:
    """Say what to measure next, before there are data.

    Args:
        request: the command.
        record: the record.
        remarks: what it lacks.
        folder: a checked folder.

    Raises:
        CaseError: the case is faulty.
    """
    options = request.options
    record, _ = _known(options, record, remarks)
    with work(request, folder) as progress:
        origin = record_origin(request.words, options)
        intervals = _intervals(options.case, progress)
        document = as_json(plan_document(record, plan_record(record, progress), origin, intervals))
        written = write_files(
            folder,
            {PLAN_FILE: to_json(document)},
            before=lambda names: make_way(folder, document, note, names),
        )
    return Answer(document, written)


def _intervals(path: pathlib.Path | None, progress: Progress) -> tuple[Intervals, str] | None:
    """FFR of a case file with intervals, and its law; None where it does not say enough."""
    if path is None or path.suffix != ".toml":
        return None
    case = read_case(path)
    rest = case.conditions.get("rest")
    if rest is None or rest.ffr is None or len(case.conditions) < 2:
        return None
    patient = load_patient(case)
    return uncertain_ratios(patient, progress), case.surrogate.law


def _known(
    options: RecordOptions, record: Record, remarks: tuple[str, ...]
) -> tuple[Record, tuple[str, ...]]:
    """The record with what its case knows, and what it lacks."""
    if options.case is None:
        return record, remarks
    record, more = with_case(record, options.case)
    return record, (*remarks, more)


def _write(folder: pathlib.Path, found: DiagnoseDocument) -> list[pathlib.Path]:
    document = as_json(found)
    files = {DIAGNOSIS_PAGE: diagnosis_report(document), DIAGNOSIS_FILE: to_json(document)}
    return write_files(folder, files, before=lambda names: make_way(folder, document, note, names))
