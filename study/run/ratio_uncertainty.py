"""FFR of every condition under stress with an interval, its causes and what would shrink it.

Each number of the case has a distribution (`calibration.patient_inputs`; those that the body tells
have that of `calibration.body_priors`), and α is tuned to the
resting ratio in each sample of them. The response of the bed to stress is not one of the published
rules but what flow reserves in the literature leave open, or what the case says of it; a measured
flow reserve narrows it.

Without quadratic loss each sample is exact. With it the samples are those of means, which a few
periodic states correct; runs in 3D, where there are any, correct those.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp

from calibration import (
    AbstractSpread,
    Evidence,
    LogNormal,
    MeasurementErrors,
    Runs,
    StressEvidence,
    StressRatio,
    Truncated,
    Uncertainty,
    evaluate,
    patient_inputs,
    stress_evidence,
    uncertainty,
)
from calibration.stress_ratio import REST_PREFIX
from lumped import MMHG
from lumped.nominal import RESERVE_ERROR
from study.case.condition import Condition
from study.case.model import Case
from study.run.patient import Patient, ratio_error
from study.run.progress import Progress
from study.run.reduced_results import Intervals, UncertainRatio

N_SAMPLES = 2**14
N_RUNS = 2**7
"""Periodic states, of a patient with quadratic loss, behind the samples."""

ADULT_YEARS = 18.0
P_VENOUS_ERROR = 2.0 * MMHG
"""Of a venous pressure that a case gives [dyn/cm²]: catheter in the right atrium, level of zero."""

_DRUGS = ("adenosine", "dobutamine")


def uncertain_ratios(
    patient: Patient,
    progress: Progress,
    *,
    runs_in_3d: Mapping[str, Runs] | None = None,
    n_samples: int = N_SAMPLES,
) -> Intervals:
    """FFR of every condition under stress, with the case's own law of the artery.

    Args:
        patient: the patient, with a measured resting ratio.
        progress: told of each condition.
        runs_in_3d: FFR in 3D beside that in 0D, by condition; where it is given, conditions
            without runs have no interval.
        n_samples: samples of each.

    Raises:
        RuntimeError: no condition has an interval, since the numbers of the case contradict each
            other.
    """
    found, failures = [], {}
    for name in patient.stresses:
        if runs_in_3d is not None and name not in runs_in_3d:
            continue
        progress.step(f"uncertainty, {name}")
        runs = [] if runs_in_3d is None else [runs_in_3d[name]]
        try:
            found.append(_uncertain(patient, name, runs, n_samples))
        except RuntimeError as error:
            failures[name] = str(error)
    if failures and not found:
        raise RuntimeError(" ".join(failures.values()))
    return Intervals(found, failures)


def _uncertain(
    patient: Patient, name: str, runs_in_3d: Sequence[Runs], n_samples: int
) -> UncertainRatio:
    case, entry = patient.case, patient.case.conditions[name]
    model, response = stress_model(patient, name), response_to_stress(case, name)
    reserve = _reserve(entry)
    measured = [] if reserve is None else [Evidence(model.reserve, *reserve)]
    try:
        inputs = condition_inputs(patient, name)
        found = ratio_uncertainty(
            model, inputs, measured, runs_in_3d=runs_in_3d, n_samples=n_samples
        )
    except (RuntimeError, ValueError) as error:
        keys = "[uncertainty]" if reserve is None else "flow_reserve, [uncertainty]"
        raise RuntimeError(
            f"no interval of FFR under {name}: {error} (keys: [condition.{name}], {keys})"
        ) from error
    factors = {rule: float(stress_model(patient, name, rule).bed_factor) for rule in patient.rules}
    return UncertainRatio(name, found, response, factors, reserve)


def stress_model(patient: Patient, condition: str, rule: str | None = None) -> StressRatio:
    """The patient from rest to a condition, with a stress rule; None: that of the case."""
    rest = patient.case.conditions["rest"]
    assert rest.ffr is not None
    return StressRatio(
        patient.model.surrogate,
        patient.conditions["rest"],
        patient.conditions[condition],
        patient.rules[rule or patient.case.stress.rule],
        rest.ffr,
    )


def condition_inputs(patient: Patient, condition: str) -> dict[str, AbstractSpread]:
    """Distribution of each number that FFR of a condition follows from."""
    case = patient.case
    errors = _errors(case, ratio_error(case.conditions["rest"]))
    model, response = stress_model(patient, condition), response_to_stress(case, condition)
    inputs = patient_inputs(model, response, errors)
    return {**inputs, **{n: s for n, s in _from_body(case).items() if n in inputs}}


def _from_body(case: Case) -> dict[str, AbstractSpread]:
    """Distributions of numbers that the case does not give and its body tells.

    Pressures are cut off at 45 % of their distance, so that systolic ones stay above diastolic
    ones.
    """
    assumed, rest = case.from_body.assumed, case.conditions["rest"]
    found: dict[str, AbstractSpread] = {}
    reach = 0.45 * (rest.P_systolic - rest.P_diastolic)
    for name in ("P_systolic", "P_diastolic"):
        entry = assumed.get(f"condition.rest.{name}")
        if entry is not None and entry.sd:
            low, high = entry.value - reach, entry.value + reach
            found[REST_PREFIX + name] = Truncated(entry.value, entry.sd, low, high)
    for key, name in (("condition.rest.period", f"{REST_PREFIX}period"), ("surrogate.R0", "R0")):
        if key in assumed:
            found[name] = LogNormal(assumed[key].value, assumed[key].log_sd or 0.0)
    return found


def ratio_uncertainty(
    model: StressRatio,
    inputs: Mapping[str, AbstractSpread],
    evidence: Sequence[Evidence],
    *,
    runs_in_3d: Sequence[Runs] = (),
    n_samples: int = N_SAMPLES,
) -> Uncertainty:
    """The uncertainty of FFR of a patient.

    Args:
        model: the patient in 0D.
        inputs: see `calibration.uncertainty`.
        evidence: likewise.
        runs_in_3d: FFR in 3D beside that of `model`.
        n_samples: see `calibration.uncertainty`.
    """
    quick, runs = model.ffr, list(runs_in_3d)
    if model.surrogate.K is not None:
        medians = {name: spread.value(jnp.zeros(())) for name, spread in inputs.items()}
        form = model.with_values(medians).form_factors
        quick = eqx.Partial(model.ffr_of_means, form=form)
        runs.insert(0, evaluate(model.ffr, quick, inputs, N_RUNS, name="periodic states"))
    return uncertainty(
        quick, inputs, evidence=evidence, runs=runs, bounds=(0.0, 1.0), n_samples=n_samples
    )


def response_to_stress(case: Case, condition: str) -> StressEvidence:
    """What is known of the bed and the slit in a condition: from the case, else the literature."""
    known = case.uncertainty
    named = [drug for drug in _DRUGS if drug in condition.lower()]
    entry = case.conditions.get(condition)
    drug = (entry.drug if entry else None) or (named[0] if named else "other")
    age = "unknown"
    if case.body.age_years is not None:
        age = "adult" if case.body.age_years >= ADULT_YEARS else "child"
    found = stress_evidence(drug, age)
    if known.bed_factor is not None:
        found = found._replace(
            bed_factor=LogNormal(known.bed_factor, known.bed_factor_sd),
            source="the case",
            pooled=False,
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
        P_venous=venous_range(case),
    )


def venous_range(case: Case) -> tuple[float, float]:
    """Least and largest venous pressure: about that of the case where it gives one [dyn/cm²]."""
    given = case.coronary.P_venous
    if given == 0.0:
        return case.uncertainty.P_venous_low, case.uncertainty.P_venous_high
    return given - P_VENOUS_ERROR, given + P_VENOUS_ERROR
