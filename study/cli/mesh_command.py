"""The command `mesh`."""

import dataclasses
import pathlib
from collections.abc import Mapping

from study.case.model import Case
from study.cli.command_output import Answer, note
from study.cli.request import Request
from study.cli.work import work
from study.report.mesh_results import embedded, mesh_document, write_meshes
from study.report.page import html_report
from study.run.mesh import chosen_states, mesh_states
from study.run.solver_input import input_or_reason
from study.store.case_inputs import provenance
from study.store.earlier_run import make_way
from study.store.json_form import as_json
from study.store.meshes import StateMesh
from study.store.options import MeshCommandOptions
from study.store.output import write_files
from study.store.result_files import MESH_FILE, PAGE_FILE
from study.store.stored_document import to_json


def mesh_command(request: Request[MeshCommandOptions], case: Case, folder: pathlib.Path) -> Answer:
    """Make a labelled mesh of blood and wall, with its pictures."""
    options = request.options
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
    with work(request, folder) as progress:
        origin = provenance(case, request.words, options)
        meshes = mesh_states(case, states, progress)
        progress.step("writing the files")
        beside = _solver_inputs(case, meshes) if "folder" in options.format else {}
        document = as_json(mesh_document(case, meshes, options.format, origin))
        written = write_files(
            folder,
            {PAGE_FILE: html_report(document, embedded(meshes)), MESH_FILE: to_json(document)},
            fill=lambda part: write_meshes(part, meshes, options.format, case.mesh.unit, beside),
            before=lambda names: make_way(folder, document, note, names),
        )
    return Answer(document, written)


def _solver_inputs(case: Case, meshes: Mapping[str, StateMesh]) -> dict[str, dict[str, str]]:
    """The input of another solver for each state, under rest where the case has it."""
    condition = "rest" if "rest" in case.conditions else next(iter(case.conditions), "rest")
    found = {}
    for state, made in meshes.items():
        found[state], reason = input_or_reason(case, condition, made.mesh, case.mesh.unit)
        if reason:
            note(reason)
    return found
