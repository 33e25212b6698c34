"""The 0D pipeline of one patient: α at rest, then rest and every stress condition."""

import dataclasses
import math
from collections.abc import Iterator, Mapping

import numpy as np

from calibration import REST_RULE, RatioResponse, through_calibration
from diagnosis import RatioGap, ratio_gap
from lumped import ML_PER_MIN, MMHG
from study.case.model import Case, require
from study.run.patient import Model, Patient, load_patient
from study.run.progress import Progress
from study.run.tuning import (
    Calibration,
    Curve,
    alpha_curve,
    calibrate_patient,
    calibration_steps,
    ratio_error,
    respond,
    tune,
)
from study.store.result_names import CALIBRATED, FIXED


@dataclasses.dataclass(frozen=True)
class Run:
    """One periodic state: a condition under a law, a stress rule and a boundary condition.

    Attributes:
        condition: name of the condition.
        law: `linear` or `quadratic`.
        rule: name of the stress rule; None at rest.
        boundary: `fixed` or `calibrated`.
        alpha: scale of the outlet's resistances [-].
        ratio: mean distal over mean aortic pressure [-].
        ratio_sd: its standard deviation from the error of the measured resting ratio [-].
        ifr: instantaneous wave-free ratio [-].
        mean_P_aorta: [dyn/cm²].
        mean_P_distal: [dyn/cm²].
        mean_Q: mean flow [cm³/s].
        systolic_share: share of the flow that passes in systole [-].
        t: times [s].
        P_aorta: at these times [dyn/cm²].
        P_distal: at these times [dyn/cm²].
        Q: coronary flow at these times [cm³/s].
        floquet_multiplier: factor by which a disturbance shrinks in a cycle [-].
        error_estimate: of the periodic state, relative [-].
        at_fixed_alpha: ∂ log ratio / ∂ log parameter [-].
        recalibrated: the same with α retuned; empty at rest and for the fixed boundary.
        gap: predicted less measured ratio; None without a measurement.
    """

    condition: str
    law: str
    rule: str | None
    boundary: str
    alpha: float
    ratio: float
    ratio_sd: float
    ifr: float
    mean_P_aorta: float
    mean_P_distal: float
    mean_Q: float
    systolic_share: float
    t: np.ndarray
    P_aorta: np.ndarray
    P_distal: np.ndarray
    Q: np.ndarray
    floquet_multiplier: float
    error_estimate: float
    at_fixed_alpha: dict[str, float]
    recalibrated: dict[str, float]
    gap: RatioGap | None

    @property
    def flow_ml_per_min(self) -> float:
        """Mean coronary flow [mL/min]."""
        return self.mean_Q / ML_PER_MIN

    @property
    def drop_mmHg(self) -> float:
        """Mean pressure drop over the artery [mmHg]."""
        return (self.mean_P_aorta - self.mean_P_distal) / MMHG


@dataclasses.dataclass(frozen=True)
class CaseResult:
    """All that the pipeline found for a patient.

    Attributes:
        patient: the patient.
        calibrations: α by law, the case's own law first.
        curves: resting ratio over α, by law.
        runs: every condition, law, rule and boundary condition; own law and rule first.
        failures: laws other than the case's own that could not be calibrated, with the reason.
    """

    patient: Patient
    calibrations: dict[str, Calibration]
    curves: dict[str, Curve]
    runs: list[Run]
    failures: dict[str, str]

    def run(
        self,
        condition: str,
        *,
        boundary: str = CALIBRATED,
        law: str | None = None,
        rule: str | None = None,
    ) -> Run:
        """The run of a condition; by default calibrated, with the case's own law and rule."""
        case = self.patient.case
        law = law or case.surrogate.law
        rule = None if condition == "rest" else rule or case.stress.rule
        wanted = (condition, law, rule, boundary)
        return next(r for r in self.runs if (r.condition, r.law, r.rule, r.boundary) == wanted)


def run_case(case: Case, *, progress: Progress | None = None) -> CaseResult:
    """Calibrate a patient at rest and predict every condition under every reading.

    Args:
        case: the case.
        progress: told of each step.

    Raises:
        CaseError: the case lacks something, or cannot be calibrated.
        RuntimeError: a computation did not converge.
    """
    require(case, "run")
    progress = progress or Progress()
    patient = load_patient(case)
    later = {f"predicting, {law} law": 1.0 for law in patient.models} | {"writing the report": 3.0}
    progress.plan({"reading": 1.0, **calibration_steps(patient), **later})
    calibrations, failures = calibrate_patient(patient, progress)
    alphas = [fit.alpha for fit in calibrations.values()]
    low, high = min(*alphas, 1.0) / 5.0, max(*alphas, 1.0) * 5.0
    runs: list[Run] = []
    curves: dict[str, Curve] = {}
    for law, fit in calibrations.items():
        progress.step(f"predicting, {law} law")
        model = patient.models[law]
        runs += _runs(patient, model, fit)
        curves[law] = alpha_curve(patient, model, low, high)
    return CaseResult(patient, calibrations, curves, runs, failures)


def _runs(patient: Patient, model: Model, fit: Calibration) -> Iterator[Run]:
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
