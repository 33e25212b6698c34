"""The 0D pipeline of one patient: α at rest, then rest and every stress condition."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from calibration import REST_RULE, RatioResponse, through_calibration
from diagnosis import ratio_gap
from study.case.model import Case, require
from study.run.patient import Patient, ReducedModel, load_patient, ratio_error
from study.run.progress import Progress
from study.run.ratio_uncertainty import uncertain_ratios
from study.run.reduced_results import Calibration, CaseResult, RatioCurve, Run
from study.run.tuning import (
    alpha_curve,
    calibrate_patient,
    calibration_steps,
    respond,
    tune,
)
from study.store.result_names import CALIBRATED, FIXED


def run_case(
    case: Case, *, intervals: bool = False, progress: Progress | None = None
) -> CaseResult:
    """Calibrate a patient at rest and predict every condition under every reading.

    Args:
        case: the case.
        intervals: whether each FFR gets an interval.
        progress: told of each step.

    Raises:
        CaseError: the case lacks something, or cannot be calibrated.
        RuntimeError: a computation did not converge.
    """
    require(case, "run")
    progress = progress or Progress()
    patient = load_patient(case)
    later = {f"predicting, {law} law": 1.0 for law in patient.models} | {"writing the report": 3.0}
    if intervals:
        later |= {f"uncertainty, {name}": 8.0 for name in patient.stresses}
    progress.plan({"reading": 1.0, **calibration_steps(patient), **later})
    calibrations, failures = calibrate_patient(patient, progress)
    alphas = [fit.alpha for fit in calibrations.values()]
    low, high = min(*alphas, 1.0) / 5.0, max(*alphas, 1.0) * 5.0
    runs: list[Run] = []
    curves: dict[str, RatioCurve] = {}
    for law, fit in calibrations.items():
        progress.step(f"predicting, {law} law")
        model = patient.models[law]
        runs += _runs(patient, model, fit)
        curves[law] = alpha_curve(patient, model, low, high)
    uncertain = None
    if intervals:
        uncertain = uncertain_ratios(patient, progress)
    return CaseResult(patient, calibrations, curves, runs, failures, uncertain)


def _runs(patient: Patient, model: ReducedModel, fit: Calibration) -> Iterator[Run]:
    """All conditions of one law, calibrated and fixed; rest comes first."""
    stresses = [(name, rule) for name in patient.stresses for rule in patient.rules]
    for boundary, alpha in ((CALIBRATED, fit.alpha), (FIXED, 1.0)):
        surrogate = tune(model.surrogate, alpha)
        rest: dict[str, float] = {}
        for name, rule in [("rest", None), *stresses]:
            factors = REST_RULE if rule is None else patient.rules[rule]
            response = respond(patient, surrogate, patient.conditions[name], rule=factors)
            slopes = _floats(response.sensitivity)
            rest = rest or slopes
            tuned = {"rest_ratio": 1.0}
            if name != "rest":
                tuned = _floats(through_calibration(slopes, rest))
            setting = {"condition": name, "law": model.law, "rule": rule, "boundary": boundary}
            yield _run(
                patient, response, setting, fit, slopes, tuned if boundary == CALIBRATED else {}
            )


def _run(
    patient: Patient,
    response: RatioResponse,
    setting: Mapping[str, str | None],
    fit: Calibration,
    slopes: dict[str, float],
    tuned: dict[str, float],
) -> Run:
    """Gather one run; `tuned` is empty with the fixed boundary."""
    solution, numbers = response.solution, response.metrics
    conditions = patient.case.conditions
    name, ratio = setting["condition"], float(numbers.ratio)
    assert name is not None
    relative = ratio_error(conditions["rest"]) / fit.target
    sd = abs(tuned.get("rest_ratio", 0.0)) * relative * ratio
    measured, gap = conditions[name].ffr, None
    if measured is not None:
        gap = ratio_gap(ratio, measured, math.hypot(sd, ratio_error(conditions[name])))
    return Run(
        **setting,  # pyright: ignore[reportArgumentType]
        alpha=fit.alpha if tuned else 1.0,
        ratio=ratio,
        ratio_sd=sd,
        ifr=float(numbers.ifr),
        mean_P_aorta=float(numbers.mean_P_aorta),
        mean_P_distal=float(numbers.mean_P_distal),
        mean_Q=float(numbers.mean_Q),
        systolic_share=float(numbers.systolic_share),
        t=np.asarray(solution.t),
        P_aorta=np.asarray(solution.pressure("aorta")),
        P_distal=np.asarray(solution.pressure("distal")),
        Q=np.asarray(solution.flow("ostium")),
        floquet_multiplier=solution.floquet_multiplier,
        error_estimate=float(solution.error_estimate),
        at_fixed_alpha=slopes,
        recalibrated=tuned,
        gap=gap,
    )


def _floats(values: Mapping[str, object]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}  # pyright: ignore[reportArgumentType]
