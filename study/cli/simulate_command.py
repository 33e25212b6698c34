"""The command `simulate`."""

import dataclasses
import logging
import pathlib

from jaxfsi.simulation.cycles import inlet_of
from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.page import simulation_report
from study.report.pictures import Drawn, embedded_pictures, write_simulation_pictures
from study.report.simulation_pictures import draw_simulation
from study.report.simulation_results import simulation_document
from study.report.study_vessel import simulation_vessel, vessel_files, vessel_name
from study.run.expected_times import PREPARE_SECONDS, march_seconds
from study.run.lumen_collapse import anatomy_of
from study.run.mesh import chosen_state, mesh_state, planned_steps
from study.run.opening_checks import check_names, check_openings
from study.run.setup import check_simulation, plan_steps, prepare_simulation
from study.run.simulation import STEP_NAME, run_simulation
from study.run.simulation_data import Outcome
from study.store.case_inputs import provenance
from study.store.earlier_run import can_go_on, make_way, set_run_aside
from study.store.json_form import as_json
from study.store.options import SimulateOptions
from study.store.output import write_files
from study.store.result_files import SERIES_FILE, SIMULATION_FILE, SIMULATION_PAGE
from study.store.stored_document import to_json

_LOG = logging.getLogger(__name__)


def simulate_command(request: Request[SimulateOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Run blood and wall in 3D, or go on with the run of the folder."""
    options = request.options
    check_names(case, segment=True)
    check_simulation(case, options.condition, rigid=options.rigid, dt=options.dt)
    schedule = plan_steps(case, options.condition, dt=options.dt, cycles=options.cycles)
    if options.preset is not None:
        case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=options.preset))
    state = chosen_state(case, options.state)
    with work(request, folder) as progress:
        origin = provenance(case, request.words, options)
        progress.plan(
            {
                **planned_steps(case, [state]),
                "preparing": 20.0 if options.rigid else PREPARE_SECONDS[case.mesh.preset],
                STEP_NAME: march_seconds(case.mesh.preset, schedule.n_steps),
            }
        )
        mesh = mesh_state(case, state, progress).mesh
        check_openings(case, mesh, rigid=options.rigid, segment=True)
        progress.step("preparing")
        setup = prepare_simulation(
            case, mesh, options.condition, schedule, rigid=options.rigid, alpha=options.alpha
        )
        if options.restart or not can_go_on(folder):
            aside = set_run_aside(folder)
            if aside is not None:
                note(f"moved the earlier run to {aside}")
        progress.step(STEP_NAME)
        outcome = run_simulation(case, setup, folder, progress, state=state)
        progress.step("drawing")
        anatomy = anatomy_of(case, state)
        inlet = inlet_of(outcome.record, setup.model.names)
        series = folder / SERIES_FILE
        drawn = Drawn(*draw_simulation(series, setup.mesh, anatomy, inlet, schedule.period))
        progress.step("writing the report")
        origin = origin.took(progress.spent())
        document = as_json(
            simulation_document(case, options.condition, setup, outcome, drawn, folder, origin)
        )
        vessel = simulation_vessel(case, options.condition, setup, outcome, anatomy, series)
        pictures = embedded_pictures(drawn.pictures)
        page = simulation_report(document, pictures, vessel_name(vessel, "simulate"))
        shown = {**vessel_files(vessel, "simulate"), SIMULATION_PAGE: page}
        written = write_files(
            folder,
            {**shown, SIMULATION_FILE: to_json(document)},
            fill=lambda part: write_simulation_pictures(part, drawn),
            before=lambda names: make_way(folder, document, note, names),
        )
        ending = _ending(outcome, folder)
        if ending is not None:
            _LOG.warning("%s", ending)
    return Answer(document, written, ending)


def _ending(outcome: Outcome, folder: pathlib.Path) -> BaseException | None:
    """Why a run ended early; None where it did not."""
    if outcome.interrupted:
        return KeyboardInterrupt(
            f"interrupted; every completed block of ten steps is in {folder}. "
            "Run the same command again to resume; --restart starts over."
        )
    if outcome.failure:
        kept = f" What was computed before is in {folder}." if outcome.record.n_steps else ""
        return RuntimeError(
            f"{outcome.failure}{kept}\n"
            "    try: a smaller step with --dt; check alpha and the pressures of the case"
        )
    return None
