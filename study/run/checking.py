"""What is wrong with a case file or a record, and what can be run with it; nothing is computed.

Beyond reading the file, the files that it names are read as the commands read them, and what each
command asks of a case is held against it.
"""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import diagnosis
from jaxfsi import Mesh
from study.case.anatomy import IvusAnatomy, MeshAnatomy
from study.case.condition import Condition
from study.case.faults import CaseError, Fault
from study.case.model import REQUIREMENTS, Case, require
from study.case.record import read_record, record_path
from study.run.anatomy_source import case_anatomy, case_mesh, states_of
from study.run.checked_file import CheckedFile
from study.run.opening_checks import check_openings
from study.run.patient import load_patient
from study.run.setup import check_simulation
from study.run.study_choice import StudyChoice
from study.run.study_context import check_study


def checked_case(case: Case) -> CheckedFile:
    """Hold a case against what each command asks, and read the files that it names."""
    faults, openings, mesh = _named_files(case)
    found = CheckedFile(case.path, "case", faults, _case_parts(case, openings))
    for command in REQUIREMENTS:
        lacking = _faults_of(lambda command=command: _requirements(case, command, mesh))
        if lacking:
            found.lacks[command] = lacking
        elif not faults:
            found.runs.append(command)
    if not found.runs and not faults:
        return dataclasses.replace(found, faults=found.lacks["run"])
    return found


def _requirements(case: Case, command: str, mesh: Mesh | None) -> None:
    """Raise what a command would raise before it computes anything; a finished mesh is given."""
    require(case, command)
    if mesh is not None and command in ("simulate", "study"):
        check_openings(case, mesh, rigid=False, segment=command == "simulate")
    if command == "study":
        check_study(case, StudyChoice())
    if command == "simulate":
        check_simulation(case, next(iter(case.conditions), "rest"), rigid=False, dt=None)


def _named_files(case: Case) -> tuple[list[Fault], list[str], Mesh | None]:
    """Faults of the files that the anatomy names, the openings of the vessel, a finished mesh."""
    openings: list[str] = []
    mesh: Mesh | None = None

    def look(state: str | None) -> None:
        nonlocal mesh
        if isinstance(case.anatomy, MeshAnatomy):
            mesh = case_mesh(case)
            openings[:] = list(mesh.openings)
        elif not _faults_of(lambda: require(case, "mesh")):
            openings[:] = [opening.name for opening in case_anatomy(case, state).openings]
        elif isinstance(case.anatomy, IvusAnatomy):
            load_patient(case)

    faults: list[Fault] = []
    for state in states_of(case):
        faults += _faults_of(lambda state=state: look(state))
    return faults, openings, mesh


def _faults_of(check: Callable[[], object]) -> list[Fault]:
    try:
        check()
    except CaseError as error:
        return error.faults
    return []


def _case_parts(case: Case, openings: list[str]) -> dict[str, str]:
    """What a case describes, in words."""
    anatomy = "none; R0 of [surrogate] represents the artery"
    if case.surrogate.R0 is None:
        anatomy = "none, and no R0 in [surrogate]: only run, under the linear law, needs neither"
    if case.anatomy is not None:
        anatomy = f"{case.anatomy.kind}, {_listed(states_of(case))}"
    conditions = [_condition_words(entry) for entry in case.conditions.values()]
    parts = {"patient": case.id, "conditions": "; ".join(conditions) or "none", "anatomy": anatomy}
    if case.anatomy is not None:
        parts["mesh"] = f"preset {case.mesh.preset}, wall of {case.wall.element} elements"
        parts["openings"] = _listed(openings) or "not known"
    parts["surrogate"] = f"{case.surrogate.law} law"
    parts["stress rule"] = case.stress.rule
    return parts


def _condition_words(entry: Condition) -> str:
    ratio = "" if entry.ffr is None else f", measured ratio {entry.ffr:g}"
    beat = "" if entry.waveform is None else ", with its beat"
    return f"{entry.name} ({entry.kind}{ratio}{beat})"


def checked_record(
    path: pathlib.Path, record: "diagnosis.Record", remarks: tuple[str, ...]
) -> CheckedFile:
    """What a record holds, and which commands can use it.

    Args:
        path: its file or folder.
        record: as it was read.
        remarks: what it lacks, in sentences.
    """
    conditions = [_recorded_words(entry) for entry in record.conditions]
    parts: Mapping[str, Any] = {"patient": record.id, "conditions": "; ".join(conditions)}
    found = CheckedFile(record_path(path), "record", [], {**parts}, ["plan-measurement"])
    if remarks:
        found.parts["remarks"] = " ".join(remarks)
    lacking = _faults_of(lambda: read_record(path))
    if lacking:
        found.lacks["diagnose"] = lacking
    else:
        found.runs.insert(0, "diagnose")
    return found


def _recorded_words(entry: "diagnosis.RecordedCondition") -> str:
    measured = [f"trace of {name}" for name in entry.beats]
    measured += ["ratio"] if entry.ffr is not None else []
    held = ", held out" if entry.held_out else ""
    return f"{entry.name} ({_listed(measured) or 'nothing measured'}{held})"


def _listed(words: Any) -> str:
    return ", ".join(words)
