"""What all runs of a study share: its case, checked, its mesh and its anatomy."""

import dataclasses
import pathlib

from jaxfsi.anatomy import Anatomy
from jaxfsi.fields.aortic_site import aortic_site
from study.case.anatomy import MeshAnatomy
from study.case.faults import CaseError, Fault
from study.case.laws import QUADRATIC
from study.case.model import Case, require
from study.case.parameters import SurrogateParameters
from study.run.anatomy_source import case_anatomy, case_mesh, states_of
from study.run.mesh import mesh_state
from study.run.opening_checks import check_names, check_openings
from study.run.patient import stress_rules
from study.run.progress import Progress
from study.run.run_context import RunContext
from study.run.second_mesh import second_faults
from study.run.setup import check_simulation
from study.run.study_choice import RunChoice, StudyChoice
from study.store.meshes import mesh_key


def check_study(case: Case, choice: StudyChoice) -> None:
    """Refuse a case that a study cannot use; all faults are listed.

    Raises:
        CaseError: what is missing or out of range, or the fault of a finished mesh.
    """
    require(case, "study")
    check_names(case, segment=False)
    faults: list[Fault] = []
    for name in case.conditions:
        try:
            check_simulation(case, name, rigid=False, dt=choice.run.dt)
        except CaseError as error:
            faults += [fault for fault in error.faults if fault not in faults]
    known = stress_rules(case)
    for rule in choice.rules or ():
        if rule not in known:
            problem = f"there is no stress rule {rule!r}"
            cure = "add the factors below [stress]" if rule == "factors" else "choose a known one"
            faults.append(Fault(case.path, "stress.rule", None, problem, ", ".join(known), cure))
    for name in choice.sensitivities:
        if name not in case.conditions:
            problem = f"there is no condition {name!r} to differentiate"
            allowed = ", ".join(case.conditions)
            faults.append(
                Fault(case.path, "condition", None, problem, allowed, "choose from those run")
            )
    if choice.sensitivities and choice.run.continued:
        problem = "a run that goes on from rest cannot be differentiated alone"
        faults.append(Fault(case.path, "", None, problem, "", "leave --continued out"))
    if choice.mesh_error:
        faults += second_faults(case)
    if faults:
        raise CaseError(faults)
    if isinstance(case.anatomy, MeshAnatomy):
        case_mesh(case)  # a damaged mesh is refused before a folder is made


def open_context(
    case: Case,
    folder: pathlib.Path,
    choice: RunChoice,
    progress: Progress,
    state: str | None = None,
) -> tuple[RunContext, Anatomy | None]:
    """What all runs of a case share, its mesh made or taken from the cache, and its anatomy.

    Args:
        case: the case.
        folder: where stages and runs are kept.
        choice: how runs are made.
        progress: told of the meshing.
        state: one of `states_of`; None is the first.

    Raises:
        CaseError: no mesh can be made, or it lacks an opening.
    """
    state = state or states_of(case)[0]
    found = mesh_state(case, state, progress)
    mesh = found.mesh
    check_openings(case, mesh, rigid=False)
    anatomy = None if isinstance(case.anatomy, MeshAnatomy) else case_anatomy(case, state)
    site = aortic_site(mesh, anatomy)
    key = mesh_key(case, state)
    return RunContext(case, mesh, key, folder, choice, progress, site, found.made), anatomy


def with_curve(context: RunContext, a: float, b: float) -> RunContext:
    """The context whose case has a ramp's curve for surrogate, a [dyn·s/cm⁵], b [dyn·s²/cm⁸]."""
    return dataclasses.replace(context, case=case_with_curve(context.case, a, b))


def case_with_curve(case: Case, a: float, b: float) -> Case:
    """The case that has a ramp's curve for surrogate, a [dyn·s/cm⁵], b [dyn·s²/cm⁸]."""
    curve = SurrogateParameters(R0=a, K=b, C0=case.surrogate.C0, law=QUADRATIC)
    return dataclasses.replace(case, surrogate=curve)
