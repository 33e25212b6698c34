"""How visible an effect is in a record, from the generator alone.

    λ² = min_u  |W (d − J u)|² + |S⁻¹ (u − u₀)|²

d is what the sensors show with the effect minus without, at the same patient and the same beats,
over all conditions that are not held out: both pressure traces at their samples, mean flow, ffr. W
whitens by the noise: 0.5 mmHg a sample with autocorrelation exp(−t/τ), 5 % of the flow, 0.01 of
ffr. The columns of J are finite differences of the generator along what is unknown of the patient,
S its prior standard deviations: log α 1, log R0 0.15, log C_a, log C_im, log C0 0.4, systolic and
diastolic pressure of each condition 2 mmHg, an offset of each trace 0.5 mmHg. u₀ is what the effect
adds to the stated pressures (zero except for a transducer that states them itself). λ is like a z:
the number of standard deviations by which the effect stands out after the best excuse.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.foreign.clock import (
    FFR_SD,
    FLOW_SHARE,
    OFFSET_MMHG,
    Acquisition,
    Seen,
    see,
    whitened,
)
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import ForeignMember, Solver
from benchmarks.foreign.patient import PRIOR_SD_LOG, STATED_SD, ForeignPatient
from benchmarks.foreign.waves import BeatPlan

LOG_STEP, MMHG_STEP = 0.02, 0.5
"""Steps of the differences: of a logarithm, of a pressure."""


class Nuisances(NamedTuple):
    """Directions of what is unknown, each over its prior standard deviation.

    Attributes:
        columns: whitened, shape (data, directions).
        pressures: which directions are stated pressures.
    """

    columns: np.ndarray
    pressures: np.ndarray


def stacked(seen: Sequence[Seen], usual: Sequence[Seen], names, acquisition) -> np.ndarray:
    """Whitened data of several conditions in one vector; flows over their usual values."""
    parts = []
    for one, base, name in zip(seen, usual, names, strict=True):
        times = acquisition.times[name]
        for trace in (one.P_aorta, one.P_distal):
            parts.append(whitened(trace, times, acquisition.correlation))
        parts.append(np.array([one.mean_flow / (FLOW_SHARE * base.mean_flow), one.ffr / FFR_SD]))
    return np.concatenate(parts)


def nuisances(
    patient: ForeignPatient,
    plans: Mapping[str, BeatPlan],
    acquisition: Acquisition,
    solver: Solver,
) -> tuple[Nuisances, list[Seen]]:
    """Directions of what is unknown, and the base model's data, of the fitted conditions."""
    conditions = [c for c in patient.conditions if not c.held_out]
    names = [c.name for c in conditions]
    members = [ForeignMember(patient, c, False) for c in conditions]
    for name in PRIOR_SD_LOG:
        moved = patient.scaled(name, float(np.exp(LOG_STEP)))
        members += [ForeignMember(moved, c, False) for c in conditions]
    for c in conditions:
        for key in ("P_systolic", "P_diastolic"):
            moved = c._replace(**{key: getattr(c, key) + MMHG_STEP})
            members.append(ForeignMember(patient, moved, False))
    none = EffectForm()
    runs = solver(members, none, plans)
    seen = [see(run, m, none, acquisition) for run, m in zip(runs, members, strict=True)]
    n = len(conditions)
    usual = seen[:n]
    origin = stacked(usual, usual, names, acquisition)
    columns = []
    for k, sd in enumerate(PRIOR_SD_LOG.values()):
        changed = stacked(seen[n * (k + 1) : n * (k + 2)], usual, names, acquisition)
        columns.append((changed - origin) * sd / LOG_STEP)
    for k in range(2 * n):
        changed = list(usual)
        changed[k // 2] = seen[n * (1 + len(PRIOR_SD_LOG)) + k]
        moved = stacked(changed, usual, names, acquisition)
        columns.append((moved - origin) * STATED_SD / MMHG_STEP)
    columns += _offsets(usual, names, acquisition, origin)
    pressures = np.zeros(len(columns), bool)
    pressures[len(PRIOR_SD_LOG) : len(PRIOR_SD_LOG) + 2 * n] = True
    return Nuisances(np.stack(columns, axis=1), pressures), usual


def _offsets(usual: Sequence[Seen], names, acquisition, origin) -> list[np.ndarray]:
    """Directions of a slow offset of each trace."""
    columns = []
    for k, one in enumerate(usual):
        mean = float(one.P_aorta.mean())
        for shifted in (
            one._replace(P_aorta=one.P_aorta + OFFSET_MMHG, ffr=one.ffr * mean / (mean + 0.5)),
            one._replace(P_distal=one.P_distal + OFFSET_MMHG, ffr=one.ffr + OFFSET_MMHG / mean),
        ):
            changed = [*usual[:k], shifted, *usual[k + 1 :]]
            columns.append(stacked(changed, usual, names, acquisition) - origin)
    return columns


def visibility(nuisance: Nuisances, difference: np.ndarray, *, stated_shift: float = 0.0) -> float:
    """λ of the module's docstring.

    Args:
        nuisance: directions of what is unknown.
        difference: whitened data with the effect minus without.
        stated_shift: what the effect adds to the stated pressures [mmHg].
    """
    J = nuisance.columns
    prior = nuisance.pressures * stated_shift / STATED_SD
    u = np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ difference + prior)
    return float(np.hypot(np.linalg.norm(difference - J @ u), np.linalg.norm(u - prior)))
