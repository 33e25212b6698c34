"""Finds where the beats of a recording begin, from the upstrokes of its aortic pressure.

1. The derivative of the smoothed pressure has one high peak a beat; that of the dicrotic notch is
   far lower.
2. One polynomial m(u) is fitted to the upstrokes of all beats, with u the time from the peak and an
   offset level_k for each beat. Each upstroke then moves to where the polynomial fits best
   (Woody 1967, Med Biol Eng 5:539):

       δ_k = Σ (P − level_k − m) m′ / Σ m′²,    sd δ = sd P / √(Σ m′²).

3. In the base model the middle of the upstroke lies at the phase `RISE`, whatever the pressures.
   Where a recording is known to start at ejection, that is used instead.
"""

from typing import NamedTuple

import numpy as np

RISE = 0.148
"""Where the base model's aortic pressure crosses half its rise [beats]: exp(2 − 2/(1 − g²)) = ½
with g = phase/0.3 − 1 (Puelz et al. 2024)."""

_WINDOW = 0.13
"""Half width of an upstroke [beats]."""

_SMOOTHING = 0.03
"""Standard deviation of the Gaussian that smooths the pressure before differentiation [beats]."""

_FARTHEST = 0.06
"""Largest shift of an upstroke from the steepest point [beats]."""

_DEGREE = 6
_PASSES = 6


class Upstrokes(NamedTuple):
    """Upstrokes of a recording.

    Attributes:
        at: middle of the steepest rise of each beat [s].
        sd: standard deviation of each, from the noise of the pressure [s].
    """

    at: np.ndarray
    sd: float


def find_upstrokes(t: np.ndarray, P: np.ndarray, period: float) -> Upstrokes:
    """Upstrokes that lie wholly inside the recording.

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
    """Times of the steepest rise of the smoothed pressure, one a beat."""
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
    # an upstroke that the recording cuts off may lack its steepest point
    margin = 0.75 * _WINDOW * period
    inside = (fine[at] - t[0] > margin) & (t[-1] - fine[at] > margin)
    return fine[at[inside]]


def _smoothed(wave: np.ndarray, width: float) -> np.ndarray:
    """Convolution with a Gaussian of standard deviation `width` [samples], end values repeated."""
    reach = int(np.ceil(4.0 * width))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    return np.convolve(np.pad(wave, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def _peaks(wave: np.ndarray, height: float, distance: int) -> np.ndarray:
    """Local maxima of at least `height`; of two closer than `distance` the higher one."""
    inner = (wave[1:-1] > wave[:-2]) & (wave[1:-1] >= wave[2:]) & (wave[1:-1] >= height)
    kept: list[int] = []
    for k in sorted((np.flatnonzero(inner) + 1).tolist(), key=lambda k: -wave[k]):
        if all(abs(k - other) >= distance for other in kept):
            kept.append(k)
    return np.array(sorted(kept), int)


def _aligned(t: np.ndarray, P: np.ndarray, period: float, rough: np.ndarray) -> Upstrokes:
    """Upstrokes, each shifted to fit the polynomial common to all (step 2 above)."""
    at, sd = rough.copy(), _WINDOW * period
    for _ in range(_PASSES):
        u = (t[None, :] - at[:, None]) / period
        beat, sample = np.nonzero(np.abs(u) < _WINDOW)
        x, y = u[beat, sample] / _WINDOW, P[sample]
        degree = int(np.clip((x.size - at.size) // 3, 1, _DEGREE))
        powers = np.arange(1, degree + 1)
        # the offset of each beat: subtract the mean of its samples
        design = _less_means(x[:, None] ** powers, beat, at.size)
        wave = _less_means(y[:, None], beat, at.size)[:, 0]
        fit = np.linalg.lstsq(design, wave, rcond=None)[0]
        rest = wave - design @ fit
        slope = (powers * x[:, None] ** (powers - 1)) @ fit / (_WINDOW * period)
        # with an offset for each beat only the part of the derivative that varies within it counts
        inner = np.bincount(beat, slope, at.size) / np.maximum(
            np.bincount(beat, minlength=at.size), 1
        )
        power = np.bincount(beat, (slope - inner[beat]) ** 2, at.size) + 0.1 * np.bincount(
            beat, slope**2, at.size
        )
        moved = -np.bincount(beat, rest * slope, at.size) / np.maximum(power, 1e-9)
        # limit the shift: a diverging one has left its upstroke
        at = np.clip(at + moved, rough - _FARTHEST * period, rough + _FARTHEST * period)
        freedom = max(x.size - at.size - degree, 1)
        sd = float(np.sqrt((rest**2).sum() / freedom / np.median(power)))
    return Upstrokes(at, sd)


def _less_means(columns: np.ndarray, beat: np.ndarray, count: int) -> np.ndarray:
    """Columns minus their mean over the samples of each beat."""
    number = np.maximum(np.bincount(beat, minlength=count), 1)
    means = [np.bincount(beat, column, count) / number for column in columns.T]
    return columns - np.stack(means, axis=1)[beat]


def rise_of(beat: np.ndarray) -> float:
    """Phase, nearest to `RISE`, at which a uniformly sampled beat crosses half of its rise."""
    n = beat.size
    fine = np.arange(4 * 256) / (4 * 256)
    wave = np.fft.irfft(np.fft.rfft(beat) * (fine.size / n), fine.size)
    half = 0.5 * (wave.min() + wave.max())
    up = np.flatnonzero((wave < half) & (np.roll(wave, -1) >= half))
    if up.size == 0:
        return RISE
    found = fine[up]
    return float(found[np.argmin(np.abs(np.mod(found - RISE + 0.5, 1.0) - 0.5))])
