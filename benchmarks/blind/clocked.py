"""Traces as a recorder's clock samples them: unequal beats, a start anywhere, noise in time.

The clock knows nothing of the heart. Beat k lasts T_k = T (1 + jitter x_k) with x_k normal and mean
T_k = T; all sensors are stretched by one map of time. "stretched" stretches the whole beat evenly;
"diastole" keeps the length of the first `SYSTOLE` of the beat and stretches the rest, as hearts do.
The level of both pressures may swing from beat to beat, as breathing makes it. Noise is stationary
in time: half white and half smooth, or of first order (autoregressive).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

SYSTOLE = 0.45
"""Share of the mean beat that keeps its length where only diastole is stretched."""

_FINE = 4096


class Clock(NamedTuple):
    """How a recording is made.

    Attributes:
        rate: samples a second [Hz]; None for 64 samples a beat, which divide it.
        beats: complete beats in the file.
        jitter: standard deviation of the beats' lengths over their mean [-].
        stretch: "stretched" or "diastole".
        anywhere: whether the recording starts anywhere in a beat instead of at ejection.
        breath: standard deviation of a beat's pressure level [mmHg].
        memory: time constant of noise of first order [s]; None for half white and half smooth.
        uneven: standard deviation of the sampling times in steps [-].
    """

    rate: float | None = 100.0
    beats: int = 8
    jitter: float = 0.02
    stretch: str = "diastole"
    anywhere: bool = False
    breath: float = 0.0
    memory: float | None = None
    uneven: float = 0.0


def lengths(rng: np.random.Generator, clock: Clock, period: float, count: int) -> np.ndarray:
    """Lengths of beats [s]; their mean is the period."""
    x = np.clip(rng.standard_normal(count), -2.5, 2.5)
    T = period * (1.0 + clock.jitter * x)
    return T * period / T.mean()


def phases(t: np.ndarray, onset: np.ndarray, T: np.ndarray, clock: Clock) -> np.ndarray:
    """Phase of the beat at times, for beats that begin at `onset` and last T."""
    k = np.clip(np.searchsorted(onset, t, side="right") - 1, 0, T.size - 1)
    since, period = t - onset[k], T.mean()
    if clock.stretch == "stretched":
        return since / T[k]
    kept = SYSTOLE * period
    later = SYSTOLE + (1.0 - SYSTOLE) * (since - kept) / (T[k] - kept)
    return np.where(since < kept, since / period, later)


def recording(
    rng: np.random.Generator,
    traces: Mapping[str, np.ndarray],
    period: float,
    sd: float,
    clock: Clock,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and samples of a recording of one condition.

    Args:
        rng: gives lengths, start and noise.
        traces: one period of each pressure, uniform from the start of ejection [mmHg].
        period: mean length of a beat [s].
        sd: noise of a sample [mmHg].
        clock: how it is recorded.

    Returns:
        Times [s] from zero, and the pressures there.
    """
    T = lengths(rng, clock, period, clock.beats + 2)
    T[: clock.beats] *= period / T[: clock.beats].mean()
    onset = np.concatenate([[0.0], np.cumsum(T)])[:-1]
    start = rng.uniform(0.0, T[0]) if clock.anywhere else 0.0
    end = onset[clock.beats] + start
    dt = period / 64 if clock.rate is None else 1.0 / clock.rate
    # a whole number of beats where sampling divides the beat
    count = 64 * clock.beats if clock.rate is None else int(np.ceil((end - start) / dt))
    t = start + dt * np.arange(count)
    taken = t + dt * np.clip(clock.uneven * rng.standard_normal(count), -0.4, 0.4)
    phase = phases(taken, onset, T, clock)
    beat = np.clip(np.searchsorted(onset, taken, side="right") - 1, 0, T.size - 1)
    level = clock.breath * rng.standard_normal(T.size)
    columns = {}
    for name, wave in traces.items():
        spectrum = np.fft.rfft(wave) * (_FINE / wave.size)
        fine = np.fft.irfft(spectrum, _FINE)
        at = np.arange(_FINE + 1) / _FINE
        clean = np.interp(np.mod(phase, 1.0), at, np.append(fine, fine[0]))
        noise = in_time(rng, count, dt, period, clock.memory)
        columns[name] = clean + level[beat] * (0.9 if name == "P_distal" else 1.0) + sd * noise
    return taken - taken[0] if clock.anywhere else taken - start, columns


def in_time(
    rng: np.random.Generator, count: int, dt: float, period: float, memory: float | None
) -> np.ndarray:
    """Stationary noise of unit variance at a clock's samples.

    Args:
        rng: gives it.
        count: of the samples.
        dt: step [s].
        period: length of a beat, of which the smooth half remembers a twentieth [s].
        memory: time constant of noise of first order [s]; None for half white and half smooth.
    """
    if memory is not None:
        keep = np.exp(-dt / memory)
        kicks = np.sqrt(1.0 - keep**2) * rng.standard_normal(count + 200)
        found = np.zeros(count + 200)
        for k in range(1, found.size):
            found[k] = keep * found[k - 1] + kicks[k]
        return found[200:]
    # a kernel of this width gives the correlation exp(−½ (Δ/0.05 T)²)
    width = 0.05 * period / np.sqrt(2.0)
    reach = int(np.ceil(4.0 * width / dt))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * dt / width) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    smooth = np.convolve(rng.standard_normal(count + 2 * reach), kernel, mode="valid")
    return np.sqrt(0.5) * (rng.standard_normal(count) + smooth)
