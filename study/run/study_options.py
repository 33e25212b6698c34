"""The command `study`: its options as choices of a study."""

import dataclasses

from lumped import MMHG
from study.case.advice import nearest
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.run.second_mesh import has_second
from study.run.study_choice import RampChoice, RunChoice, StudyChoice
from study.store.options import StudyOptions

QUICK_STEP, QUICK_RATE = 3.0e-3, 150.0 * MMHG
QUICK_STRESS = "dobutamine"
QUICK_TOLERANCE = 3.0e-3
"""How far the residual of a step is reduced in a quick study. With 1e-2 the steps in which the slit
of the bundled patient narrows fastest under dobutamine fail now and then, however small."""


def study_case(case: Case, options: StudyOptions) -> Case:
    """The case as the options change it.

    Raises:
        CaseError: a condition is named that the case does not have.
    """
    preset = options.preset or ("coarse" if options.quick else None)
    if preset is not None:
        case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=preset))
    if options.quick and case.solver.tolerance is None:
        solver = dataclasses.replace(case.solver, tolerance=QUICK_TOLERANCE)
        case = dataclasses.replace(case, solver=solver)
    wanted = options.conditions
    if wanted is None and options.quick and QUICK_STRESS in case.conditions:
        wanted = (QUICK_STRESS,)
    if wanted is None:
        return case
    unknown = [name for name in wanted if name not in case.conditions]
    if unknown:
        known = ", ".join(case.conditions)
        close = nearest(unknown[0], tuple(case.conditions))
        cure = f"write {close}" if close else "choose from these"
        problem = f"there is no condition {unknown[0]!r} to run"
        raise CaseError([Fault(case.path, "condition", None, problem, known, cure)])
    kept = {n: entry for n, entry in case.conditions.items() if n == "rest" or n in wanted}
    return dataclasses.replace(case, conditions=kept)


def study_choice(case: Case, options: StudyOptions) -> StudyChoice:
    """How the study is made.

    Args:
        case: the case, see `study_case`.
        options: of the command line.
    """
    dt = options.dt or (QUICK_STEP if options.quick and case.solver.dt is None else None)
    rate = QUICK_RATE if options.quick else RampChoice().rate
    if options.ramp_rate is not None:
        rate = options.ramp_rate * MMHG
    cycles = options.cycles or (1 if options.quick else case.solver.cycles or 1)
    return StudyChoice(
        run=RunChoice(dt=dt, cycles=cycles, continued=options.continued),
        ramp=RampChoice(rate=rate),
        rules=options.rules,
        nominal=options.nominal,
        paper=not options.quick if options.paper is None else options.paper,
        sensitivities=options.sensitivities or (),
        drawn=options.uncertainty,
        mesh_error=(
            has_second(case) and not options.quick
            if options.mesh_error is None
            else options.mesh_error
        ),
    )
