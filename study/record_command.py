"""The commands on records, `diagnose` and `plan-measurement`."""

import argparse
import pathlib

from diagnosis import Record
from study.cache import use_cache
from study.diagnosis_in_3d import gap_in_3d, study_in_3d
from study.diagnosis_report import diagnosis_report
from study.diagnosis_results import (
    DIAGNOSIS_FILE,
    DIAGNOSIS_PAGE,
    PLAN_FILE,
    diagnosis_document,
)
from study.diagnosis_run import diagnose_record, plan_record, record_origin, with_case
from study.output import check_folder, write_files
from study.progress import Progress
from study.record_file import read_record, record_path
from study.results import Document, to_json


def diagnose_command(options: argparse.Namespace) -> tuple[Document, list[pathlib.Path]]:
    """Diagnose a record and write its page; then, where asked for, the gap in 3D beside it.

    Args:
        options: of the command line.

    Returns:
        The document and the paths written.

    Raises:
        CaseError: the record or the case is faulty.
        RuntimeError: a 3D run failed; the diagnosis without it is written.
        KeyboardInterrupt: the user interrupted one; likewise.
    """
    record, remarks, folder = _open_record(options)
    with Progress() as progress:
        study = study_in_3d(options, record, progress)
        diagnosis = diagnose_record(record, options.richness, progress)
        progress.step("writing the report")
        origin = record_origin(options.record, options.command_line)
        document = diagnosis_document(record, remarks, diagnosis, origin)
        written = _write(folder, document)
        if study is not None:
            part = gap_in_3d(record, diagnosis, study, options.in_3d, folder, progress)
            document = {**document, "in_3d": part}
            progress.step("writing the report")
            written = _write(folder, document)
    return document, written


def plan_command(options: argparse.Namespace) -> tuple[Document, list[pathlib.Path]]:
    """Say what to measure next, before there are data.

    Args:
        options: of the command line.

    Returns:
        The document and the paths written.

    Raises:
        CaseError: the record or the case is faulty.
    """
    record, _, folder = _open_record(options, needs_data=False)
    origin = record_origin(options.record, options.command_line)
    with Progress() as progress:
        document = plan_record(record, progress, origin)
    return document, write_files(folder, {PLAN_FILE: to_json(document)})


def _write(folder: pathlib.Path, document: Document) -> list[pathlib.Path]:
    files = {DIAGNOSIS_PAGE: diagnosis_report(document), DIAGNOSIS_FILE: to_json(document)}
    return write_files(folder, files)


def _open_record(
    options: argparse.Namespace, *, needs_data: bool = True
) -> tuple[Record, tuple[str, ...], pathlib.Path]:
    """The record, what it lacks, and the checked folder for results; computing may begin."""
    record, remarks = read_record(options.record, needs_data=needs_data)
    if options.case is not None:
        record, more = with_case(record, options.case)
        remarks = (*remarks, more)
    place = record_path(options.record).resolve().parent
    folder = place.parent / f"{place.name}-results" if options.out is None else options.out
    folder = check_folder(folder)
    use_cache()
    return record, remarks, folder
