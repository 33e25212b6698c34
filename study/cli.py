"""The command line, `jaxfsi`.

Exit status: 0 done, 1 the computation failed, 2 the input was refused, 130 interrupted. Results go
to files; a summary, or with `--json` one JSON object, goes to standard output; everything else to
standard error.
"""

import argparse
import dataclasses
import os
import pathlib
import sys
from collections.abc import Sequence

from study.algorithm import check_study, run_study
from study.algorithm_report import write_study
from study.anatomy_source import case_anatomy, states_of
from study.arguments import parse
from study.cache import use_cache
from study.case import Case, read_case, require
from study.case_anatomy import MeshAnatomy
from study.cohort_command import cohort_command
from study.demo import demo_case_path, demo_cohort_path
from study.earlier_run import can_go_on, set_aside
from study.faults import CaseError, Fault
from study.folder_lock import at_work
from study.mesh_case import (
    chosen_state,
    chosen_states,
    coarse,
    coarse_mesh,
    mesh_state,
    mesh_states,
    planned_steps,
)
from study.mesh_results import embedded, mesh_document, write_meshes
from study.openings import inlet_of
from study.output import OutputRefused, check_folder, write_files, write_tree
from study.pipeline import run_case
from study.progress import Progress
from study.provenance import provenance
from study.record_command import diagnose_command, plan_command
from study.record_template import EXAMPLE_FILE, RECORD_FILE, example_traces, record_template
from study.report import html_report, simulation_report
from study.results import (
    MESH_FILE,
    PAGE_FILE,
    REPORT_FILE,
    RESULT_FILE,
    SIMULATION_FILE,
    SIMULATION_PAGE,
    Document,
    calibration_document,
    case_document,
    load_document,
    to_json,
    without_waveforms,
)
from study.simulation_case import (
    check_openings,
    check_simulation,
    plan_steps,
    prepare_simulation,
)
from study.simulation_pictures import draw_simulation
from study.simulation_results import (
    SERIES_FILE,
    Drawn,
    embedded_pictures,
    simulation_document,
    write_pictures,
)
from study.simulation_run import STEP_NAME, run_simulation
from study.stored_page import page_name, stored_page
from study.study_command import study_case, study_choice
from study.summary import summary
from study.sweep import (
    FIGURE_FILE,
    SWEEP_FILE,
    TABLE_FILE,
    sweep_case,
    sweep_figure,
    sweep_table,
)
from study.template import case_template
from study.tuning import calibrate_case

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130

