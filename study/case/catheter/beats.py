"""Finds the beats of a catheter recording and says which are of no use, and why.

1. The period is the first high peak of the autocorrelation of the rising slope of the aortic
   pressure: respiration has little slope, and the dicrotic notch rises far less than a beat.
2. The upstrokes are those of `study.case.onsets`; the onset of ejection lies before each by the
   time between the middle of the mean upstroke and its foot, where the tangent at the steepest
   point meets the lowest pressure.
3. A beat is of no use where samples are lost, where it is shorter or longer than its neighbours
   (an extrasystole cuts the beat before it and is followed by a pause), where it follows such a
   beat (it began early, or is stronger after a pause), where its shape differs from the median
   beat in one of the pressures, or where its mean leaves those of its neighbours.
"""

import dataclasses

import numpy as np

from study.case.catheter.samples import CatheterTrace
from study.case.catheter.table import refusal
from study.case.onsets import find_upstrokes

SHORTEST_PERIOD, LONGEST_PERIOD = 0.27, 2.0
"""Limits of a beat [s]."""

LONGEST_RECORDING = 1800.0
"""Longest recording [s]."""

FEWEST_BEATS, LEAST_SHARE = 4, 0.4
"""Beats of use that a recording must hold, and their share of all."""

RHYTHM_TOLERANCE = (0.10, 0.20)
"""Limits of the tolerated deviation of a beat's length from its neighbours [-]."""

SHAPE_TOLERANCE = 0.10
"""Least tolerated root-mean-square difference from the median beat, over its pulse [-]."""

LEVEL_TOLERANCE = 10.0
"""Least tolerated deviation of a beat's mean pressure from its neighbours [mmHg]."""

LONGEST_GAP = 0.05
"""Longest gap between samples within a beat [s], or 2.5 steps."""

USED = ""
LOST, SHORT, LONG = "samples lost", "cut short", "long pause"
EARLY, AFTER = "premature", "after a pause"
SHAPE, LEVEL = "other shape", "other level"

_NEIGHBOURS = 9
_CHUNK = 60.0
_GRID = 0.01


@dataclasses.dataclass(frozen=True)
class FoundBeats:
    """Beats of a recording.

    Attributes:
        onset: start of ejection of each beat [s], shape (n,).
        length: of each beat [s], shape (n,).
        reason: why each is of no use; an empty text: it is used.
        period: mean length of those used [s].
    """

    onset: np.ndarray
    length: np.ndarray
    reason: tuple[str, ...]
    period: float

    @property
    def used(self) -> np.ndarray:
        """Places of the beats that are used."""
        return np.array([k for k, why in enumerate(self.reason) if why == USED], int)


def find_beats(trace: CatheterTrace) -> FoundBeats:
    """Find the beats of a recording.

    Args:
        trace: its samples.

    Raises:
        CaseError: no regular beats, or too few of use.
    """
    t, P = trace.t, trace.waves["P_aorta"]
    if t[-1] - t[0] > LONGEST_RECORDING:
        problem = f"{t[-1] - t[0]:.0f} s are longer than a measurement"
        raise refusal(trace.path, problem, "cut it with --span NAME=FROM:TO [s]")
    period = _period(trace)
    at = _upstrokes(t, P, period)
    if at.size < FEWEST_BEATS + 1:
        cure = "give a longer recording of the aortic pressure"
        raise refusal(trace.path, f"only {max(at.size - 1, 0)} whole beats were found", cure)
    lengths = np.diff(at)
    reason = _rhythm(lengths)
    kept = [k for k, why in enumerate(reason) if why == USED]
    onset = at - _rise_after_foot(
        t, P, at[kept] if len(kept) > 2 else at, float(np.median(lengths))
    )
    for k in range(lengths.size):
        if _gap(t, onset[k], onset[k + 1]) > max(LONGEST_GAP, 2.5 * trace.step):
            reason[k] = LOST
    _judge_shapes(trace, onset, lengths, reason)
    used = [k for k, why in enumerate(reason) if why == USED]
    if len(used) < max(FEWEST_BEATS, LEAST_SHARE * lengths.size):
        counts = {why: reason.count(why) for why in dict.fromkeys(reason) if why != USED}
        said = ", ".join(f"{n} {why}" for why, n in counts.items())
        problem = f"only {len(used)} of {lengths.size} beats are of use ({said})"
        cure = "cut it to a steady, regular stretch with --span NAME=FROM:TO [s]"
        raise refusal(trace.path, problem, cure)
    mean = float(lengths[used].mean())
    return FoundBeats(onset[:-1], lengths, tuple(reason), mean)


