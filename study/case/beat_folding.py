"""Averages beats of unequal length: sample times become phases, phases give harmonics.

Beat k begins at o_k and lasts T_k; r_k = T_k/T is its length over the mean length T. Systole, the
first `SYSTOLE` of the mean beat, lasts SYSTOLE T (1 + s (r_k − 1)) in beat k; diastole takes the
rest. s = 1 stretches the whole beat evenly, s = 0 keeps the length of systole, which is close to
what hearts do. All sensors share one s, the one with the least scatter between beats. In these
phases the average of the beats represents a beat of mean length.

The samples y_i of each beat at phases φ_i are fitted by least squares,

    y_i = Σ_k≤K  Re c_k cos 2πkφ_i − Im c_k sin 2πkφ_i,      K = min(0.4 samples a beat, HARMONICS).

The fit accepts uneven times and lost samples. It leaves out harmonics near the Nyquist limit, which
the ends and gaps of a beat do not determine. Noise of standard deviation σ a sample gives Re c_k
and Im c_k the variance 2σ²/n, with n from the inverse of the normal matrix; n is returned, so that
interpolation does not make data look more precise than they are. A beat is stored at 2K + 1 uniform
phases, which determine its harmonics exactly.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

import diagnosis
from diagnosis.resolution import HARMONICS
from study.case.onsets import RISE, Upstrokes, find_upstrokes, rise_of

SYSTOLE = 0.42
"""Systole as a share of the mean beat."""

SHARE_USED = 0.4
"""Highest harmonic fitted, over samples a beat; 0.5 is the Nyquist limit."""

WIDEST_GAP = 0.85
"""Widest allowed gap between samples, in periods of the highest harmonic fitted."""

STRETCHES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Values of s that are tried."""

LENGTH_TOLERANCE = 0.2
"""Deviation of a beat's length from the median beyond which it is dropped (extrasystoles)."""

STATED_START_SD, FOUND_START_SD = 0.015, 0.03
"""Standard deviation of the start of ejection [beats], which is derived from the upstroke; a damped
catheter shifts that. First: the file starts at ejection too; second: nothing confirms it."""

NEAR_EJECTION = 0.02
"""Distance of the first upstroke from its usual phase within which the file is taken to start at
ejection [beats]."""


class Unfoldable(Exception):
    """A recording whose beats cannot be averaged.

    Attributes:
        value, problem, allowed, cure: as in a `study.case.faults.Fault`.
    """

    def __init__(self, value: object, problem: str, allowed: str, cure: str):
        """Store the parts of the fault."""
        Exception.__init__(self, problem)
        self.parts = (value, problem, allowed, cure)


@dataclasses.dataclass(frozen=True)
class Folded:
    """Beats on common phases.

    Attributes:
        beats: beats × uniform phases of each sensor, in its unit.
        period: mean length of the beats [s].
        folding: uncertainty that averaging leaves, for the diagnosis; None where beats were cut by
            sample index.
    """

    beats: dict[str, np.ndarray]
    period: float
    folding: "diagnosis.Folding | None"


@dataclasses.dataclass(frozen=True)
class _Cut:
    """Onsets and lengths of beats.

    Attributes:
        onset: start of each beat [s].
        length: of each beat [s].
        mean: mean length [s].
        share: s, how much of a change of length systole takes.
    """

    onset: np.ndarray
    length: np.ndarray
    mean: float
    share: float

    def phase(self, t: np.ndarray, k: int) -> np.ndarray:
        """Phase of times t in beat k."""
        return warped(t - self.onset[k], self.length[k], self.mean, self.share)


def warped(since: np.ndarray, length: float, mean: float, share: float) -> np.ndarray:
    """Phase of a time in a beat.

    Args:
        since: time since the onset of the beat [s].
        length: of the beat [s].
        mean: mean length of the beats [s].
        share: s, how much of a change of length systole takes [-].
    """
    systole = SYSTOLE * mean * (1.0 + share * (length / mean - 1.0))
    later = SYSTOLE + (1.0 - SYSTOLE) * (since - systole) / (length - systole)
    return np.where(since < systole, SYSTOLE * since / systole, later)


