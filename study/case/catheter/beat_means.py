"""What the used beats of a recording say of a condition: means, period, scatter, alignment.

Beats are averaged at equal phases from the onset of ejection. The noise is the scatter of single
samples about the mean beat, after the mean of each beat is taken off (respiration moves it):

    σ² = Σ (y − mean beat − (beat's mean − mean))² / (samples (1 − 1/beats)).

Respiration moves the level of the beats, and those left out leave some of its phases empty. Where
one oscillation f between 0.1 Hz and 0.6 Hz explains most of the levels L of the used beats, the
mean is c of

    L(t) = c + a cos 2πft + b sin 2πft,   by least squares.

The alignment is the shift between the upstrokes of both mean beats with the highest correlation of
their slopes. It is stated and never corrected: it holds the travel time of the pulse too.
"""

import dataclasses

import numpy as np

from study.case.catheter.beats import FoundBeats, find_beats
from study.case.catheter.samples import CatheterTrace

PHASES = 128
_RESPIRATION = (0.1, 0.6)
_EXPLAINED, _FEWEST_LEVELS = 0.5, 20
_LONGEST_DELAY = 0.2
_UNSTEADY, _UNSTEADY_SD = 0.03, 4.0


@dataclasses.dataclass(frozen=True)
class BeatMeans:
    """Averages of the used beats; pressures in mmHg.

    Attributes:
        period: mean length of a beat [s].
        P_systolic: highest aortic pressure of the mean beat.
        P_diastolic: lowest of it.
        mean_P_aorta: mean over the used beats.
        mean_P_distal: likewise.
        ratio: mean distal over mean aortic pressure.
        ratio_sd: standard deviation of that ratio from the scatter of the beats.
        noise: standard deviation of one sample, of each sensor.
        delay: time by which the distal upstroke is later than the aortic one [s].
        mean_beat: mean beat of each sensor at `PHASES` phases.
        ratios: ratio of each used beat.
        mean_Q: mean flow [mL/min]; None without a flow.
    """

    period: float
    P_systolic: float
    P_diastolic: float
    mean_P_aorta: float
    mean_P_distal: float
    ratio: float
    ratio_sd: float
    noise: dict[str, float]
    delay: float
    mean_beat: dict[str, np.ndarray]
    ratios: np.ndarray
    mean_Q: float | None


@dataclasses.dataclass(frozen=True)
class ImportedCondition:
    """One file: its samples, its beats and their averages.

    Attributes:
        name: of the condition.
        drug: `none`, `adenosine` or `dobutamine`.
        trace: the samples.
        beats: the beats found.
        means: averages of those used.
    """

    name: str
    drug: str
    trace: CatheterTrace
    beats: FoundBeats
    means: BeatMeans

    def remarks(self) -> list[str]:
        """What a user should know of it, in sentences."""
        beats, means = self.beats, self.means
        counts = {w: beats.reason.count(w) for w in dict.fromkeys(beats.reason) if w}
        said = ", ".join(f"{n} {why}" for why, n in counts.items())
        left = f"; left out: {said}" if said else ""
        found = [f"{len(beats.used)} of {len(beats.reason)} beats are used{left}."]
        if self.trace.columns:
            read = ", ".join(f"{role} from {name}" for role, name in self.trace.columns.items())
            found.append(f"Columns: {read}.")
        if abs(means.delay) > 0.03:
            which = "later" if means.delay > 0.0 else "earlier"
            found.append(
                f"The distal upstroke is {abs(means.delay) * 1e3:.0f} ms {which} than the aortic "
                "one. This was not corrected: it holds the delay of the catheter and the travel "
                "time of the pulse. Means do not depend on it."
            )
        shift = unsteady(means.ratios)
        if shift is not None:
            found.append(
                f"Pd/Pa moves from {shift[0]:.3f} to {shift[1]:.3f} within the recording: cut it "
                "to the steady state with --span."
            )
        if means.ratio >= 1.0:
            found.append(
                f"Pd/Pa is {means.ratio:.3f}: the wire has drifted or lies lower than the aortic "
                "sensor, or the two columns are exchanged (--columns)."
            )
        return [*self.trace.remarks, *found]


def import_condition(name: str, drug: str, trace: CatheterTrace) -> ImportedCondition:
    """Find and average the beats of one file.

    Args:
        name: of the condition.
        drug: given under it.
        trace: samples of the file.

    Raises:
        CaseError: no regular beats, or too few of use.
    """
    beats = find_beats(trace)
    return ImportedCondition(name, drug, trace, beats, _means(trace, beats))


