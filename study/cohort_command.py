"""The command `cohort`: cases of a folder side by side, and how predictions agree."""

import argparse
import datetime
import os
import pathlib
import platform
from typing import Any

from study.case import read_case
from study.cohort import Member, find_members, run_cohort
from study.cohort_figures import cohort_figures
from study.cohort_results import cohort_document, pair_rows
from study.faults import CaseError, Fault
from study.output import write_files
from study.progress import Progress
from study.provenance import commit, versions
from study.report import rendered, safe
from study.results import COHORT_FILE, COHORT_PAGE, Document, to_json

_SECONDS = {"curve": 60.0, "3d": 3000.0}


def cohort_command(
    options: argparse.Namespace, out: pathlib.Path
) -> tuple[Document, list[pathlib.Path]]:
    """Run a cohort and write its page.

    Args:
        options: of the command line.
        out: a checked folder.

    Returns:
        The document and the paths written.

    Raises:
        CaseError: there is no case, or some are faulty; all their faults are listed.
        RuntimeError: every case failed.
    """
    members = find_members(options.folder, out)
    check_members(members)
    extra = list(options.options or [])
    with Progress() as progress:
        workers = options.workers or os.cpu_count() or 1
        rounds = -(-len(members) // workers)
        progress.plan({"cases": _SECONDS[options.mode] * rounds, "writing the report": 3.0})
        progress.step("cases")
        fates = run_cohort(
            members,
            options.mode,
            extra=extra,
            workers=options.workers,
            expected=_SECONDS[options.mode],
            tell=lambda text, _, left: progress.tell(text, left),
        )
        progress.step("writing the report")
        if all(fate.document is None for fate in fates):
            raise RuntimeError(f"every case failed; {fates[0].member.name}: {fates[0].reason}")
        document = cohort_document(fates, options.mode, _provenance(options))
        page = cohort_report(document)
        written = write_files(out, {COHORT_PAGE: page, COHORT_FILE: to_json(document)})
    return document, written


def cohort_report(document: Document) -> str:
    """The page of a cohort, its figures inside."""
    figures = safe(cohort_figures(document))
    return rendered("cohort.html", d=document, rows=pair_rows(document), fig=figures)


def check_members(members: list[Member]) -> None:
    """Read every case before any is run.

    Raises:
        CaseError: the faults of all cases.
    """
    faults: list[Fault] = []
    for member in members:
        try:
            read_case(member.path)
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError(faults)


def _provenance(options: argparse.Namespace) -> dict[str, Any]:
    return {
        "command": options.command_line,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "platform": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "commit": commit(),
    }
