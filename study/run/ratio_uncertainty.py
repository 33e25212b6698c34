"""FFR of every condition under stress with an interval, its causes and what would shrink it.

Each number of the case has a distribution (`calibration.patient_inputs`), and α is tuned to the
resting ratio in each sample of them. The response of the bed to stress is not one of the published
rules but what flow reserves in the literature leave open, or what the case says of it; a measured
flow reserve narrows it.
"""

from calibration import (
    Evidence,
    LogNormal,
    MeasurementErrors,
    StressEvidence,
    StressRatio,
    patient_inputs,
    stress_evidence,
    uncertainty,
)
from study.case.condition import Condition
from study.case.model import Case
from study.run.patient import Patient
from study.run.progress import Progress
from study.run.reduced_results import UncertainRatio

N_SAMPLES = 2**10
ADULT_YEARS = 18.0
RESERVE_ERROR = 0.15
"""Relative standard deviation of a measured flow reserve where none is given: that of two readings
of one (coronary thermodilution against Doppler)."""

_DRUGS = ("adenosine", "dobutamine")


def uncertain_ratios(
    patient: Patient, rest_sd: float, progress: Progress, *, n_samples: int = N_SAMPLES
) -> list[UncertainRatio]:
    """FFR of every condition under stress, with the case's own law of the artery.

    Args:
        patient: the patient, with a measured resting ratio.
        rest_sd: standard deviation of that ratio [-].
        progress: told of each condition.
        n_samples: samples of each.

    Raises:
        RuntimeError: the numbers of a case contradict each other, so that samples have no value.
    """
    return [_uncertain(patient, name, rest_sd, progress, n_samples) for name in patient.stresses]


def _uncertain(
    patient: Patient, name: str, rest_sd: float, progress: Progress, n_samples: int
) -> UncertainRatio:
    progress.step(f"uncertainty, {name}")
    case, entry = patient.case, patient.case.conditions[name]
    rest = case.conditions["rest"]
    assert rest.ffr is not None
    models = {
        rule: StressRatio(
            patient.model.surrogate,
            patient.conditions["rest"],
            patient.conditions[name],
            factors,
            rest.ffr,
        )
        for rule, factors in patient.rules.items()
    }
    model = models[case.stress.rule]
    response = response_to_stress(case, name)
    reserve = _reserve(entry)
    measured = [] if reserve is None else [Evidence(model.reserve, *reserve)]
    inputs = patient_inputs(model, response, _errors(case, rest_sd))
    try:
        found = uncertainty(model.ffr, inputs, evidence=measured, n_samples=n_samples)
    except RuntimeError as error:
        keys = "[uncertainty]" if reserve is None else "flow_reserve, [uncertainty]"
        raise RuntimeError(
            f"no interval of FFR under {name}: {error} (keys: [condition.{name}], {keys})"
        ) from error
    factors = {rule: float(m.bed_factor) for rule, m in models.items()}
    return UncertainRatio(name, found, response, factors, reserve)


def response_to_stress(case: Case, condition: str) -> StressEvidence:
    """What is known of the bed and the slit in a condition: from the case, else the literature."""
    known = case.uncertainty
    named = [drug for drug in _DRUGS if drug in condition.lower()]
    drug = named[0] if named else "other"
    age = "unknown"
    if known.age is not None:
        age = "adult" if known.age >= ADULT_YEARS else "child"
    found = stress_evidence(drug, age)
    if known.bed_factor is not None:
        found = found._replace(
            bed_factor=LogNormal(known.bed_factor, known.bed_factor_sd), source="the case"
        )
    if known.stress_loss is not None:
        found = found._replace(stress_loss=LogNormal(known.stress_loss, known.stress_loss_sd))
    return found


def _reserve(entry: Condition) -> tuple[float, float] | None:
    if entry.flow_reserve is None:
        return None
    return entry.flow_reserve, entry.flow_reserve_sd or RESERVE_ERROR * entry.flow_reserve


def _errors(case: Case, rest_sd: float) -> MeasurementErrors:
    known = case.uncertainty
    return MeasurementErrors(
        rest_ratio=rest_sd,
        pressure=known.pressure_sd,
        period=known.period_sd,
        loss=known.loss_sd,
        im_factor=known.im_factor_sd,
        P_venous=(known.P_venous_low, known.P_venous_high),
    )
