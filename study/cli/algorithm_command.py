"""The command `study`."""

import pathlib

from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.algorithm_report import write_study
from study.run.algorithm import run_study
from study.run.study_context import check_study
from study.run.study_options import study_case, study_choice
from study.store.case_inputs import provenance
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import StudyOptions
from study.store.result_files import STAGE_FOLDER


def algorithm_command(request: Request[StudyOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Run the algorithm in 3D, or what is left of it.

    A study of other input or options makes way before the first run: runs are kept under their
    names, and one that is computed anew would take the place of that which a page shows.
    """
    case = study_case(case, request.options)
    choice = study_choice(case, request.options)
    check_study(case, choice)
    with work(request, folder) as progress:
        origin = provenance(case, request.words, request.options)
        make_way(folder, {"kind": "study", "provenance": as_json(origin)}, note)
        try:
            result = run_study(case, folder, choice, progress=progress)
            document, written = write_study(result, origin, progress)
        except KeyboardInterrupt as stop:
            if str(stop) or not (folder / STAGE_FOLDER).is_dir():
                raise
            raise KeyboardInterrupt(
                f"interrupted; what was computed is in {folder}. Run the same command again to"
                " resume."
            ) from None
    return Answer(document, written)
