"""What one effect does in one of its forms: to parameters, laws, driving pressures, sensors."""

import dataclasses
from collections.abc import Callable

import numpy as np

from benchmarks.foreign.circuit import Physics
from benchmarks.foreign.patient import ForeignCondition, Parameters

Traces = tuple[np.ndarray, np.ndarray]
"""Aortic and distal pressure [mmHg]."""


@dataclasses.dataclass(frozen=True)
class EffectForm:
    """An effect in one form and size.

    Attributes:
        effect: its id, "none", or "outside:KIND".
        form: name of the form.
        size: numbers that say how large it is.
        place: where it acts.
        physics: laws that replace those of the base circuit.
        constants: parameters that the laws need, in all members.
        parameters: parameters of the circuit in a condition, from those of the base.
        inlet: (phases, pressure, systolic, diastolic, condition) → aortic pressure of a beat.
        squeeze: (phases, ventricular pressure over its peak, condition) → the same.
        sensors: (times, aortic, distal pressure, condition) → what the sensors show, over a
            uniform fine grid.
        flow: (mean flow, condition) → what the flow measurement shows.
        beats: (place of a beat, condition) → changes of its systolic and diastolic pressure.
        stated_shift: change of the stated pressures [mmHg], where the transducer states them.
    """

    effect: str = "none"
    form: str = "none"
    size: dict[str, float] = dataclasses.field(default_factory=dict)
    place: str = "none"
    physics: Physics = dataclasses.field(default_factory=Physics)
    constants: dict[str, float] = dataclasses.field(default_factory=dict)
    parameters: Callable[[Parameters, ForeignCondition], Parameters] | None = None
    inlet: Callable[..., np.ndarray] | None = None
    squeeze: Callable[..., np.ndarray] | None = None
    sensors: Callable[[np.ndarray, np.ndarray, np.ndarray, ForeignCondition], Traces] | None = None
    flow: Callable[[float, ForeignCondition], float] | None = None
    beats: Callable[[int, ForeignCondition], tuple[float, float]] | None = None
    stated_shift: float = 0.0


def pick(rng: np.random.Generator, *names: str) -> str:
    """One of several names."""
    return str(names[int(rng.integers(len(names)))])


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two bounds, evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def either(rng: np.random.Generator, low: float, high: float) -> float:
    """A factor between two bounds or the inverse of one."""
    factor = log_uniform(rng, low, high)
    return factor if rng.random() < 0.5 else 1.0 / factor


def signed(rng: np.random.Generator, low: float, high: float) -> float:
    """A number of either sign with its size between two bounds."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def times(**factors: float) -> Callable[[Parameters], Parameters]:
    """A function that multiplies parameters."""

    def apply(p: Parameters) -> Parameters:
        return {name: value * factors.get(name, 1.0) for name, value in p.items()}

    return apply
