"""How far the gap shrinks: on the fitted data, and on conditions that were held out.

Fitted: excess χ²/n − 1 before and after, 0 being the noise floor. Held out: RMS of the distal
pressure and error of the pressure ratio before and after, beside what noise alone would give:

    floor_rms² = sd² (w + (1 − w)) + offset²,    floor_ffr = offset √2 / mean P_aorta.
"""

from typing import NamedTuple

import numpy as np

from diagnosis.diagnose import Diagnosis
from diagnosis.hypothesis import Fitted


class Shrink(NamedTuple):
    """A quantity before and after an effect is added, and what noise leaves.

    Attributes:
        before: with the base model.
        after: with the most probable hypothesis.
        noise_floor: from noise alone.
    """

    before: float
    after: float
    noise_floor: float


class HeldOut(NamedTuple):
    """A held-out condition.

    Attributes:
        condition: its position in the record.
        P_distal_rms: of the distal pressure [mmHg]; None where no trace was recorded.
        ffr_error: predicted less measured ratio, absolute [-]; None where none was recorded.
    """

    condition: int
    P_distal_rms: Shrink | None
    ffr_error: Shrink | None


def fitted_gap(diagnosis: Diagnosis) -> Shrink:
    """Excess misfit of the fitted data before and after."""
    n = diagnosis.n_data
    before, after = (float(f.chi2) / n - 1.0 for f in (diagnosis.base, diagnosis.best))
    return Shrink(max(before, 0.0), max(after, 0.0), 0.0)


def held_out_gap(diagnosis: Diagnosis) -> list[HeldOut]:
    """The final check: what was held out is looked at here for the first time."""
    record = diagnosis.record
    found = []
    for c in np.flatnonzero(np.asarray(record.held_out) > 0.0):
        c = int(c)
        rms = ratio = None
        offset = 0.5
        if record.n_sensors > 1 and np.isfinite(float(record.wave_sd[c, 1])):
            trace, sd = np.asarray(record.waves[c, 1]), float(record.wave_sd[c, 1])
            offset = float(record.wave_offset_sd[c, 1])

            def error(fitted: Fitted, trace: np.ndarray = trace, c: int = c) -> float:
                return float(np.sqrt(np.mean((np.asarray(fitted.waves)[c, 1] - trace) ** 2)))

            rms = Shrink(error(diagnosis.base), error(diagnosis.best), float(np.hypot(sd, offset)))
        measured = _ratio(diagnosis, c)
        if measured is not None:

            def off(fitted: Fitted, measured: float = measured, c: int = c) -> float:
                means = np.asarray(fitted.waves)[c].mean(axis=-1)
                return float(abs(means[1] / means[0] - measured))

            level = float(np.asarray(diagnosis.base.waves)[c, 0].mean())
            floor = offset * np.sqrt(2.0) / level
            ratio = Shrink(off(diagnosis.base), off(diagnosis.best), float(floor))
        found.append(HeldOut(c, rms, ratio))
    return found


def _ratio(diagnosis: Diagnosis, c: int) -> float | None:
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
