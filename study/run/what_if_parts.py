"""What a what-if finds, as plain classes that its document holds too."""

import dataclasses

from study.case.operation import OperationKind


@dataclasses.dataclass(frozen=True)
class OperatedLumen:
    """The anomalous artery on one side of an operation, from where it has left the aorta.

    Attributes:
        length_mm: from the ostium to the outlet.
        s_mm: distance of each section from the ostium.
        area_mm2: its area.
        major_axis_mm: its major axis.
        minor_axis_mm: its minor axis.
        R0: resistance of the artery in the model [dyn·s/cm⁵].
        K: of its quadratic term [dyn·s²/cm⁸]; None under the linear law.
        folder: of what was computed on this side.
    """

    length_mm: float
    s_mm: list[float]
    area_mm2: list[float]
    major_axis_mm: list[float]
    minor_axis_mm: list[float]
    R0: float
    K: float | None
    folder: str


@dataclasses.dataclass(frozen=True)
class OperatedRatio:
    """Pressure ratio of a condition before and after an operation.

    Attributes:
        condition: name of the condition.
        rule: stress rule; None at rest.
        measured: measured ratio, before [-].
        before: ratio of the model before [-].
        after: ratio of the model after [-]; None where its run ended in a collapse.
        flow_before_ml_per_min: mean flow of the artery before.
        flow_after_ml_per_min: mean flow after.
    """

    condition: str
    rule: str | None
    measured: float | None
    before: float
    after: float | None
    flow_before_ml_per_min: float
    flow_after_ml_per_min: float | None


@dataclasses.dataclass(frozen=True)
class WhatIf:
    """An operation and what follows from it.

    Attributes:
        operation: which one.
        diameter_mm: of a stent; None: that of the artery beyond its intramural course.
        mode: `0d` or `3d`.
        law: law of the artery in 0D; `curve` in 3D.
        alpha: scale of the resistances of the bed, before and after [-].
        before: the artery before.
        after: the artery after.
        ratios: at rest first.
        remarks: what else is to be said.
    """

    operation: OperationKind
    diameter_mm: float | None
    mode: str
    law: str
    alpha: float
    before: OperatedLumen
    after: OperatedLumen
    ratios: list[OperatedRatio]
    remarks: list[str]
