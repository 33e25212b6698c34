"""The command `cohort`: cases of a folder side by side, and how predictions agree."""

import dataclasses
import os
import pathlib

from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.emit_jobs import emit_jobs
from study.cli.request import Request
from study.cli.work import work
from study.report.cohort_report import cohort_report
from study.report.cohort_results import cohort_document
from study.run.cohort import gathered, run_cohort
from study.run.executor_choice import executor_choice
from study.run.executors import ExecutorRefused, load_engine, opened_executor
from study.run.expected_times import CASE_SECONDS
from study.run.members import Member, MemberResult, write_cases
from study.run.progress import Progress
from study.store.case_inputs import inputs_of
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import CohortOptions
from study.store.output import OutputRefused, write_files
from study.store.provenance import Provenance, made_by
from study.store.result_files import COHORT_FILE, COHORT_PAGE
from study.store.stored_document import to_json


def cohort_command(
    request: Request[CohortOptions],
    members: list[Member],
    cases: dict[str, Case],
    out: pathlib.Path,
) -> Answer:
    """Run a cohort and write its page.

    A cohort of other input or options makes way before the first case: cases are kept under their
    names, and one that is run anew would take the place of that which a page names.

    Args:
        request: the command.
        members: its cases.
        cases: what each holds, by name.
        out: a checked folder.

    Raises:
        RuntimeError: every case failed.
    """
    options = request.options
    if options.emit_jobs is not None:
        return emit_jobs(request, members)
    load_engine(executor_choice(options.executor))
    with work(request, out) as progress:
        origin = _provenance(request, cases)
        make_way(out, {"kind": "cohort", "provenance": as_json(origin)}, note)
        write_cases(members)
        results = _results(options, members, out, progress)
        progress.step("writing the report")
        if all(result.document is None for result in results):
            what = "no case is finished" if options.gather else "every case failed"
            raise RuntimeError(f"{what}; {results[0].member.name}: {results[0].reason}")
        document = as_json(cohort_document(results, cases, options.mode, origin))
        page = cohort_report(document)
        written = write_files(out, {COHORT_PAGE: page, COHORT_FILE: to_json(document)})
    return Answer(document, written)


def _results(
    options: CohortOptions, members: list[Member], out: pathlib.Path, progress: Progress
) -> list[MemberResult]:
    """Run the cases where the options say so, or gather those that are finished."""
    extra, usual = options.options or (), CASE_SECONDS[options.mode]
    if options.gather:
        return gathered(members, options.mode, extra)
    workers = options.workers or os.cpu_count() or 1
    rounds = -(-len(members) // workers)
    progress.plan({"cases": usual * rounds, "writing the report": 3.0})
    progress.step("cases")
    choice = executor_choice(options.executor)
    try:
        executor = opened_executor(choice, options.workers, len(members), out)
    except ExecutorRefused as refusal:
        raise OutputRefused(str(refusal)) from None
    return run_cohort(
        members,
        options.mode,
        extra=extra,
        executor=executor,
        workers=options.workers,
        expected=usual,
        tell=lambda text, _, left: progress.tell(text, left),
    )


def _provenance(request: Request[CohortOptions], cases: dict[str, Case]) -> Provenance:
    inputs = [
        dataclasses.replace(entry, file=f"{name}/{entry.file}")
        for name, case in cases.items()
        for entry in inputs_of(case)
    ]
    return made_by(inputs, request.words, request.options)