def _period(trace: CatheterTrace) -> float:
    """Length of a beat [s], from the autocorrelation of the rising slope."""
    t, P = trace.t, trace.waves["P_aorta"]
    count = int((t[-1] - t[0]) / _GRID)
    if count * _GRID < 3.0 * SHORTEST_PERIOD * FEWEST_BEATS / 2.0:
        problem = f"the recording lasts {t[-1] - t[0]:.2g} s"
        raise refusal(trace.path, problem, "give ten seconds or more; check the unit of the times")
    fine = t[0] + _GRID * np.arange(count)
    kernel = np.exp(-0.5 * (np.arange(-8, 9) / 2.5) ** 2)
    smooth = np.convolve(np.interp(fine, t, P), kernel / kernel.sum(), mode="valid")
    rising = np.maximum(np.gradient(smooth), 0.0)
    rising = np.minimum(rising, 4.0 * np.percentile(rising, 95.0))
    rising -= rising.mean()
    power = np.abs(np.fft.rfft(rising, 2 * rising.size)) ** 2
    found = np.fft.irfft(power)[: rising.size] / np.arange(rising.size, 0, -1)
    low = round(SHORTEST_PERIOD / _GRID)
    high = min(round(LONGEST_PERIOD / _GRID), rising.size // 2)
    lags = np.arange(low, high)
    tops = lags[(found[lags] >= found[lags - 1]) & (found[lags] >= found[lags + 1])]
    if tops.size == 0 or found[tops].max() < 0.2 * found[0]:
        cure = "choose the phasic aortic trace with --columns, or a regular stretch with --span"
        raise refusal(trace.path, "the aortic trace holds no regular beats", cure)
    first = tops[found[tops] >= 0.7 * found[tops].max()][0]
    return float(first * _GRID)


def _upstrokes(t: np.ndarray, P: np.ndarray, period: float) -> np.ndarray:
    """Middles of the upstrokes [s], found minute by minute."""
    found = []
    for low in np.arange(t[0], t[-1], _CHUNK):
        inside = (t >= low - 2.0 * period) & (t < low + _CHUNK + 2.0 * period)
        if inside.sum() < 16:
            continue
        at = find_upstrokes(t[inside], P[inside], period).at
        found.append(at[(at >= low) & (at < low + _CHUNK)])
    at = np.concatenate(found) if found else np.zeros(0)
    apart = np.diff(at, prepend=-np.inf) > 0.3 * period
    return at[apart]


def _rhythm(lengths: np.ndarray) -> list[str]:
    """Reasons against beats by their length and that of the beat before."""
    relative = lengths / _neighbours(lengths) - 1.0
    spread = 4.0 * 1.4826 * float(np.median(np.abs(relative)))
    tolerance = float(np.clip(spread, *RHYTHM_TOLERANCE))
    reason = [USED] * lengths.size
    for k, r in enumerate(relative):
        if r < -tolerance:
            reason[k] = SHORT
        elif r > tolerance:
            reason[k] = LONG
    for k in range(1, lengths.size):
        if reason[k] == USED and reason[k - 1] == SHORT:
            reason[k] = EARLY
        elif reason[k] == USED and reason[k - 1] == LONG:
            reason[k] = AFTER
    return reason


def _neighbours(values: np.ndarray) -> np.ndarray:
    """Median of each value's neighbourhood."""
    reach = min(_NEIGHBOURS, values.size) // 2
    padded = np.pad(values, reach, mode="reflect") if reach else values
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    return np.median(windows, axis=1)


def _rise_after_foot(t: np.ndarray, P: np.ndarray, at: np.ndarray, period: float) -> float:
    """Time from the foot of the mean upstroke to its middle [s]."""
    inside = (at > t[0] + 0.3 * period) & (at < t[-1] - 0.2 * period)
    since = np.arange(-0.3 * period, 0.15 * period, 0.002)
    waves = np.array([np.interp(since + one, t, P) for one in at[inside]])
    mean = np.median(waves - waves.mean(axis=1, keepdims=True), axis=0)
    slope = np.gradient(mean, since)
    top = int(slope.argmax())
    lowest = float(mean[: top + 1].min())
    foot = since[top] - (mean[top] - lowest) / max(float(slope[top]), 1e-9)
    return float(np.clip(-foot, 0.01 * period, 0.15 * period))


def _gap(t: np.ndarray, start: float, end: float) -> float:
    """Longest time without a sample from the one before a beat to the one after it [s]."""
    low = max(int(np.searchsorted(t, start)) - 1, 0)
    high = min(int(np.searchsorted(t, end)), t.size - 1)
    gap = float(np.diff(t[low : high + 1]).max()) if high > low else np.inf
    return max(gap, t[low] - start, end - t[high])


def _judge_shapes(
    trace: CatheterTrace, onset: np.ndarray, lengths: np.ndarray, reason: list[str]
) -> None:
    """Reasons against beats by their shape and level, in place."""
    usual = float(np.median(lengths))
    since = np.linspace(0.0, 0.7 * usual, 48)
    for name in ("P_aorta", "P_distal"):
        kept = np.array([k for k, why in enumerate(reason) if why == USED], int)
        if kept.size < FEWEST_BEATS:
            return
        wave = trace.waves[name]
        beats = np.array([np.interp(onset[k] + since, trace.t, wave) for k in kept])
        level = np.array(
            [
                np.interp(onset[k] + lengths[k] * np.arange(40) / 40, trace.t, wave).mean()
                for k in kept
            ]
        )
        shapes = beats - beats.mean(axis=1, keepdims=True)
        middle = np.median(shapes, axis=0)
        off = np.sqrt(((shapes - middle) ** 2).mean(axis=1)) / max(float(np.ptp(middle)), 1e-9)
        aside = np.abs(level - _neighbours(level))
        for values, floor, why in ((off, SHAPE_TOLERANCE, SHAPE), (aside, LEVEL_TOLERANCE, LEVEL)):
            centre = float(np.median(values))
            spread = 1.4826 * float(np.median(np.abs(values - centre)))
            for k in kept[values > max(floor, centre + 5.0 * spread)]:
                reason[k] = why
