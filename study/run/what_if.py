"""What an operation would change, in 0D: the artery's loss from its lumen, the bed as calibrated.

With ΔP = R0 Q + K Q|Q| of the lumen before and after (`calibration.lumen_law`), the losses of the
case are scaled by the same factors::

    R0' = R0 · R0(lumen after)/R0(lumen before),   K' likewise

α, the scale of the bed, is tuned to the measured resting ratio before, and kept: an operation on
the artery does not change the bed. The linear law takes the slopes at 40 mmHg.
"""

import dataclasses
import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from calibration import REST_RULE, PressureFlowLaw, lumen_law
from jaxfsi import Lumen
from jaxfsi.anatomy import Anatomy, vessel_sections
from lumped import MM, Surrogate
from study.case.anatomy import IvusAnatomy, SyntheticAnatomy
from study.case.faults import CaseError, Fault
from study.case.laws import QUADRATIC
from study.case.model import Case, require
from study.case.operation import Operation
from study.run.anatomy_source import case_anatomy
from study.run.patient import TANGENT_DROP
from study.run.pipeline import run_case
from study.run.progress import Progress
from study.run.reduced_results import CaseResult
from study.run.tuning import respond, tune
from study.run.what_if_parts import OperatedLumen, OperatedRatio, WhatIf
from study.store.result_files import AFTER_FOLDER, BEFORE_FOLDER

BEFORE, AFTER = BEFORE_FOLDER, AFTER_FOLDER
"""Folders of the two sides."""


class Sides(NamedTuple):
    """The anatomy of a case before and after an operation.

    Attributes:
        before: as the case describes it.
        after: after the operation.
    """

    before: Anatomy
    after: Anatomy


def operated_case(case: Case, operation: Operation) -> Case:
    """The case after an operation."""
    return dataclasses.replace(case, operation=operation)


def both_sides(case: Case, operation: Operation) -> Sides:
    """The anatomy before and after; a case that has none to operate on is refused.

    Raises:
        CaseError: what is missing, or why the operation cannot be made.
    """
    require(case, "study")
    if not isinstance(case.anatomy, IvusAnatomy | SyntheticAnatomy):
        kind = None if case.anatomy is None else case.anatomy.kind
        problem = "an operation changes sections of the artery, and there are none"
        cure = 'give an [anatomy] with kind = "ivus" or "synthetic"'
        allowed = '"ivus" | "synthetic"'
        raise CaseError([Fault(case.path, "anatomy.kind", kind, problem, allowed, cure)])
    return Sides(case_anatomy(case), case_anatomy(operated_case(case, operation)))


def lumen_of(anatomy: Anatomy) -> Lumen:
    """Sections of the anomalous artery as a lumen."""
    sections = vessel_sections(anatomy)
    return Lumen(jnp.asarray(sections.contours), jnp.asarray(sections.s))


