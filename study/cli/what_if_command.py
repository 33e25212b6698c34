"""The command `what-if`: an operation on the artery, before and after on one page."""

import pathlib
from typing import Any

from lumped.units import MM
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.operation import Operation
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.algorithm_report import write_study
from study.report.page import html_report
from study.report.results import case_document
from study.report.what_if_results import lumen_table, what_if_document, what_if_report
from study.run.algorithm import run_study
from study.run.finished_study import finished_study, study_document
from study.run.progress import Progress
from study.run.study_context import check_study
from study.run.study_options import study_case, study_choice
from study.run.what_if import AFTER, BEFORE, Sides, both_sides, what_if_0d
from study.run.what_if_3d import StudyBefore, what_if_3d
from study.run.what_if_parts import WhatIf
from study.store.case_inputs import provenance
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import RunOptions, StudyOptions, WhatIfOptions
from study.store.output import write_files
from study.store.provenance import sha256
from study.store.result_files import REPORT_FILE, RESULT_FILE, WHAT_IF_FILE, WHAT_IF_PAGE
from study.store.stored_document import to_json

LUMEN_TABLE = "lumen.csv"


def what_if_command(request: Request[WhatIfOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Predict what an operation would change."""
    options = request.options
    _check_options(case, options)
    operation = _operation(options)
    if options.study is not None:
        study_document(options.study)  # refused before a folder is made
    sides = both_sides(case, operation)
    if options.mode == "3d" and options.study is None:
        studied = study_case(case, _study_options(options))
        check_study(studied, study_choice(studied, _study_options(options)))
    with work(request, folder) as progress:
        origin = provenance(case, request.words, options)
        make_way(folder, {"kind": "what-if", "provenance": as_json(origin)}, note)
        if options.mode == "3d":
            found, written = _in_3d(request, case, operation, sides, folder, progress)
        else:
            found, written = _in_0d(request, case, operation, sides, folder, progress)
        progress.step("writing the report")
        document = as_json(what_if_document(found, case, origin))
        written += _write(found, document, folder)
    return Answer(document, written)


def _operation(options: WhatIfOptions) -> Operation:
    """The operation that the options name."""
    if options.operation is not None:
        return Operation(options.operation)
    return Operation("stent", options.stent * MM if options.stent else None)


def _check_options(case: Case, options: WhatIfOptions) -> None:
    """Refuse options of 3D without it.

    Raises:
        CaseError: which, and what to do.
    """
    given = {"--from": options.study is not None, "--quick": options.quick}
    given["--preset"] = options.preset is not None
    wrong = [name for name, there in given.items() if there and options.mode != "3d"]
    if wrong:
        problem = f"{wrong[0]} is for runs in 3D"
        raise CaseError([Fault(case.path, "", None, problem, "", "add --mode 3d, or leave it out")])
    both = [name for name, there in given.items() if there and name != "--from"]
    if options.study is not None and both:
        problem = f"the study of --from is made already, so {both[0]} changes nothing"
        raise CaseError([Fault(case.path, "", None, problem, "", "leave one of the two out")])


def _study_options(options: WhatIfOptions) -> StudyOptions:
    """Options of the study before the operation."""
    return StudyOptions(
        case=options.case,
        demo=options.demo,
        preset=options.preset,
        quick=options.quick,
        mesh_error=False,
        paper=False,
    )


def _in_0d(
    request: Request[WhatIfOptions],
    case: Case,
    operation: Operation,
    sides: Sides,
    folder: pathlib.Path,
    progress: Progress,
) -> tuple[WhatIf, list[pathlib.Path]]:
    """In 0D, with the report of `run` before the operation."""
    found, result = what_if_0d(case, operation, sides, progress)
    options = RunOptions(case=request.options.case, demo=request.options.demo, mesh=False)
    own = as_json(case_document(result, provenance(case, request.words, options)))
    files = {REPORT_FILE: html_report(own), RESULT_FILE: to_json(own)}
    place = folder / BEFORE
    place.mkdir(parents=True, exist_ok=True)
    make_way(place, own, note)
    return found, write_files(place, files)


def _in_3d(
    request: Request[WhatIfOptions],
    case: Case,
    operation: Operation,
    sides: Sides,
    folder: pathlib.Path,
    progress: Progress,
) -> tuple[WhatIf, list[pathlib.Path]]:
    """In 3D, from a study that is finished or made now."""
    written: list[pathlib.Path] = []
    if request.options.study is not None:
        before = _opened(request.options.study, case, progress)
    else:
        before, written = _studied(request, case, folder / BEFORE, progress)
    place = folder / AFTER
    place.mkdir(parents=True, exist_ok=True)
    return what_if_3d(before, operation, sides, place, progress), written


def _opened(place: pathlib.Path, case: Case, progress: Progress) -> StudyBefore:
    """A finished study of this case.

    Raises:
        CaseError: it is of another case.
    """
    found = finished_study(place, progress)
    own = found.context.case
    if sha256(own.path) != sha256(case.path):
        cure = f"give the case of the study, {own.path}, or another study"
        raise CaseError([Fault(place, "", None, f"a study of another case, {own.id}", "", cure)])
    curve = (found.ramp.a, found.ramp.b)
    return StudyBefore(own, found.choice, curve, found.alpha, found.calibrated, str(place))


def _studied(
    request: Request[WhatIfOptions], case: Case, place: pathlib.Path, progress: Progress
) -> tuple[StudyBefore, list[pathlib.Path]]:
    """The study before the operation, made or gone on with, with its page."""
    options = _study_options(request.options)
    case = study_case(case, options)
    choice = study_choice(case, options)
    place.mkdir(parents=True, exist_ok=True)
    origin = provenance(case, request.words, options)
    make_way(place, {"kind": "study", "provenance": as_json(origin)}, note)
    result = run_study(case, place, choice, progress=progress)
    _, written = write_study(result, origin, progress)
    law = result.ramp.fit.law
    curve = (float(law.R0), float(law.K))
    runs = result.calibrated
    return StudyBefore(case, choice, curve, result.loop.alpha, runs, BEFORE), written


def _write(found: WhatIf, document: dict[str, Any], folder: pathlib.Path) -> list[pathlib.Path]:
    """The page, the document, and the sections of both sides."""
    written: list[pathlib.Path] = []
    for name, lumen in ((BEFORE, found.before), (AFTER, found.after)):
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        written += write_files(place, {LUMEN_TABLE: lumen_table(lumen)})
    files = {WHAT_IF_PAGE: what_if_report(document), WHAT_IF_FILE: to_json(document)}
    return [*written, *write_files(folder, files)]
