"""Checks of a record before a diagnosis: its numbers, and the shapes of its beats."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from diagnosis.measured import SENSORS
from diagnosis.scatter import FEWEST_BEATS
from lumped.units import MMHG

if TYPE_CHECKING:
    from diagnosis.record import Record, RecordedCondition


def check_record(record: "Record") -> None:
    """Refuse a record whose numbers or beats cannot be used.

    Raises:
        ValueError: all faults at once.
    """
    faults = [f"record: {text}" for text in _record_faults(record)]
    for condition in record.conditions:
        faults += [f"condition '{condition.name}': {text}" for text in _condition_faults(condition)]
    if faults:
        raise ValueError(
            f"Record '{record.id}' cannot be diagnosed: {'; '.join(faults)}. Correct these, or "
            "leave out what was not measured."
        )


def _record_faults(record: "Record") -> Iterator[str]:
    if not record.conditions:
        yield "there is no condition"
    for name in ("pressure_sd", "flow_relative_sd", "ffr_sd", "R0", "R0_sd_log"):
        yield from _not_positive(name, getattr(record, name))
    for name in ("pressure_offset_sd", "K", "L"):
        yield from _not_positive(name, getattr(record, name), zero=True)
    orders = [condition.order for condition in record.conditions]
    if len(set(orders)) < len(orders) and any(condition.beats for condition in record.conditions):
        # the recorded waveform of a condition is found by its order
        yield (
            f"the conditions have the orders {', '.join(map(str, orders))}; give each its own, "
            "from 0 in order of acquisition"
        )


def _condition_faults(condition: "RecordedCondition") -> Iterator[str]:
    for name in ("period", "P_systolic", "P_diastolic", "mean_P_aorta", "mean_P_distal", "ffr"):
        yield from _not_positive(name, getattr(condition, name))
    high, low = condition.P_systolic, condition.P_diastolic
    if high < low:  # equal: steady flow
        yield (
            f"P_systolic = {high:.6g} dyn/cm² ({high / MMHG:.4g} mmHg) lies below "
            f"P_diastolic = {low:.6g} dyn/cm² ({low / MMHG:.4g} mmHg)"
        )
    elif 0.0 < high < MMHG:
        yield (
            f"P_systolic = {high:.6g} dyn/cm² is {high / MMHG:.2g} mmHg; pressures are in dyn/cm²: "
            "multiply those in mmHg by lumped.MMHG"
        )
    if condition.mean_Q is not None and not math.isfinite(condition.mean_Q):
        yield f"mean_Q = {condition.mean_Q} is not finite"
    yield from _beat_faults(condition)
    if condition.folding is not None:
        yield from _not_positive("folding.samples", condition.folding.samples)
        yield from _not_positive("folding.start_sd", condition.folding.start_sd, zero=True)


def _beat_faults(condition: "RecordedCondition") -> Iterator[str]:
    shapes = {name: np.shape(beats) for name, beats in condition.beats.items()}
    for name, shape in shapes.items():
        if name not in SENSORS:
            yield f"beats of '{name}' are of no sensor; there are {', '.join(SENSORS)}"
        if len(shape) != 2 or 0 in shape:
            yield f"{name} has shape {shape}, not beats × samples"
        elif shape[1] < 2:
            yield f"{name} has one sample a beat; give its mean, or at least two samples"
        elif not np.all(np.isfinite(condition.beats[name])):
            yield f"{name} has samples that are not finite"
    if any(len(shape) != 2 for shape in shapes.values()) or not is_repeated(condition):
        return
    if shapes and "P_aorta" not in shapes:
        yield (
            f"there are several beats of {', '.join(shapes)} without P_aorta; add it, or give one "
            "mean beat"
        )
    if len(set(shapes.values())) > 1:
        told = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        yield f"the sensors' beats × samples differ ({told}); give all of them alike"


def is_repeated(condition: "RecordedCondition") -> bool:
    """Whether there are beats enough to see their scatter, or folded ones."""
    counts = [beats.shape[0] for beats in condition.beats.values()]
    return condition.folding is not None or min(counts, default=0) >= FEWEST_BEATS


def _not_positive(name: str, value: float | None, *, zero: bool = False) -> Iterator[str]:
    if value is None:
        return
    if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not zero):
        yield f"{name} = {value} must be finite and {'not negative' if zero else 'positive'}"
