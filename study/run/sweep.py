"""A sweep over α of one patient in one condition."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from calibration import Sweep, sweep_alpha
from lumped import ML_PER_MIN, MMHG, HaemodynamicCondition
from study.case.faults import CaseError, Fault
from study.case.model import Case, require
from study.run.patient import Patient, load_patient
from study.run.sweep_parts import SweepResult, SweepRow
from study.store.document_rows import ratio_name

LARGEST_ERROR = 1e-2
"""A nonlinear periodic state with a larger estimated error was not found [-]."""


def sweep_case(
    case: Case, alphas: np.ndarray, *, condition: str = "rest", rule: str | None = None
) -> SweepResult:
    """Ratios and means of a patient over α, under the case's own law.

    Args:
        case: the case.
        alphas: scales of the outlet's resistances [-], shape (n,).
        condition: name of the condition.
        rule: stress rule; by default the case's own. Not allowed at rest.

    Raises:
        CaseError: the case lacks something, or has no such condition or rule.
        RuntimeError: a computation did not converge.
    """
    require(case, "sweep")
    patient = load_patient(case)
    rule = _check(patient, condition, rule)
    sweep = sweep_alpha(
        patient.model.surrogate,
        _spread(patient.conditions[condition], len(alphas)),
        jnp.asarray(alphas),
        rule=None if rule is None else patient.rules[rule],
        waveforms=False,
    )
    _require_solved(sweep, alphas, linear=patient.model.surrogate.K is None)
    return SweepResult(
        patient=case.id,
        law=patient.model.law,
        condition=condition,
        rule=rule,
        measured=case.conditions[condition].ffr,
        error_estimate=float(np.max(np.asarray(sweep.error_estimate))),
        rows=_rows(sweep, alphas, ratio_name(condition)),
    )


def _check(patient: Patient, condition: str, rule: str | None) -> str | None:
    """The rule to use; refuses names that the case does not have."""
    path = patient.case.path
    if condition not in patient.conditions:
        cure = f"--condition takes one of {', '.join(patient.conditions)}"
        fault = Fault(path, "condition", condition, "no such condition in the case", "", cure)
        raise CaseError([fault])
    if condition == "rest":
        if rule is not None:
            cure = "leave --rule out, or name a stress condition with --condition"
            raise CaseError([Fault(path, "stress.rule", rule, "rest has no stress rule", "", cure)])
        return None
    rule = rule or patient.case.stress.rule
    if rule not in patient.rules:
        cure = f"--rule takes one of {', '.join(patient.rules)}"
        raise CaseError([Fault(path, "stress.rule", rule, "no such rule here", "", cure)])
    return rule


def _spread(condition: HaemodynamicCondition, count: int) -> HaemodynamicCondition:
    """A measured beat repeated for every case of the batch: its samples are no batch axis."""
    repeated = jax.tree.map(
        lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), condition.waveform
    )
    return eqx.tree_at(lambda c: c.waveform, condition, repeated, is_leaf=lambda leaf: leaf is None)


def _require_solved(sweep: Sweep, alphas: np.ndarray, *, linear: bool) -> None:
    """Refuse numbers of states that were not found; a linear state always is, if it is finite."""
    good = np.isfinite(np.asarray(sweep.metrics.ratio))
    if not linear:
        good &= np.asarray(sweep.error_estimate) < LARGEST_ERROR
    if not np.all(good):
        bad = alphas[~good]
        raise RuntimeError(
            f"No periodic state was found for {bad.size} of {good.size} values of alpha, "
            f"{bad.min():g} to {bad.max():g}. Sweep a narrower range."
        )


def _rows(sweep: Sweep, alphas: np.ndarray, name: str) -> list[SweepRow]:
    numbers = sweep.metrics
    columns: dict[str, Any] = {
        "alpha": alphas,
        name: numbers.ratio,
        "ifr": numbers.ifr,
        "mean_P_aorta_mmHg": numbers.mean_P_aorta / MMHG,
        "mean_P_distal_mmHg": numbers.mean_P_distal / MMHG,
        "mean_flow_ml_per_min": numbers.mean_Q / ML_PER_MIN,
        "systolic_share": numbers.systolic_share,
    }
    lists = {key: np.asarray(values).tolist() for key, values in columns.items()}
    rows = zip(*lists.values(), strict=True)
    return [SweepRow(**dict(zip(lists, row, strict=True))) for row in rows]