def fold(t: np.ndarray, traces: Mapping[str, np.ndarray], period: float, fewest: int) -> Folded:
    """Express the beats of a recording on common phases.

    Args:
        t: times [s], ascending.
        traces: samples of each sensor, `P_aorta` among them.
        period: stated length of a beat [s].
        fewest: smallest number of samples a beat.

    Raises:
        Unfoldable: too few samples a beat, gaps, irregular beats, or no whole beat.
    """
    upstrokes = find_upstrokes(t, traces["P_aorta"], period)
    step = float(np.median(np.diff(t)))
    at_start = abs(t[0]) <= 0.5 * step
    if upstrokes.at.size < 2:
        return _single(t, traces, period, fewest, at_start)
    lengths = np.diff(upstrokes.at)
    mean = float(np.median(lengths))
    if not 0.75 < mean / period < 1.0 / 0.75:
        raise Unfoldable(
            round(mean, 3), "the beats found in the trace have another length than period_s",
            f"near {period:g} s", "correct period_s, or cut the record to this condition",
        )  # fmt: skip
    ordinary = np.abs(lengths / mean - 1.0) < LENGTH_TOLERANCE
    if ordinary.sum() < 0.5 * lengths.size:
        raise Unfoldable(
            round(float(lengths.std() / mean), 3), "the beats differ too much in length",
            f"half of them within {LENGTH_TOLERANCE:.0%}", "cut the record to a regular stretch",
        )  # fmt: skip
    mean = float(lengths[ordinary].mean())
    phase_of_first = (upstrokes.at[0] - t[0]) / mean
    stated = at_start and abs(phase_of_first - RISE) < NEAR_EJECTION
    # no upstroke marks the end of the last beat: the period and the last sample must agree on it
    end = upstrokes.at.size * period
    known_end = end if stated and abs(end - t[-1] - step) <= 1.5 * step else None
    rise = phase_of_first if stated else RISE
    return _best_stretch(t, traces, upstrokes, mean, rise, known_end, stated, fewest)


def _best_stretch(
    t: np.ndarray,
    traces: Mapping[str, np.ndarray],
    upstrokes: Upstrokes,
    mean: float,
    rise: float,
    end: float | None,
    stated: bool,
    fewest: int,
) -> Folded:
    """Try every s and return the result with the least scatter between beats.

    Upstrokes lie at about the phase `rise`; the mean beat tells it more precisely.
    """
    found = []
    varies = np.ptp(np.diff(upstrokes.at)) > 0.01 * mean
    for share in STRETCHES if varies else STRETCHES[:1]:
        cut = _cut(t, upstrokes.at, mean, rise, share, end)
        beats, n = _fitted(t, traces, cut, fewest)
        late = rise_of(beats["P_aorta"].mean(axis=0)) - RISE
        cut = _cut(t, upstrokes.at, mean, rise - late, share, end)
        beats, n = _fitted(t, traces, cut, fewest)
        scatter = sum(
            float(b.var(axis=0).mean() / max(np.ptp(b), 1e-9) ** 2) for b in beats.values()
        )
        found.append((scatter, cut, beats, n))
    _, cut, beats, n = min(found, key=lambda one: one[0])
    sd = STATED_START_SD if stated else FOUND_START_SD
    folding = diagnosis.Folding(samples=n, start_sd=float(np.hypot(sd, upstrokes.sd / mean)))
    return Folded(beats, float(cut.length.mean()), folding)


