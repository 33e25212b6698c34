"""What the 0D pipeline finds for a patient, as plain classes."""

import dataclasses
from typing import NamedTuple

import numpy as np

from calibration import StressEvidence, Uncertainty
from diagnosis import RatioGap
from lumped import ML_PER_MIN, MMHG
from study.run.patient import Patient
from study.store.result_names import CALIBRATED


class RatioCurve(NamedTuple):
    """Resting ratio over α."""

    alpha: np.ndarray
    ratio: np.ndarray


@dataclasses.dataclass(frozen=True)
class Calibration:
    """α of one law, found in several ways.

    Attributes:
        law: `linear` or `quadratic`.
        target: measured resting ratio [-].
        alpha: the scale of the outlet's resistances, by Newton's method [-].
        iterations: its steps.
        ratio: resting ratio that the model has with it [-].
        closed_form: α of the divider; None where the law is not linear [-].
        bisection: α by bisection, as in the paper [-]; None where α lies outside 1e-4 .. 1e4.
        bisection_iterations: its evaluations of the model.
        sd_log: standard deviation of log α from the error of the measured ratio [-].
        by: ∂ log α / ∂ log p, the measured ratio kept, for each parameter p, and for the measured
            ratio itself, `rest_ratio` [-].
    """

    law: str
    target: float
    alpha: float
    iterations: int
    ratio: float
    closed_form: float | None
    bisection: float | None
    bisection_iterations: int
    sd_log: float
    by: dict[str, float]


class Tuning(NamedTuple):
    """What was tuned.

    Attributes:
        calibrations: α by law, the case's own law first.
        failures: other laws that could not be calibrated, with the reason.
    """

    calibrations: dict[str, Calibration]
    failures: dict[str, str]


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


class UncertainRatio(NamedTuple):
    """FFR of a condition with its uncertainty.

    Attributes:
        condition: its name.
        found: the uncertainty.
        evidence: what the response to stress is taken from.
        bed_factors: of the stress rules, by name, on the scale of the evidence.
        flow_reserve: measured one with its standard deviation; None where there is none.
    """

    condition: str
    found: Uncertainty
    evidence: StressEvidence
    bed_factors: dict[str, float]
    flow_reserve: tuple[float, float] | None


class Intervals(NamedTuple):
    """FFR with intervals.

    Attributes:
        found: of each condition that has one.
        failures: why a condition has none.
    """

    found: list[UncertainRatio]
    failures: dict[str, str]


@dataclasses.dataclass(frozen=True)
class CaseResult:
    """All that the pipeline found for a patient.

    Attributes:
        patient: the patient.
        calibrations: α by law, the case's own law first.
        curves: resting ratio over α, by law.
        runs: every condition, law, rule and boundary condition; own law and rule first.
        failures: laws other than the case's own that could not be calibrated, with the reason.
        uncertainty: FFR of each condition under stress with its interval; None: not asked for.
    """

    patient: Patient
    calibrations: dict[str, Calibration]
    curves: dict[str, RatioCurve]
    runs: list[Run]
    failures: dict[str, str]
    uncertainty: Intervals | None = None

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
