"""The page of a stored result, drawn again from its document and the pictures beside it."""

import pathlib

from study.case.faults import CaseError, Fault
from study.report.cohort_report import cohort_report
from study.report.diagnosis_report import diagnosis_report
from study.report.page import html_report, simulation_report, wall_report
from study.report.pictures import stored_mesh_pictures, stored_simulation_pictures
from study.report.study_report import stored_study_report
from study.report.what_if_results import what_if_report
from study.store.result_files import (
    COHORT_PAGE,
    DIAGNOSIS_PAGE,
    PAGE_FILE,
    REPORT_FILE,
    SIMULATION_PAGE,
    STUDY_PAGE,
    WALL_PAGE,
    WHAT_IF_PAGE,
)
from study.store.stored_document import Document

_NAMES = {
    "mesh": PAGE_FILE,
    "simulate": SIMULATION_PAGE,
    "study": STUDY_PAGE,
    "cohort": COHORT_PAGE,
    "diagnose": DIAGNOSIS_PAGE,
    "wall": WALL_PAGE,
    "what-if": WHAT_IF_PAGE,
}


WITHOUT_PAGE = ("calibrate", "sweep", "plan")
"""Kinds of results that consist of numbers alone."""


def page_name(document: Document) -> str:
    """Name of the file of a document's page."""
    return _NAMES.get(document["kind"], REPORT_FILE)


def stored_page(result: pathlib.Path, document: Document, vessel: str | None = None) -> str:
    """The page of a stored result.

    Args:
        result: its file or folder.
        document: what the file holds.
        vessel: name of the page of the vessel beside it; None: there is none.

    Raises:
        CaseError: there is no page of such a result.
        KeyError, TypeError, IndexError, ValueError: a part of it is missing or damaged.
    """
    if document["kind"] in WITHOUT_PAGE:
        cure = "leave out --out: the result is printed"
        raise CaseError([Fault(result, "", None, "a result of this kind has no page", "", cure)])
    folder = result if result.is_dir() else result.parent
    if document["kind"] == "cohort":
        return cohort_report(document)
    if document["kind"] == "study":
        return stored_study_report(folder, document, vessel)
    if document["kind"] == "diagnose":
        return diagnosis_report(document)
    if document["kind"] == "wall":
        return wall_report(document)
    if document["kind"] == "what-if":
        return what_if_report(document)
    if document["kind"] == "simulate":
        pictures = stored_simulation_pictures(folder, document)
        return simulation_report(document, pictures, vessel)
    part = document if document["kind"] == "mesh" else document.get("mesh") or {}
    return html_report(document, stored_mesh_pictures(folder, part) if "states" in part else {})