def _cut(
    t: np.ndarray, at: np.ndarray, mean: float, rise: float, share: float, end: float | None
) -> _Cut:
    """Whole beats, from upstrokes that lie at the phase `rise` of the mean beat."""
    length = np.append(np.diff(at), mean)
    known = np.where(np.abs(length / mean - 1.0) < LENGTH_TOLERANCE, length, mean)
    onset = at - rise * mean * (1.0 + share * (known / mean - 1.0))
    length = np.diff(onset, append=onset[-1] + mean if end is None else end)
    step = float(np.median(np.diff(t)))
    # an estimated onset may lie slightly before the first sample; that is no gap
    whole = (onset >= t[0] - max(step, 0.01 * mean)) & (onset + length <= t[-1] + 1.6 * step)
    whole[-1] = end is not None  # which agrees with the last sample
    kept = whole & (np.abs(length / mean - 1.0) < LENGTH_TOLERANCE)
    return _Cut(onset[kept], length[kept], mean, share)


def _single(
    t: np.ndarray, traces: Mapping[str, np.ndarray], period: float, fewest: int, at_start: bool
) -> Folded:
    """One beat of the stated length, from the first sample on."""
    step = float(np.median(np.diff(t)))
    span = (t[-1] - t[0] + step) / period
    if not at_start or not 0.97 < span:
        raise Unfoldable(
            round(span, 3), "the file does not hold a whole beat", "at least one",
            "give more than two beats, or one whole beat from t = 0 at the start of ejection",
        )  # fmt: skip
    cut = _Cut(np.zeros(1), np.array([period]), period, 1.0)
    beats, n = _fitted(t, traces, cut, fewest)
    return Folded(beats, period, diagnosis.Folding(samples=n, start_sd=STATED_START_SD))


def _fitted(
    t: np.ndarray, traces: Mapping[str, np.ndarray], cut: _Cut, fewest: int
) -> tuple[dict[str, np.ndarray], float]:
    """Beats at 2K + 1 phases, and the effective number of samples a beat (n above)."""
    places = []
    for k, onset in enumerate(cut.onset):
        phase = cut.phase(t, k)
        inside = np.flatnonzero((t >= onset - 1e-9) & (phase < 1.0))
        if inside.size:
            places.append((inside, phase[inside]))
    if not places:
        raise Unfoldable(
            None, "no whole beat was found", "at least one", "record several beats from t = 0 on"
        )
    counts = np.array([phase.size for _, phase in places])
    usual = float(np.median(counts))
    if usual < fewest - 0.5:
        raise Unfoldable(
            round(usual, 1), "too few samples a beat", f"at least {fewest}", "use a higher rate"
        )
    K = min(int(SHARE_USED * usual), HARMONICS)
    widest = np.array([np.diff(phase, append=phase[0] + 1.0).max() for _, phase in places])
    kept = np.flatnonzero((widest * K <= WIDEST_GAP) & (counts >= 2 * K + 1))
    if kept.size < max(1, 0.5 * len(places)):
        step = float(np.median(np.diff(t)))
        raise Unfoldable(
            f"{np.median(widest) * cut.mean:.3g} s",
            f"the samples leave gaps, and {K} harmonics of the beat need one in "
            f"{WIDEST_GAP / K * cut.mean:.3g} s",
            f"steps near {step:.4g} s, single samples lost in fewer than half of the beats",
            "look for lost samples, or cut the record to beats without gaps",
        )
    grid = _design(np.arange(2 * K + 1) / (2 * K + 1), K)
    found: dict[str, list[np.ndarray]] = {name: [] for name in traces}
    samples = []
    for inside, phase in (places[k] for k in kept):
        design = _design(phase, K)
        inverse = np.linalg.inv(design.T @ design)
        samples.append(2.0 / np.mean(np.diag(inverse)[1:]))
        fit = inverse @ design.T
        for name, wave in traces.items():
            found[name].append(grid @ (fit @ wave[inside]))
    return {name: np.array(beats) for name, beats in found.items()}, float(np.mean(samples))


def _design(phase: np.ndarray, K: int) -> np.ndarray:
    angle = 2.0 * np.pi * phase[:, None] * np.arange(1, K + 1)
    return np.concatenate([np.ones((phase.size, 1)), np.cos(angle), -np.sin(angle)], axis=1)
