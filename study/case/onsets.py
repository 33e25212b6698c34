"""Where the beats of a recording begin, found from its aortic pressure.

1. The slope of the smoothed trace has one high peak a beat; the notch's is far lower.
2. A polynomial m(u) through the upstrokes of all beats, u = time from the peak, each beat with a
   level of its own, moves every upstroke to where it fits best (Woody 1967, Med Biol Eng 5:539):

       δ_k = Σ (P − level_k − m) m′ / Σ m′²,    sd δ = sd P / √(Σ m′²).

3. The rise lies at `RISE` of a beat of the base model, whatever the pressures; where the recording
   says that it starts at ejection that is used instead.
"""

from typing import NamedTuple

import numpy as np

RISE = 0.148
"""Where the base model's aortic pressure crosses half its rise [beats]: exp(2 − 2/(1 − g²)) = ½
with g = phase/0.3 − 1 (Puelz et al. 2024)."""

_WINDOW = 0.13
"""Half width of an upstroke [beats]."""

_SMOOTHING = 0.03
"""Standard deviation of the smoothing that comes before slopes are looked at [beats]."""

_FARTHEST = 0.06
"""Farthest that an upstroke is moved from the highest slope [beats]."""

_DEGREE = 6
_PASSES = 6


class Upstrokes(NamedTuple):
    """Upstrokes of a recording.

    Attributes:
        at: middle of the steepest rise of each beat [s].
        sd: standard deviation of each by the noise of the trace [s].
    """

    at: np.ndarray
    sd: float


def find_upstrokes(t: np.ndarray, P: np.ndarray, period: float) -> Upstrokes:
    """Upstrokes of all beats that are wholly in the recording.

    Args:
        t: times [s], ascending.
        P: aortic pressure [mmHg].
        period: mean length of a beat, within a third [s].
    """
    rough = _steepest(t, P, period)
    if rough.size == 0:
        return Upstrokes(rough, 0.0)
    return _aligned(t, P, period, rough)


def _steepest(t: np.ndarray, P: np.ndarray, period: float) -> np.ndarray:
    """Instants of the highest slopes of the smoothed trace, one a beat."""
    count = max(int(np.ceil((t[-1] - t[0]) / period * 200.0)), 8)
    fine = np.linspace(t[0], t[-1], count)
    h = fine[1] - fine[0]
    smooth = _smoothed(np.interp(fine, t, P), _SMOOTHING * period / h)
    slope = np.gradient(smooth, h)
    reach = max(round(float(period / h)), 4)
    highest = [slope[k : k + reach].max() for k in range(0, count, reach)]
    height = 0.5 * float(np.median(highest))
    if height <= 0.0:
        return np.zeros(0)
    at = _peaks(slope, height, max(int(0.55 * reach), 1))
    # an upstroke that the file cuts off has no steepest point of its own
    margin = 0.75 * _WINDOW * period
    inside = (fine[at] - t[0] > margin) & (t[-1] - fine[at] > margin)
    return fine[at[inside]]


def _smoothed(wave: np.ndarray, width: float) -> np.ndarray:
    """A wave averaged by a Gaussian of some standard deviation in samples, its ends held."""
    reach = int(np.ceil(4.0 * width))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    return np.convolve(np.pad(wave, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def _peaks(wave: np.ndarray, height: float, distance: int) -> np.ndarray:
    """Local maxima above a height, the highest first, none nearer to another than a distance."""
    inner = (wave[1:-1] > wave[:-2]) & (wave[1:-1] >= wave[2:]) & (wave[1:-1] >= height)
    kept: list[int] = []
    for k in sorted((np.flatnonzero(inner) + 1).tolist(), key=lambda k: -wave[k]):
        if all(abs(k - other) >= distance for other in kept):
            kept.append(k)
    return np.array(sorted(kept), int)


def _aligned(t: np.ndarray, P: np.ndarray, period: float, rough: np.ndarray) -> Upstrokes:
    """Upstrokes moved to where each fits the polynomial through all of them."""
    at, sd = rough.copy(), _WINDOW * period
    for _ in range(_PASSES):
        u = (t[None, :] - at[:, None]) / period
        beat, sample = np.nonzero(np.abs(u) < _WINDOW)
        x, y = u[beat, sample] / _WINDOW, P[sample]
        degree = int(np.clip((x.size - at.size) // 3, 1, _DEGREE))
        powers = np.arange(1, degree + 1)
        # a level of its own takes the mean of each beat out of the fit
        design = _less_means(x[:, None] ** powers, beat, at.size)
        wave = _less_means(y[:, None], beat, at.size)[:, 0]
        fit = np.linalg.lstsq(design, wave, rcond=None)[0]
        rest = wave - design @ fit
        slope = (powers * x[:, None] ** (powers - 1)) @ fit / (_WINDOW * period)
        # a level of its own leaves a beat the part of the slope that is not constant within it
        inner = np.bincount(beat, slope, at.size) / np.maximum(
            np.bincount(beat, minlength=at.size), 1
        )
        power = np.bincount(beat, (slope - inner[beat]) ** 2, at.size) + 0.1 * np.bincount(
            beat, slope**2, at.size
        )
        moved = -np.bincount(beat, rest * slope, at.size) / np.maximum(power, 1e-9)
        # one that runs away has lost its upstroke
        at = np.clip(at + moved, rough - _FARTHEST * period, rough + _FARTHEST * period)
        freedom = max(x.size - at.size - degree, 1)
        sd = float(np.sqrt((rest**2).sum() / freedom / np.median(power)))
    return Upstrokes(at, sd)


def _less_means(columns: np.ndarray, beat: np.ndarray, count: int) -> np.ndarray:
    """Columns of values less the mean of each over the samples of the same beat."""
    number = np.maximum(np.bincount(beat, minlength=count), 1)
    means = [np.bincount(beat, column, count) / number for column in columns.T]
    return columns - np.stack(means, axis=1)[beat]


def rise_of(beat: np.ndarray) -> float:
    """Phase at which a beat on a uniform grid crosses half of its rise, looked for near `RISE`."""
    n = beat.size
    fine = np.arange(4 * 256) / (4 * 256)
    wave = np.fft.irfft(np.fft.rfft(beat) * (fine.size / n), fine.size)
    half = 0.5 * (wave.min() + wave.max())
    up = np.flatnonzero((wave < half) & (np.roll(wave, -1) >= half))
    if up.size == 0:
        return RISE
    found = fine[up]
    return float(found[np.argmin(np.abs(np.mod(found - RISE + 0.5, 1.0) - 0.5))])