CALIBRATION_FILE, CASE_FILE = "calibration.json", "case.toml"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments without the program's name; by default those of the process.

    Returns:
        The exit status.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        options = parse(given)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else REFUSED
    options.command_line = ["jaxfsi", *given]
    try:
        _COMMANDS[options.command](options)
    except (CaseError, OutputRefused) as refusal:
        print(refusal, file=sys.stderr)
        return REFUSED
    except BrokenPipeError:
        # The reader of the output has gone; a second complaint at exit would help nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt as stop:
        print(str(stop) or "interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:
        print(f"the output could not be written: {error}", file=sys.stderr)
        print("    try: another folder with --out, or free some space", file=sys.stderr)
        return FAILED
    except Exception as error:
        if os.environ.get("JAXFSI_TRACEBACK"):
            raise
        print(f"the computation failed: {error or type(error).__name__}", file=sys.stderr)
        if not isinstance(error, ValueError | RuntimeError):
            cure = "again with JAXFSI_TRACEBACK=1 for the place, and report it"
            print(f"    try: {cure}", file=sys.stderr)
        return FAILED
    return DONE


def _run(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    with Progress() as progress:
        meshing = options.demo if options.mesh is None else options.mesh
        if meshing:
            progress.plan_last(planned_steps(coarse(case), states_of(case)[:1]))
        result = run_case(case, progress=progress)
        meshes, part = coarse_mesh(case, progress) if meshing else ({}, None)
        progress.step("writing the report")
        document = {**case_document(result, provenance(case, options.command_line)), "mesh": part}
        page = html_report(document, embedded(meshes))
        written = write_tree(
            folder,
            lambda part: write_meshes(part, meshes, ("vtu",), case.mesh.unit),
            {REPORT_FILE: page, RESULT_FILE: to_json(document)},
        )
    _show(options, document, written)


def _mesh(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    require(case, "mesh")
    given = {
        "preset": options.preset,
        "elements_across": options.elements_across,
        "wall_layers": options.wall_layers,
        "backend": options.backend,
        "unit": options.unit,
    }
    chosen = {name: value for name, value in given.items() if value is not None}
    case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, **chosen))
    states = chosen_states(case, options.state)
    with Progress() as progress:
        meshes = mesh_states(case, states, progress)
        progress.step("writing the files")
        origin = provenance(case, options.command_line)
        document = mesh_document(case, meshes, options.format, origin)
        written = write_tree(
            folder,
            lambda part: write_meshes(part, meshes, options.format, case.mesh.unit),
            {PAGE_FILE: html_report(document, embedded(meshes)), MESH_FILE: to_json(document)},
        )
    _show(options, document, written)


def _simulate(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    require(case, "simulate")
    check_simulation(case, options.condition, rigid=options.rigid, dt=options.dt)
    if options.preset is not None:
        case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=options.preset))
    state = chosen_state(case, options.state)
    with Progress() as progress:
        progress.plan(
            {
                **planned_steps(case, [state]),
                "preparing": 20.0 if options.rigid else 80.0,
                STEP_NAME: 1000.0,
            }
        )
        mesh = mesh_state(case, state, progress).mesh
        check_openings(case, mesh, rigid=options.rigid)
        progress.step("preparing")
        schedule = plan_steps(case, options.condition, dt=options.dt, cycles=options.cycles)
        setup = prepare_simulation(
            case, mesh, options.condition, schedule, rigid=options.rigid, alpha=options.alpha
        )
        if options.restart or not can_go_on(folder):
            aside = set_aside(folder)
            if aside is not None:
                print(f"moved the earlier run to {aside}", file=sys.stderr)
        progress.step(STEP_NAME)
        outcome = run_simulation(case, setup, folder, progress)
        progress.step("drawing")
        anatomy = None if isinstance(case.anatomy, MeshAnatomy) else case_anatomy(case, state)
        drawn = Drawn(
            *draw_simulation(
                folder / SERIES_FILE,
                setup.mesh,
                anatomy,
                inlet_of(outcome.record, setup.model.names),
                schedule.period,
            )
        )
        progress.step("writing the report")
        origin = provenance(case, options.command_line)
        document = simulation_document(
            case, options.condition, setup, outcome, drawn, folder, origin
        )
        page = simulation_report(document, embedded_pictures(drawn))
        written = write_tree(
            folder,
            lambda part: write_pictures(part, drawn),
            {SIMULATION_PAGE: page, SIMULATION_FILE: to_json(document)},
        )
    _show(options, document, written)
    if outcome.interrupted:
        raise KeyboardInterrupt(
            f"interrupted; all whole chunks that were computed are in {folder}. "
            "Give the same command again to go on; --restart starts anew."
        )
    if outcome.failure:
        kept = f" What was computed before is in {folder}." if outcome.record.n_steps else ""
        raise RuntimeError(
            f"{outcome.failure}{kept}\n"
            "    try: a smaller step with --dt; check alpha and the pressures of the case"
        )


