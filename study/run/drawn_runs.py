"""Runs in 3D beside the 0D model, from which the interval of FFR in 3D is learned.

A study's own runs under stress are such runs: 0D is asked for the same resting ratio as 3D has, and
the same stress rule. Where more are asked for, all numbers of a condition are drawn from what is
known of them (`study.run.ratio_uncertainty`), and 3D runs under stress with them; α is that of 0D
with the drawn resting numbers, times what the calibration in 3D corrected it by. The lumen is that
of the mesh in every run, so that R0, K and the factor of the losses stay what they are there.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from calibration import (
    STRESS_LOSS,
    AbstractSpread,
    Runs,
    StressRatio,
    calibrate_alpha,
    standard_normals,
)
from lumped.nominal import NOMINAL
from study.case.model import Case
from study.run.patient import Patient, moved_entry
from study.run.ratio_uncertainty import condition_inputs, stress_model
from study.run.results import PlannedRun, Run3D, RunId
from study.run.run_3d import LumenCollapsed, fsi_run
from study.run.run_context import RunContext
from study.store.result_names import DRAWN

EXPECTED_ERROR = 0.02
"""What 0D, corrected by runs in 3D, is expected to miss of FFR before any run; with the bundled
patient 0.007."""

_OF_THE_MESH = ("R0", "K", STRESS_LOSS)


def runs_beside_0d(
    context: RunContext,
    patient: Patient,
    rest: Run3D,
    stressed: Sequence[Run3D],
    n_drawn: int,
) -> dict[str, Runs]:
    """FFR in 3D beside that in 0D, by condition; without those that have no run in 3D.

    Args:
        context: see `RunContext`.
        patient: the patient in 0D, with the curve of the ramp.
        rest: the calibrated run at rest.
        stressed: runs under stress with its α.
        n_drawn: further runs of each condition, with drawn numbers.

    Raises:
        RuntimeError: a step of a run failed.
        KeyboardInterrupt: the user interrupted a run; what was computed is kept.
    """
    found = {}
    for name in patient.stresses:
        pairs = [
            (run.ratio, float(_at_rest(stress_model(patient, name, run.rule), rest)()))
            for run in stressed
            if run.condition == name and run.ratio is not None
        ]
        pairs += _drawn(context, patient, rest, name, n_drawn)
        if pairs:
            costly, cheap = np.array(pairs, float).T
            found[name] = Runs(costly, cheap, name="runs in 3D", error=EXPECTED_ERROR)
    return found


def drawn_step(condition: str, number: int) -> str:
    """Name of the step of a run with drawn numbers."""
    return f"3D: {condition}, drawn numbers {number}"


def _drawn(
    context: RunContext, patient: Patient, rest: Run3D, name: str, n: int
) -> list[tuple[float, float]]:
    """FFR in 3D and in 0D with drawn numbers; NaN in 3D where the lumen collapsed."""
    if n == 0:
        return []
    model, inputs = stress_model(patient, name), condition_inputs(patient, name)
    excess = rest.alpha / _alpha(_at_rest(model, rest))
    pairs = []
    for k, z in enumerate(standard_normals(n, len(inputs))[:n], start=1):
        values = drawn_values(inputs, z)
        drawn = model.with_values(values)
        case = drawn_case(context.case, name, drawn)
        context.progress.step(drawn_step(name, k))
        run = PlannedRun(RunId(f"{DRAWN}{k}", name, "factors"), _alpha(drawn) * excess)
        try:
            ratio = fsi_run(dataclasses.replace(context, case=case), run).ratio
        except LumenCollapsed:
            ratio = None
        pairs.append((np.nan if ratio is None else ratio, float(drawn())))
    return pairs


def drawn_values(inputs: Mapping[str, AbstractSpread], z: np.ndarray) -> dict[str, float]:
    """Values of the inputs at standard normal numbers, those of the mesh left out."""
    return {
        name: float(spread.value(jnp.asarray(number)))
        for (name, spread), number in zip(inputs.items(), z, strict=True)
        if name not in _OF_THE_MESH
    }


def drawn_case(case: Case, condition: str, drawn: StressRatio) -> Case:
    """The case whose condition under stress is that of a drawn patient."""
    bed, entry = drawn.surrogate.coronary, moved_entry(case.conditions[condition], drawn.stress)
    return dataclasses.replace(
        case,
        conditions={**case.conditions, condition: entry},
        coronary=dataclasses.replace(
            case.coronary, P_venous=float(bed.P_venous), im_factor=float(bed.im_factor)
        ),
        stress=dataclasses.replace(
            case.stress,
            rule="factors",
            factors={name: float(getattr(drawn.rule, name)) for name in NOMINAL},
        ),
    )


def _at_rest(model: StressRatio, rest: Run3D) -> StressRatio:
    """The patient with the resting ratio of the calibrated run in 3D."""
    return model.with_values({"rest_ratio": rest.ratio if rest.ratio is not None else np.nan})


def _alpha(model: StressRatio) -> float:
    return float(calibrate_alpha(model.surrogate, model.rest, model.rest_ratio).alpha)
