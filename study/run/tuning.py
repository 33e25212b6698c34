"""α of one patient at rest, under each law of the artery and in several ways."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from calibration import (
    REST_RULE,
    RatioResponse,
    alpha_closed_form,
    alpha_response,
    bisect_alpha,
    calibrate_alpha,
    ratio_response,
    require_feasible,
)
from lumped import (
    AbstractPeriodicSolver,
    HaemodynamicCondition,
    Propagator,
    Shooting,
    StressRule,
    Surrogate,
    raise_unless_successful,
)
from lumped.device import quick_jit
from study.case.faults import CaseError, Fault
from study.case.model import Case, require
from study.run.patient import Patient, ReducedModel, load_patient, ratio_error
from study.run.progress import Progress
from study.run.reduced_results import Calibration, RatioCurve, Tuning

CURVE_POINTS = 21


_respond = quick_jit(ratio_response)
_bisect = quick_jit(functools.partial(bisect_alpha, throw=False))


def calibrate_case(case: Case, *, progress: Progress | None = None) -> tuple[Patient, Tuning]:
    """Find α of a patient at rest under each law.

    Args:
        case: the case.
        progress: told of each step.

    Raises:
        CaseError: the case lacks something, or cannot be calibrated.
        RuntimeError: a computation did not converge.
    """
    require(case, "calibrate")
    progress = progress or Progress()
    patient = load_patient(case)
    progress.plan(calibration_steps(patient))
    return patient, calibrate_patient(patient, progress)


def calibration_steps(patient: Patient) -> dict[str, float]:
    """Seconds that each step usually takes on two cores when nothing is compiled yet."""
    usual = {"linear": 6.0, "quadratic": 30.0}
    return {_step_name(law): usual[law] for law in patient.models}


def _step_name(law: str) -> str:
    return f"calibrating, {law} law"


def calibrate_patient(patient: Patient, progress: Progress) -> Tuning:
    """Find α under each law; errors as for `calibrate_case`, of the case's own law only."""
    found: dict[str, Calibration] = {}
    failures: dict[str, str] = {}
    for law, model in patient.models.items():
        progress.step(_step_name(law))
        try:
            found[law] = calibrate_model(patient, model)
        except (ValueError, RuntimeError) as error:
            if law == patient.case.surrogate.law:
                raise
            failures[law] = error.faults[0].problem if isinstance(error, CaseError) else str(error)
    return Tuning(found, failures)


def calibrate_model(patient: Patient, model: ReducedModel) -> Calibration:
    """Find α of one law by Newton's method, bisection and, where it holds, the closed form."""
    case, rest, surrogate = patient.case, patient.conditions["rest"], model.surrogate
    target = case.conditions["rest"].ffr
    assert target is not None, "checked by require()"
    try:
        require_feasible(surrogate, rest, target)
    except ValueError as error:
        problem = f"cannot be reached with the {model.law} law: {error}"
        cure = "check ffr, the pressures, P_venous and the resistance of the artery"
        fault = Fault(case.path, "condition.rest.ffr", target, problem, "", cure)
        raise CaseError([fault]) from error
    solver = periodic_solver(case, surrogate)
    shooting = solver if isinstance(solver, Shooting) else None
    newton = calibrate_alpha(surrogate, rest, target, solver=shooting)
    goal = jnp.asarray(target, float)  # a Python number would be compiled in, anew for each case
    bisection = _bisect(surrogate, rest, goal, solver=solver)
    bracketed = bool(bisection.result == optx.RESULTS.successful)
    alpha = float(newton.alpha)
    response = respond(patient, tune(surrogate, alpha), rest)
    moved = alpha_response(response.sensitivity)
    return Calibration(
        law=model.law,
        target=target,
        alpha=alpha,
        iterations=int(newton.iterations),
        ratio=float(response.metrics.ratio),
        closed_form=None
        if surrogate.K is not None
        else float(alpha_closed_form(surrogate, rest, target)),
        bisection=float(bisection.alpha) if bracketed else None,
        bisection_iterations=int(bisection.iterations),
        sd_log=abs(float(moved["rest_ratio"])) * ratio_error(case.conditions["rest"]) / target,
        by={name: float(slope) for name, slope in moved.items()},
    )


def alpha_curve(patient: Patient, model: ReducedModel, low: float, high: float) -> RatioCurve:
    """Resting ratio of one law over α."""
    rest = patient.conditions["rest"]
    alphas = np.geomspace(low, high, CURVE_POINTS)
    ratios = [
        float(respond(patient, tune(model.surrogate, alpha), rest).metrics.ratio)
        for alpha in alphas
    ]
    return RatioCurve(alphas, np.array(ratios))


def respond(
    patient: Patient,
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    *,
    rule: StressRule = REST_RULE,
) -> RatioResponse:
    """Periodic state, metrics and sensitivities of a surrogate, checked.

    Raises:
        RuntimeError: the periodic state was not found.
    """
    solver = periodic_solver(patient.case, surrogate)
    response = _respond(surrogate, condition, rule=rule, solver=solver)
    raise_unless_successful(
        response.solution.result,
        f"This was alpha = {float(surrogate.alpha):g}. Try more steps a cycle (n_steps below "
        '[solver]), or law = "linear".',
    )
    return response


def periodic_solver(case: Case, surrogate: Surrogate) -> AbstractPeriodicSolver:
    """The accurate solver for a surrogate, with the number of steps that the case asks for."""
    steps = {} if case.solver.n_steps is None else {"n_steps": case.solver.n_steps}
    return Propagator(**steps) if surrogate.K is None else Shooting(**steps)


def tune(surrogate: Surrogate, alpha: float) -> Surrogate:
    """The surrogate with another α."""
    return eqx.tree_at(lambda s: s.alpha, surrogate, np.asarray(alpha, dtype=float))
