"""Acquisition: at which instants a record is sampled, with what noise, over how many beats."""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import ForeignMember, ForeignRun

NOISE_MMHG, FLOW_SHARE, FFR_SD, OFFSET_MMHG = 0.5, 0.05, 0.01, 0.5
"""Standard deviations: of a pressure sample, a mean flow over it, ffr, and a trace's offset."""

GRID_S = 0.001
"""Step of the uniform grid on which sensors act [s]."""


@dataclasses.dataclass(frozen=True)
class Acquisition:
    """How the conditions are recorded.

    Attributes:
        times: sample times of each condition by its name, from its first recorded beat on [s].
        shown: what is added to them in the file, by condition [s].
        correlation: time of the noise's autocorrelation exp(−t/τ) [s].
        aligned: whether the files hold whole equal beats from the start of ejection.
    """

    times: dict[str, np.ndarray]
    shown: dict[str, float]
    correlation: float
    aligned: bool


class Seen(NamedTuple):
    """What the sensors show of a condition, before noise.

    Attributes:
        P_aorta, P_distal: at the sample times [mmHg].
        mean_flow: [mL/min].
        ffr: ratio of the cycle means.
    """

    P_aorta: np.ndarray
    P_distal: np.ndarray
    mean_flow: float
    ffr: float


def see(run: ForeignRun, member: ForeignMember, form: EffectForm, acquisition: Acquisition) -> Seen:
    """Send a run through the sensors and sample it."""
    grid = np.arange(run.t[0], run.end, GRID_S)
    P_aorta, P_distal, Q = (np.interp(grid, run.t, x) for x in (run.P_aorta, run.P_distal, run.Q))
    if member.on and form.sensors is not None:
        P_aorta, P_distal = form.sensors(grid, P_aorta, P_distal, member.condition)
    inside = grid >= 0.0
    flow = 60.0 * float(Q[inside].mean())
    if member.on and form.flow is not None:
        flow = form.flow(flow, member.condition)
    at = acquisition.times[member.condition.name]
    ratio = float(P_distal[inside].mean() / P_aorta[inside].mean())
    return Seen(np.interp(at, grid, P_aorta), np.interp(at, grid, P_distal), flow, ratio)


def memory(times: np.ndarray, correlation: float) -> float:
    """Correlation of the noise of neighbouring samples."""
    return float(np.exp(-(times[1] - times[0]) / correlation))


def noise_like(times: np.ndarray, correlation: float, rng: np.random.Generator) -> np.ndarray:
    """Autoregressive noise of first order [mmHg]."""
    a = memory(times, correlation)
    white = rng.normal(size=times.size) * np.sqrt(1.0 - a * a)
    white[0] = white[0] / np.sqrt(1.0 - a * a)
    return NOISE_MMHG * np.asarray(lfilter([1.0], [1.0, -a], white))


def whitened(trace: np.ndarray, times: np.ndarray, correlation: float) -> np.ndarray:
    """A trace over the noise of its samples, so that the noise is white and of unit size."""
    a = memory(times, correlation)
    rest = (trace[1:] - a * trace[:-1]) / np.sqrt(1.0 - a * a)
    return np.concatenate([trace[:1], rest]) / NOISE_MMHG