def aortic_area(anatomy: Anatomy) -> float:
    """Area of the aorta half-way along it [cm²]."""
    half_width = anatomy.vessels[0].half_width
    return math.pi * float(half_width[len(half_width) // 2]) ** 2


def operated_lumen(anatomy: Anatomy, R0: float, K: float | None, folder: str) -> OperatedLumen:
    """The artery on one side.

    Args:
        anatomy: of this side.
        R0: resistance of the artery in the model [dyn·s/cm⁵].
        K: of its quadratic term [dyn·s²/cm⁸]; None under the linear law.
        folder: of what was computed on this side.
    """
    lumen = lumen_of(anatomy)
    calipers = lumen.calipers
    return OperatedLumen(
        length_mm=float(anatomy.centerlines["anomalous"].s[-1]) / MM,
        s_mm=_list(lumen.s / MM),
        area_mm2=_list(lumen.area / MM**2),
        major_axis_mm=_list(calipers.major / MM),
        minor_axis_mm=_list(calipers.minor / MM),
        R0=R0,
        K=K,
        folder=folder,
    )


def what_if_0d(
    case: Case, operation: Operation, sides: Sides, progress: Progress | None = None
) -> tuple[WhatIf, CaseResult]:
    """Ratios before and after an operation in 0D.

    Args:
        case: the case.
        operation: the operation.
        sides: see `both_sides`.
        progress: told of each step.

    Returns:
        What it changes, and all results before.

    Raises:
        CaseError: the case lacks something, or cannot be calibrated.
        RuntimeError: a computation did not converge.
    """
    laws = [_law(case, anatomy) for anatomy in sides]
    case = _with_losses(case, laws[0])
    result = run_case(case, progress=progress)
    law = QUADRATIC if QUADRATIC in result.calibrations else case.surrogate.law
    before, alpha = result.patient.models[law].surrogate, result.calibrations[law].alpha
    after = scaled_losses(before, *laws)
    numbers = [(float(s.R0), None if s.K is None else float(s.K)) for s in (before, after)]
    found = WhatIf(
        operation=operation.kind,
        diameter_mm=None if operation.diameter is None else operation.diameter / MM,
        mode="0d",
        law=law,
        alpha=alpha,
        before=operated_lumen(sides.before, *numbers[0], BEFORE),
        after=operated_lumen(sides.after, *numbers[1], AFTER),
        ratios=_ratios(result, law, tune(after, alpha)),
        remarks=[f"{result.patient.models[law].origin}; after the operation scaled by the lumen"],
    )
    return found, result


def scaled_losses(
    surrogate: Surrogate, before: PressureFlowLaw, after: PressureFlowLaw
) -> Surrogate:
    """The surrogate of a patient after an operation.

    Args:
        surrogate: before.
        before: law of the lumen before.
        after: law of the lumen after.
    """
    if surrogate.K is None:
        factor = after.tangent(TANGENT_DROP) / before.tangent(TANGENT_DROP)
        return eqx.tree_at(lambda s: s.R0, surrogate, surrogate.R0 * factor)
    R0, K = surrogate.R0 * after.R0 / before.R0, surrogate.K * after.K / before.K
    return eqx.tree_at(lambda s: (s.R0, s.K), surrogate, (R0, K))


def _law(case: Case, anatomy: Anatomy) -> PressureFlowLaw:
    """Loss of the lumen of one side."""
    blood, area = case.blood, aortic_area(anatomy)
    return lumen_law(lumen_of(anatomy), mu=blood.mu, rho=blood.rho_f, area_upstream=area)


def _with_losses(case: Case, law: PressureFlowLaw) -> Case:
    """The case with the losses of its lumen, where it gives none and contours tell none."""
    if case.surrogate.R0 is not None or isinstance(case.anatomy, IvusAnatomy):
        return case
    losses = dataclasses.replace(case.surrogate, R0=float(law.R0), K=float(law.K), law=QUADRATIC)
    return dataclasses.replace(case, surrogate=losses)


def _ratios(result: CaseResult, law: str, after: Surrogate) -> list[OperatedRatio]:
    """Every condition and stress rule, the case's own rule first."""
    patient = result.patient
    settings = [("rest", None), *((s, r) for s in patient.stresses for r in patient.rules)]
    found = []
    for name, rule in settings:
        own = result.run(name, law=law, rule=rule)
        factors = REST_RULE if rule is None else patient.rules[rule]
        numbers = respond(patient, after, patient.conditions[name], rule=factors).metrics
        found.append(
            OperatedRatio(
                condition=name,
                rule=rule,
                measured=patient.case.conditions[name].ffr,
                before=own.ratio,
                after=float(numbers.ratio),
                flow_before_ml_per_min=own.flow_ml_per_min,
                flow_after_ml_per_min=float(numbers.flow_ml_per_min),
            )
        )
    return found


def _list(values: object) -> list[float]:
    return [float(f"{value:.6g}") for value in np.asarray(values).tolist()]
