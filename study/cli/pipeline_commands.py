"""The commands on reduced models, `run`, `calibrate` and `sweep`."""

import pathlib

import numpy as np

from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.mesh_results import embedded, write_meshes
from study.report.page import html_report
from study.report.results import calibration_document, case_document
from study.report.sweep_figure import sweep_figure
from study.report.sweep_results import sweep_document, sweep_table
from study.run.anatomy_source import states_of
from study.run.mesh import coarse, coarse_mesh, planned_steps
from study.run.pipeline import run_case
from study.run.sweep import sweep_case
from study.run.tuning import calibrate_case
from study.store.case_inputs import provenance
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.options import CalibrateOptions, RunOptions, SweepOptions
from study.store.output import write_files
from study.store.result_files import (
    CALIBRATION_FILE,
    FIGURE_FILE,
    REPORT_FILE,
    RESULT_FILE,
    SWEEP_FILE,
    TABLE_FILE,
)
from study.store.stored_document import to_json


def run_command(request: Request[RunOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Calibrate, predict every condition, write the report."""
    options = request.options
    with work(request, folder) as progress:
        origin = provenance(case, request.words, request.options)
        meshing = options.demo if options.mesh is None else options.mesh
        if meshing:
            progress.plan_last(planned_steps(coarse(case), states_of(case)[:1]))
        result = run_case(case, intervals=options.uncertainty, progress=progress)
        meshes, part = coarse_mesh(case, progress) if meshing else ({}, None)
        progress.step("writing the report")
        document = as_json(case_document(result, origin.took(progress.spent()), part))
        page = html_report(document, embedded(meshes))
        written = write_files(
            folder,
            {REPORT_FILE: page, RESULT_FILE: to_json(document)},
            fill=lambda part: write_meshes(part, meshes, ("vtu",), case.mesh.unit),
            before=lambda names: make_way(folder, document, note, names),
        )
    return Answer(document, written)


def calibrate_command(
    request: Request[CalibrateOptions], case: Case, folder: pathlib.Path
) -> Answer:
    """Find the scale of the outlet's resistances."""
    with work(request, folder) as progress:
        origin = provenance(case, request.words, request.options)
        patient, tuning = calibrate_case(case, progress=progress)
        document = as_json(calibration_document(patient, tuning, origin))
        written = write_files(
            folder,
            {CALIBRATION_FILE: to_json(document)},
            before=lambda names: make_way(folder, document, note, names),
        )
    return Answer(document, written)


def sweep_command(request: Request[SweepOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Ratios and flows over a range of that scale."""
    options = request.options
    with work(request, folder) as progress:
        origin = provenance(case, request.words, request.options)
        progress.plan({"sweeping alpha": 8.0})
        progress.step("sweeping alpha")
        found = sweep_case(
            case, np.geomspace(*options.alpha), condition=options.condition, rule=options.rule
        )
        document = as_json(sweep_document(found, origin))
        files = {
            TABLE_FILE: sweep_table(found),
            FIGURE_FILE: sweep_figure(document),
            SWEEP_FILE: to_json(document),
        }
        written = write_files(
            folder, files, before=lambda names: make_way(folder, document, note, names)
        )
    return Answer(document, written)
