"""The gap in 3D as documents hold it, as plain classes."""

import dataclasses

ByModel = dict[str, dict[str, float | None]]
"""By model, `surrogate` and `in_3d`, then `before` and `after` the named effect."""


@dataclasses.dataclass(frozen=True)
class ConditionGap:
    """Gap of a condition, in the surrogate and in 3D, before and after the named effect.

    Attributes:
        condition: name of the condition.
        held_out: whether it was held out of the fit.
        P_distal_rms_mmHg: root mean square of what a model misses of the distal pressure, by
            model; None without a waveform.
        ratio_error: error of the pressure ratio [-], by model; None where it was not measured.
        noise_floor_mmHg: what noise alone leaves of `P_distal_rms_mmHg`; None without a waveform.
        P_ostium_rms_mmHg: how far the pressure at the ostium in 3D is from the prescribed one.
        P_distal_mmHg: distal pressure over a beat in 3D, as the sensor shows it.
    """

    condition: str
    held_out: bool
    P_distal_rms_mmHg: ByModel
    ratio_error: ByModel
    noise_floor_mmHg: float | None
    P_ostium_rms_mmHg: float
    P_distal_mmHg: dict[str, list[float]]


@dataclasses.dataclass(frozen=True)
class GapIn3D:
    """How far the gap shrinks in the FSI model.

    Attributes:
        study: folder of the finished study.
        named: effects that the verdict names.
        already_in_3d: those that the 3D model has in any case.
        at_the_boundary: those that change the bed or the aortic pressure.
        on_the_traces: those that act on the sensors.
        conditions: gap of each condition.
    """

    study: str
    named: list[str]
    already_in_3d: list[str]
    at_the_boundary: list[str]
    on_the_traces: list[str]
    conditions: list[ConditionGap]
