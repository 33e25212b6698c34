"""Pressures that drive the circuit, beat by beat: the assumed shapes and families of others.

The assumed aortic pressure and the ventricle's are those of Puelz et al. 2024. In a beat whose
length differs from the mean, systole takes a power of the change (it hardly shortens in hearts).
"""

import dataclasses
from collections.abc import Callable

import numpy as np

Shape = Callable[[np.ndarray, float, float, float], np.ndarray]
"""Aortic pressure [mmHg] at phases of a beat, from its systolic and diastolic pressure and the
diastolic pressure at its end."""

VALVE = 0.35
"""Phase at which the aortic valve closes."""


@dataclasses.dataclass(frozen=True)
class BeatPlan:
    """Beats of a recording of one condition.

    Attributes:
        lengths: of the beats over the mean length, those of the lead-in among them, shape (n,) or
            (n, members).
        high, low: changes of the systolic and diastolic pressure [mmHg], shapes (n,), (n + 1,).
        lead: number of beats before the recording starts.
        regular: whether all beats are alike.
        family: aortic pressure of a beat.
        kappa: share of the ventricle's pressure that squeezes the arteries too.
    """

    lengths: np.ndarray
    high: np.ndarray
    low: np.ndarray
    lead: int
    regular: bool
    family: Shape
    kappa: float = 0.0

    @property
    def recorded(self) -> int:
        """Beats behind the lead-in."""
        return self.lengths.shape[0] - self.lead


def regular_plan(beats: int, lead: int = 2) -> BeatPlan:
    """Equal beats of the assumed aortic pressure."""
    n = beats + lead
    return BeatPlan(np.ones(n), np.zeros(n), np.zeros(n + 1), lead, True, assumed_aorta)


def bump(g: np.ndarray, k: float) -> np.ndarray:
    """exp(k − k/(1 − g²)) for |g| < 1, else 0."""
    inside = np.abs(g) < 1.0
    rest = np.where(inside, 1.0 - np.square(np.where(inside, g, 0.0)), 1.0)
    return np.where(inside, np.exp(k * (1.0 - 1.0 / rest)), 0.0)


def assumed_aorta(phase: np.ndarray, high: float, low: float, after: float) -> np.ndarray:
    """The base model's aortic pressure; `after` is the diastolic pressure of the next beat."""
    at_valve = low + (high - low) * float(bump(np.array(VALVE / 0.3 - 1.0), 2.0))
    rise = low + (high - low) * bump(phase / 0.3 - 1.0, 2.0)
    share = np.clip((phase - VALVE) / (1.0 - VALVE), 0.0, 1.0)
    fall = at_valve * (after / at_valve) ** share
    return np.where(phase < VALVE, rise, fall)


def ventricle(phase: np.ndarray) -> np.ndarray:
    """The base model's ventricular pressure over its peak."""
    return bump(2.0 * (phase - 0.0692) / (0.4 - 0.0692) - 1.0, 0.3)


def from_profile(profile: np.ndarray) -> Shape:
    """A family from one cyclic beat of any unit that starts at its foot.

    Its extremes become the systolic and the diastolic pressure.
    """
    low, high = float(profile.min()), float(profile.max())
    values = np.append(profile, profile[0])
    grid = np.linspace(0.0, 1.0, values.size)

    def family(phase: np.ndarray, P_high: float, P_low: float, after: float) -> np.ndarray:
        unit = (np.interp(phase, grid, values) - low) / (high - low)
        ramp = np.clip((phase - 0.4) / 0.6, 0.0, 1.0)
        return P_low + (P_high - P_low) * unit + (after - P_low) * ramp * (1.0 - unit)

    return family


def ejection_family(rng: np.random.Generator) -> tuple[Shape, str]:
    """An aortic pressure of flow ejected into a three-element Windkessel.

    With a reflected wave and the notch of the closing valve.
    """
    n = 1000
    phase = np.arange(n) / n
    end = rng.uniform(0.32, 0.4)
    skew = rng.uniform(0.7, 1.0)
    ejected = np.where(phase < end, np.sin(np.pi * np.clip(phase / end, 0, 1) ** skew), 0.0)
    ejected = ejected - rng.uniform(0.0, 0.15) * bump((phase - end - 0.015) / 0.02, 1.0)
    decay = rng.uniform(1.0, 2.5)  # beats
    P, stored = np.zeros(n), 0.0
    for _ in range(12):
        for k in range(n):
            stored += (ejected[k] - stored / decay) / n
            P[k] = stored
    P = P + rng.uniform(0.02, 0.08) * ejected
    late = rng.uniform(0.16, 0.26)
    P = P + rng.uniform(0.0, 0.25) * np.ptp(P) * bump((phase - late) / 0.14, 1.5)
    P = np.roll(P, -int(np.argmin(P)))
    return from_profile(P), "ejection"


def augmented_family(rng: np.random.Generator) -> tuple[Shape, str]:
    """Two systolic shoulders and a dicrotic wave, as sums of bumps over a decaying diastole."""
    phase = np.arange(1000) / 1000
    first, second = rng.uniform(0.14, 0.2), rng.uniform(0.24, 0.3)
    P = bump((phase - first) / (first + 0.01), 1.5)
    P = P + rng.uniform(0.3, 0.9) * bump((phase - second) / 0.2, 1.2)
    P = P + rng.uniform(0.15, 0.4) * bump((phase - rng.uniform(0.44, 0.5)) / 0.12, 1.0)
    diastole = np.clip((phase - 0.1) / 0.25, 0.0, 1.0) * np.exp(-phase / rng.uniform(0.35, 0.7))
    P = P + rng.uniform(0.5, 1.0) * (diastole - phase * diastole[-1])
    return from_profile(np.roll(P, -int(np.argmin(P)))), "augmented"
