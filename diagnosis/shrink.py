"""How far the gap shrinks: on the fitted data, and on conditions that were held out.

Fitted: excess χ²/n − 1 before and after, 0 being the noise floor. Held out: RMS error of the distal
pressure and error of the pressure ratio before and after, compared with noise alone:

    floor_rms² = sd² (w + (1 − w)) + offset²,    floor_ffr = offset √2 / mean P_aorta.

The prediction after the diagnosis averages all hypotheses by their probabilities (Hoeting et al.
1999, Stat Sci 14:382), with the base model for "unknown" alone, and the effects known to act for
"unknown" beside them. It is the base model alone if the verdict is "no_gap" (nothing needs to be
added), or "unknown" without a part that is known, or with one that comes no nearer to the traces
that were fitted; and where the effects predict what was left out worse than no gap does.
"""

from typing import NamedTuple

import numpy as np

from diagnosis.measured import OFFSET_SD
from diagnosis.result import Diagnosis
from diagnosis.verdict import key_of, unconfirmed
from lumped.units import MMHG

WORSE, WORSE_BY = 1.1, 0.05 * MMHG
"""RMS error of a held-out distal pressure after the effects that counts as worse: that before,
times and plus [dyn/cm²]."""


class Shrink(NamedTuple):
    """A quantity before and after an effect is added, and its noise floor.

    Attributes:
        before: with the base model.
        after: with the effects of the diagnosis.
        noise_floor: from noise alone.
    """

    before: float
    after: float
    noise_floor: float


class HeldOut(NamedTuple):
    """A held-out condition.

    Attributes:
        condition: its position in the record.
        P_distal_rms: RMS error of the distal pressure [dyn/cm²]; None without a recorded trace.
        ffr_error: absolute error of the predicted ratio [-]; None without a measured ratio.
    """

    condition: int
    P_distal_rms: Shrink | None
    ffr_error: Shrink | None


def expected_waves(diagnosis: Diagnosis) -> np.ndarray:
    """Predicted signals after the diagnosis, conditions × 3 sensors × samples [CGS]."""
    base = np.asarray(diagnosis.base.waves)
    verdict = diagnosis.judgement.verdict
    if (
        not diagnosis.judgement.confirmed
        or verdict == "no_gap"
        or (verdict == "unknown" and not diagnosis.known_part)
    ):
        return base
    change = np.zeros_like(base)
    for hypothesis, fitted in diagnosis.fits.items():
        p = diagnosis.judgement.probabilities[key_of(hypothesis)]
        p += diagnosis.beside.get(hypothesis, 0.0)
        if hypothesis and p > 1e-6 and fitted.sound:
            change += p * (np.asarray(fitted.waves) - base)
    after = base + change
    if verdict == "unknown" and _misses(diagnosis, after) >= _misses(diagnosis, base):
        return base
    return after


def _misses(diagnosis: Diagnosis, waves: np.ndarray) -> float:
    """Sum of squares of what is missed of the traces that were fitted, in units of their noise."""
    record = diagnosis.record
    measured, sd = np.asarray(record.waves), np.asarray(record.wave_sd)
    fitted = np.isfinite(sd) & (np.asarray(record.held_out) < 0.5)[:, None]
    z = (waves[:, : sd.shape[1]] - measured) / np.where(fitted, sd, np.inf)[..., None]
    return float(np.sum(np.where(fitted[..., None], z, 0.0) ** 2))


def fitted_gap(diagnosis: Diagnosis) -> Shrink:
    """Excess misfit of the fitted data, of the base model and of the most probable hypothesis."""
    n = diagnosis.n_data
    before, after = (float(f.chi2) / n - 1.0 for f in (diagnosis.base, diagnosis.best))
    return Shrink(max(before, 0.0), max(after, 0.0), 0.0)


def held_out_gap(diagnosis: Diagnosis) -> list[HeldOut]:
    """Errors on the held-out conditions, whose data are used here for the first time."""
    record = diagnosis.record
    before, after = np.asarray(diagnosis.base.waves), expected_waves(diagnosis)
    found = []
    for c in np.flatnonzero(np.asarray(record.held_out) > 0.0):
        c = int(c)
        rms = ratio = None
        offset = OFFSET_SD
        if record.n_sensors > 1 and np.isfinite(float(record.wave_sd[c, 1])):
            trace, sd = np.asarray(record.waves[c, 1]), float(record.wave_sd[c, 1])
            offset = float(record.wave_offset_sd[c, 1])

            def error(waves: np.ndarray, trace: np.ndarray = trace, c: int = c) -> float:
                return float(np.sqrt(np.mean((waves[c, 1] - trace) ** 2)))

            rms = Shrink(error(before), error(after), float(np.hypot(sd, offset)))
        measured = measured_ratio(diagnosis, c)
        if measured is not None:

            def off(waves: np.ndarray, measured: float = measured, c: int = c) -> float:
                means = waves[c].mean(axis=-1)
                return float(abs(means[1] / means[0] - measured))

            floor = offset * np.sqrt(2.0) / float(before[c, 0].mean())
            ratio = Shrink(off(before), off(after), float(floor))
        found.append(HeldOut(c, rms, ratio))
    return found


def heeding_held_out(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis, or one that names nothing where its prediction misses what was held out.

    The predictive density weighs a miss by what the hypothesis leaves open; a page that calls a
    gap explained while the error of the distal pressure grows misleads all the same.
    """
    errors = [held.P_distal_rms for held in held_out_gap(diagnosis)]
    worse = any(e is not None and e.after > WORSE * e.before + WORSE_BY for e in errors)
    if not worse:
        return diagnosis
    return diagnosis._replace(judgement=unconfirmed(diagnosis.judgement))


def measured_ratio(diagnosis: Diagnosis, c: int) -> float | None:
    """Measured pressure ratio of a condition, from waveforms, means, or as stated."""
    record = diagnosis.record
    if record.n_sensors > 1 and np.isfinite(np.asarray(record.wave_sd[c, :2])).all():
        means = np.asarray(record.waves[c, :2]).mean(axis=-1)
        return float(means[1] / means[0])
    scalars, sd = np.asarray(record.scalars[c]), np.asarray(record.scalar_sd[c])
    if np.isfinite(sd[2]):
        return float(scalars[2])
    if np.isfinite(sd[:2]).all():
        return float(scalars[1] / scalars[0])
    return None
