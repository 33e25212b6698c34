"""What an operation would change, in 3D: a finished study before, the same runs after, α kept.

After the operation the anatomy is meshed anew, the ramp gives the curve of the new artery (with
which runs start from their periodic state in 0D), and rest and stress run with the α of before.
"""

import pathlib
from collections.abc import Sequence
from typing import NamedTuple

from lumped import MM
from study.case.model import Case
from study.case.operation import Operation
from study.run.fitted_ramp import fitted
from study.run.progress import Progress
from study.run.ramp import ramp_record
from study.run.results import PlannedRun, Run3D, RunId
from study.run.run_3d import LumenCollapsed, fsi_run
from study.run.study_choice import StudyChoice
from study.run.study_context import open_context, with_curve
from study.run.what_if import AFTER, Sides, operated_case, operated_lumen
from study.run.what_if_parts import OperatedRatio, WhatIf
from study.store.result_names import LOOP, RAMP


class StudyBefore(NamedTuple):
    """What a what-if takes from the study before the operation.

    Attributes:
        case: as the study ran it.
        choice: how it was made.
        curve: R0 and K of its ramp [dyn·s/cm⁵, dyn·s²/cm⁸].
        alpha: as calibrated in 3D [-].
        runs: with it, rest first.
        folder: where it lies, in words.
    """

    case: Case
    choice: StudyChoice
    curve: tuple[float, float]
    alpha: float
    runs: list[Run3D]
    folder: str


def what_if_3d(
    before: StudyBefore,
    operation: Operation,
    sides: Sides,
    folder: pathlib.Path,
    progress: Progress,
) -> WhatIf:
    """Ratios before and after an operation in 3D.

    Args:
        before: the finished study.
        operation: the operation.
        sides: see `study.run.what_if.both_sides`.
        folder: where the runs after it are kept.
        progress: told of each step.

    Raises:
        CaseError: no mesh can be made.
        RuntimeError: a computation failed; cause and cure.
        KeyboardInterrupt: the user interrupted a run; everything before is kept.
    """
    case, choice = operated_case(before.case, operation), before.choice
    context, _ = open_context(case, folder, choice.run, progress)
    progress.step(f"{RAMP}, after the operation")
    law = fitted(ramp_record(context, choice.ramp), choice.ramp).fit.law
    R0, K = float(law.R0), float(law.K)
    context = with_curve(context, R0, K)
    ratios, remarks, rest = [], [], None
    for run in before.runs:
        planned = PlannedRun(RunId(LOOP, run.condition, run.rule), before.alpha)
        rule = f", rule {run.rule}" if run.rule else ""
        progress.step(f"3D: {run.condition}{rule}, after the operation")
        after = None
        try:
            after = fsi_run(context, planned, before=rest if run.rule else None)
        except LumenCollapsed as end:
            remarks.append(f"{run.condition}{rule}, after the operation: {end}")
        ratios.append(_ratio(case, run, after))
        if choice.run.continued and not run.rule:
            if after is None:
                remarks.append("runs under stress go on from the end of rest: there is none")
                break
            rest = planned
    return WhatIf(
        operation=operation.kind,
        diameter_mm=None if operation.diameter is None else operation.diameter / MM,
        mode="3d",
        law="curve",
        alpha=before.alpha,
        before=operated_lumen(sides.before, *before.curve, before.folder),
        after=operated_lumen(sides.after, R0, K, AFTER),
        ratios=ratios,
        remarks=[*remarks, *_coarse(before.runs, before.choice)],
    )


def _ratio(case: Case, before: Run3D, after: Run3D | None) -> OperatedRatio:
    ratio = before.ratio
    assert ratio is not None, "a run of a study has whole cycles"
    return OperatedRatio(
        condition=before.condition,
        rule=before.rule,
        measured=case.conditions[before.condition].ffr,
        before=ratio,
        after=None if after is None else after.ratio,
        flow_before_ml_per_min=before.distal.mean_Q_ml_per_min,
        flow_after_ml_per_min=None if after is None else after.distal.mean_Q_ml_per_min,
    )


def _coarse(runs: Sequence[Run3D], choice: StudyChoice) -> list[str]:
    """What a run of one cycle leaves open."""
    if choice.run.cycles > 1 or not runs:
        return []
    return ["one cycle a run: both sides start from their periodic state in 0D"]