def _means(trace: CatheterTrace, beats: FoundBeats) -> BeatMeans:
    used = beats.used
    onset, length = beats.onset[used], beats.length[used]
    phase = (np.arange(PHASES) + 0.5) / PHASES
    at = onset[:, None] + length[:, None] * phase
    waves = {name: np.interp(at, trace.t, wave) for name, wave in trace.waves.items()}
    weight = length / length.sum()
    level = {name: wave.mean(axis=1) for name, wave in waves.items()}
    mean = {name: _mean_level(onset, found, weight) for name, found in level.items()}
    ratios = level["P_distal"] / level["P_aorta"]
    mean_beat = {name: weight @ wave for name, wave in waves.items()}
    highest, lowest = _extremes(mean_beat["P_aorta"])
    noise = {
        name: _scatter(trace.t, wave, onset, length, mean_beat[name], level[name])
        for name, wave in trace.waves.items()
    }
    return BeatMeans(
        period=beats.period,
        P_systolic=highest,
        P_diastolic=lowest,
        mean_P_aorta=mean["P_aorta"],
        mean_P_distal=mean["P_distal"],
        ratio=mean["P_distal"] / mean["P_aorta"],
        ratio_sd=float(ratios.std(ddof=1) / np.sqrt(ratios.size)),
        noise=noise,
        delay=delay_between(mean_beat["P_aorta"], mean_beat["P_distal"], beats.period),
        mean_beat=mean_beat,
        ratios=ratios,
        mean_Q=mean.get("Q_coronary"),
    )


def _mean_level(onset: np.ndarray, level: np.ndarray, weight: np.ndarray) -> float:
    """Mean over the beats; that of the respiration's middle where it explains the levels."""
    plain = float(weight @ level)
    if level.size < _FEWEST_LEVELS:
        return plain
    rest = level - plain
    best, middle = _EXPLAINED * float((rest**2).sum()), plain
    highest = min(_RESPIRATION[1], 0.45 / float(np.median(np.diff(onset))))
    for f in np.arange(_RESPIRATION[0], highest, 0.2 / float(np.ptp(onset))):
        angle = 2.0 * np.pi * f * onset
        design = np.stack([np.ones(onset.size), np.cos(angle), np.sin(angle)], axis=1)
        fit = np.linalg.lstsq(design, rest, rcond=None)[0]
        left = float(((rest - design @ fit) ** 2).sum())
        if left < best:
            best, middle = left, plain + float(fit[0])
    return middle


def _extremes(beat: np.ndarray) -> tuple[float, float]:
    return float(beat.max()), float(beat.min())


def _scatter(
    t: np.ndarray,
    wave: np.ndarray,
    onset: np.ndarray,
    length: np.ndarray,
    mean_beat: np.ndarray,
    level: np.ndarray,
) -> float:
    """Standard deviation of one sample about the mean beat."""
    phase = (np.arange(PHASES) + 0.5) / PHASES
    rest = []
    for start, span, own in zip(onset, length, level, strict=True):
        inside = (t >= start) & (t < start + span)
        known = np.interp((t[inside] - start) / span, phase, mean_beat, period=1.0)
        rest.append(wave[inside] - known - (own - mean_beat.mean()))
    count = len(rest)
    return float(np.sqrt((np.concatenate(rest) ** 2).mean() / (1.0 - 1.0 / count)))


def delay_between(first: np.ndarray, second: np.ndarray, period: float) -> float:
    """Time by which the upstroke of a second mean beat is later than that of a first [s].

    Args:
        first: beat at uniform phases.
        second: likewise.
        period: length of the beat [s].
    """
    n = 1024
    slopes = []
    for beat in (first, second):
        bins = np.fft.rfft(beat - beat.mean())
        k = np.arange(bins.size)
        # slopes of the first harmonics alone: those beyond are noise and reflections
        bins = bins * 1j * k * np.exp(-0.5 * (k / 12.0) ** 2)
        slopes.append(np.fft.rfft(np.maximum(np.fft.irfft(bins, n), 0.0)))
    product = np.fft.irfft(np.conj(slopes[0]) * slopes[1], n)
    reach = int(_LONGEST_DELAY / period * n)
    lags = np.arange(-min(reach, n // 2 - 2), min(reach, n // 2 - 2) + 1)
    best = int(lags[product[lags].argmax()])
    left, middle, right = (float(product[(best + d) % n]) for d in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    fine = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return (best + fine) / n * period


def unsteady(ratios: np.ndarray) -> tuple[float, float] | None:
    """Ratio of the first and of the last third of the beats where they differ; else None."""
    third = ratios.size // 3
    if third < 3:
        return None
    first, last = ratios[:third], ratios[-third:]
    shift = float(last.mean() - first.mean())
    error = np.sqrt((first.var(ddof=1) + last.var(ddof=1)) / third)
    if abs(shift) < _UNSTEADY or abs(shift) < _UNSTEADY_SD * error:
        return None
    return float(first.mean()), float(last.mean())