def _study(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    case = study_case(case, options)
    choice = study_choice(case, options)
    check_study(case, choice)
    with at_work(folder), Progress() as progress:
        result = run_study(case, folder, choice, progress=progress)
        document, written = write_study(result, provenance(case, options.command_line), progress)
    _show(options, document, written)


def _cohort(options: argparse.Namespace) -> None:
    if options.demo:
        options.folder = demo_cohort_path()
    beside = pathlib.Path(f"{options.folder.name}-results")
    fallback = pathlib.Path("results") if options.demo else options.folder.parent / beside
    folder = check_folder(options.out or fallback)
    document, written = cohort_command(options, folder)
    _show(options, document, written)


def _calibrate(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    with Progress() as progress:
        patient, tuning = calibrate_case(case, progress=progress)
    document = calibration_document(patient, tuning, provenance(case, options.command_line))
    _show(options, document, write_files(folder, {CALIBRATION_FILE: to_json(document)}))


def _sweep(options: argparse.Namespace) -> None:
    case, folder = _open(options)
    with Progress() as progress:
        progress.plan({"sweeping alpha": 8.0})
        progress.step("sweeping alpha")
        document = sweep_case(case, options.alpha, condition=options.condition, rule=options.rule)
    document = {**document, "provenance": provenance(case, options.command_line)}
    files = {
        TABLE_FILE: sweep_table(document),
        FIGURE_FILE: sweep_figure(document),
        SWEEP_FILE: to_json(document),
    }
    _show(options, document, write_files(folder, files))


def _diagnose(options: argparse.Namespace) -> None:
    _show(options, *diagnose_command(options))


def _plan(options: argparse.Namespace) -> None:
    _show(options, *plan_command(options))


def _show_result(options: argparse.Namespace) -> None:
    document = load_document(options.result)
    try:
        summary(document)
        page = ""
        if options.out is not None:
            page = stored_page(options.result, document)
    except (KeyError, TypeError, IndexError, ValueError) as error:
        problem = f"a part of the result is missing or damaged: {error!r}"
        raise CaseError(
            [Fault(options.result, "", None, problem, "", "run the command again")]
        ) from error
    written = []
    if options.out is not None:
        written = write_files(check_folder(options.out), {page_name(document): page})
    _show(options, document, written)


def _template(options: argparse.Namespace) -> None:
    files = {CASE_FILE: case_template()}
    if options.record:
        files = {EXAMPLE_FILE: example_traces(), RECORD_FILE: record_template()}
    text, written = list(files.values())[-1], []
    if options.out is not None:
        folder = check_folder(options.out)
        for name in files:
            if (folder / name).exists():
                raise OutputRefused(f"{folder / name}: exists already. Name another --out.")
        written = write_files(folder, files)
    if options.json:
        print(to_json({"template": text, "files": [str(path) for path in written]}), end="")
    elif not written:
        print(text, end="")
    _tell(written)


_COMMANDS = {
    "run": _run,
    "mesh": _mesh,
    "simulate": _simulate,
    "study": _study,
    "cohort": _cohort,
    "calibrate": _calibrate,
    "sweep": _sweep,
    "diagnose": _diagnose,
    "plan-measurement": _plan,
    "show": _show_result,
    "template": _template,
}


def _open(options: argparse.Namespace) -> tuple[Case, pathlib.Path]:
    """The case and the checked folder for its results; computing may begin."""
    path = demo_case_path() if options.demo else options.case
    case = read_case(path)
    folder = check_folder(_folder(options, path))
    use_cache()
    return case, folder


def _folder(options: argparse.Namespace, case: pathlib.Path) -> pathlib.Path:
    """Where results go: as asked, else beside the case, and never into the package itself."""
    package = pathlib.Path(__file__).resolve().parent
    if options.out is not None:
        folder = options.out
        if folder.resolve().is_relative_to(package):
            raise OutputRefused(
                f"{folder}: this is inside the package, where results would be lost. "
                "Name another folder: --out."
            )
        return folder
    if options.demo:
        return pathlib.Path("results")
    folder = case.parent / f"{case.stem}-results"
    return pathlib.Path(folder.name) if folder.resolve().is_relative_to(package) else folder


def _show(options: argparse.Namespace, document: Document, written: list[pathlib.Path]) -> None:
    if options.json:
        files = {"files": [str(path) for path in written]} if written else {}
        print(to_json({**without_waveforms(document), **files}), end="")
    else:
        print(summary(document), end="")
    _tell(written)


def _tell(written: list[pathlib.Path]) -> None:
    for path in written:
        print(f"wrote {path}", file=sys.stderr)
