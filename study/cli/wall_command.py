"""The command `calibrate-wall`."""

import dataclasses
import pathlib

from lumped.units import MM
from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.page import wall_report
from study.report.wall_results import wall_document
from study.run.measured_states import check_compared, fitted_names, measured_states
from study.run.mesh import planned_steps
from study.run.wall_calibration import calibrate_wall
from study.store.case_inputs import provenance
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import WallOptions
from study.store.output import write_files
from study.store.result_files import WALL_FILE, WALL_PAGE
from study.store.stored_document import to_json


def wall_command(request: Request[WallOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Find the stiffness of the wall from measured lumens."""
    options = request.options
    if options.preset is not None:
        case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=options.preset))
    states = measured_states(case)
    check_compared(case, states, options.course * MM)
    image, *others = (state.name for state in states)
    fitted_names(case, others, options.fit)
    with work(request, folder) as progress:
        origin = provenance(case, request.words, options)
        progress.plan(
            {
                **planned_steps(case, [image]),
                "preparing the wall": 60.0,
                "fitting the stiffness": 900.0,
                "predicting all states": 300.0,
            }
        )
        fit = calibrate_wall(
            case,
            fitted=options.fit,
            free=options.free,
            course=options.course * MM,
            contour_error=options.contour_error,
            progress=progress,
        )
        progress.step("writing the report")
        document = as_json(wall_document(case, fit, origin))
        written = write_files(
            folder,
            {WALL_PAGE: wall_report(document), WALL_FILE: to_json(document)},
            before=lambda names: make_way(folder, document, note, names),
        )
    return Answer(document, written)
