"""Beats of unequal length laid over each other: from times to phases to harmonics.

A beat that begins at o_k and lasts T_k, with r_k = T_k/T: systole, the first `SYSTOLE` of the mean
beat, lasts SYSTOLE T (1 + s (r_k − 1)), and the rest what is left. s = 1 stretches the beat evenly,
s = 0 keeps the length of systole, as hearts nearly do; the s that leaves the least scatter is
taken, the same for all sensors. In these phases the mean of the beats stands for the beat of mean
length.

Every beat's samples y_i at phases φ_i are fitted by least squares,

    y_i = Σ_k≤K  Re c_k cos 2πkφ_i − Im c_k sin 2πkφ_i,      K = min(0.4 samples a beat, HARMONICS),

which takes uneven times and lost samples and leaves out the harmonics next to the Nyquist limit,
that a beat's ends and gaps do not determine. Noise of sd σ a sample leaves Re and Im the variance
2σ²/n with n from the inverse of the normal matrix: n is returned, so that nothing is won by
interpolation. A beat is kept on 2K + 1 uniform phases, from which its harmonics come back exactly.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

import diagnosis
from study.case.onsets import RISE, Upstrokes, find_upstrokes, rise_of

SYSTOLE = 0.42
"""Share of the mean beat that counts as systole."""

SHARE_USED = 0.4
"""Harmonics used over samples a beat; half would be the Nyquist limit."""

HARMONICS = 40
"""Most harmonics used, as many as the diagnosis keeps."""

WIDEST_GAP = 0.85
"""Widest gap between samples, in periods of the highest harmonic used."""

STRETCHES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Values tried of s."""

LENGTH_TOLERANCE = 0.2
"""Deviation of a beat's length from the median beyond which it is left out (extrasystoles)."""

STATED_START_SD, FOUND_START_SD = 0.015, 0.03
"""Standard deviation of the start of ejection [beats], which is found from the upstroke that a
damped catheter shifts: where the file's first time agrees, and where nothing does."""

NEAR_EJECTION = 0.02
"""Distance of the first upstroke from its usual place within which the file's start agrees
[beats]."""


class Unfoldable(Exception):
    """A recording that cannot be folded.

    Attributes:
        value, problem, allowed, cure: as in a `study.case.faults.Fault`.
    """

    def __init__(self, value: object, problem: str, allowed: str, cure: str):
        """Keep what is wrong and how to mend it."""
        Exception.__init__(self, problem)
        self.parts = (value, problem, allowed, cure)


@dataclasses.dataclass(frozen=True)
class Folded:
    """Beats on common phases.

    Attributes:
        beats: beats × uniform phases of each sensor, in its unit.
        period: mean length of the beats [s].
        folding: what the diagnosis must know of how they were folded; None where they were cut by
            index.
    """

    beats: dict[str, np.ndarray]
    period: float
    folding: "diagnosis.Folding | None"


@dataclasses.dataclass(frozen=True)
class _Cut:
    """Where beats begin, their lengths and the share of the stretch that systole takes."""

    onset: np.ndarray
    length: np.ndarray
    mean: float
    share: float

    def phase(self, t: np.ndarray, k: int) -> np.ndarray:
        """Phase in beat k at some times."""
        return warped(t - self.onset[k], self.length[k], self.mean, self.share)


def warped(since: np.ndarray, length: float, mean: float, share: float) -> np.ndarray:
    """Phase at a time since a beat's onset [s], by its length and the mean length."""
    systole = SYSTOLE * mean * (1.0 + share * (length / mean - 1.0))
    later = SYSTOLE + (1.0 - SYSTOLE) * (since - systole) / (length - systole)
    return np.where(since < systole, SYSTOLE * since / systole, later)


def fold(t: np.ndarray, traces: Mapping[str, np.ndarray], period: float, fewest: int) -> Folded:
    """Lay the beats of a recording over each other.

    Args:
        t: times [s], ascending.
        traces: samples of each sensor, `P_aorta` among them.
        period: stated length of a beat [s].
        fewest: samples a beat that are needed at least.

    Raises:
        Unfoldable: too few samples a beat, gaps, or no whole beat.
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
    # the end of the last beat is nobody's upstroke: two numbers must agree on it
    end = upstrokes.at.size * period
    known_end = end if stated and abs(end - t[-1] - step) <= 1.5 * step else None
    return _best_stretch(t, traces, upstrokes, mean, known_end, stated, fewest)


def _best_stretch(
    t: np.ndarray,
    traces: Mapping[str, np.ndarray],
    upstrokes: Upstrokes,
    mean: float,
    end: float | None,
    stated: bool,
    fewest: int,
) -> Folded:
    """Fold with every stretch and keep what leaves the least scatter."""
    found = []
    varies = np.ptp(np.diff(upstrokes.at)) > 0.01 * mean
    for share in STRETCHES if varies else STRETCHES[:1]:
        cut = _cut(t, upstrokes.at, mean, RISE, share, end)
        beats, n = _fitted(t, traces, cut, fewest)
        # the mean beat tells its rise far better than one upstroke
        late = rise_of(beats["P_aorta"].mean(axis=0)) - RISE
        cut = _cut(t, upstrokes.at, mean, RISE - late, share, end)
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
    """Whole beats about upstrokes that lie at a phase `rise` of the mean beat."""
    length = np.append(np.diff(at), mean)
    known = np.where(np.abs(length / mean - 1.0) < LENGTH_TOLERANCE, length, mean)
    onset = at - rise * mean * (1.0 + share * (known / mean - 1.0))
    length = np.diff(onset, append=onset[-1] + mean if end is None else end)
    step = float(np.median(np.diff(t)))
    # a start that is found has an error; what it leaves out of the first beat is no gap
    whole = (onset >= t[0] - max(step, 0.01 * mean)) & (onset + length <= t[-1] + 1.6 * step)
    whole[-1] &= end is not None
    kept = whole & (np.abs(length / mean - 1.0) < LENGTH_TOLERANCE)
    return _Cut(onset[kept], length[kept], mean, share)


def _single(
    t: np.ndarray, traces: Mapping[str, np.ndarray], period: float, fewest: int, at_start: bool
) -> Folded:
    """One beat of the stated length from the file's first time on."""
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
    """Every beat's samples at 2K + 1 phases, and the samples a beat that its noise stands for."""
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
