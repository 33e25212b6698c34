"""What a document holds of the uncertainty of FFR."""

import math
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from calibration import BED_FACTOR
from lumped.nominal import RESERVE_ERROR
from study.report.documents.uncertainty import UncertainFFR, UncertaintyCause, UncertaintyLevel
from study.run.limits import FFR_THRESHOLD
from study.run.reduced_results import UncertainRatio
from study.store.json_form import ABSENT

_QUANTILES = np.linspace(0.005, 0.995, 41)
_Z90 = 1.6448536


def uncertainty_parts(found: Sequence[UncertainRatio], law: str) -> list[UncertainFFR]:
    """Entries of the document, one a condition."""
    return [_part(one, law) for one in found]


def _part(one: UncertainRatio, law: str) -> UncertainFFR:
    ffr, bed = one.found, one.evidence.bed_factor
    median, spread = float(bed.median), float(np.exp(_Z90 * float(bed.log_sd)))
    reserve, reserve_sd = one.flow_reserve or (ABSENT, ABSENT)
    causes = [
        UncertaintyCause(
            name, share, ffr.slopes[name], list(ffr.known_better(name, _known_to(one, name)))
        )
        for name, share in ffr.shares.items()
    ]
    return UncertainFFR(
        condition=one.condition,
        law=law,
        median=ffr.median,
        interval_90=list(ffr.interval()),
        sd=ffr.sd,
        chance_at_or_below_threshold=ffr.chance(FFR_THRESHOLD),
        quantiles=np.quantile(ffr.samples, _QUANTILES).tolist(),
        n_samples=len(ffr.samples),
        n_effective=ffr.n_effective,
        causes=causes,
        bed_factor=median,
        bed_factor_90=[median / spread, median * spread],
        bed_factor_source=one.evidence.source,
        rule_bed_factors=one.bed_factors,
        stress_loss=float(one.evidence.stress_loss.median),
        flow_reserve=reserve,
        flow_reserve_sd=reserve_sd,
        bed_factor_90_after=ABSENT if one.flow_reserve is None else _bed_factor_after(one),
        levels=_levels(one),
    )


def _bed_factor_after(one: UncertainRatio) -> list[float]:
    """5th and 95th percentile of the bed factor over the draws that the flow reserve left."""
    column = list(one.found.slopes).index(BED_FACTOR)
    factors = one.evidence.bed_factor.value(jnp.asarray(one.found.z[:, column]))
    return np.quantile(np.asarray(factors), [0.05, 0.95]).tolist()


def _levels(one: UncertainRatio) -> list[UncertaintyLevel]:
    """How costlier models correct the samples."""
    return [
        UncertaintyLevel(
            level.name,
            level.n_runs,
            level.kind,
            level.error,
            None if math.isnan(level.correlation) else level.correlation,
            level.n_failed,
        )
        for level in one.found.corrections
    ]


def _known_to(one: UncertainRatio, name: str) -> float:
    """Standard deviation of a number after it was measured, over that before."""
    if name == "rest_ratio":
        return math.sqrt(0.5)
    log_sd = float(one.evidence.bed_factor.log_sd)
    return min(1.0, RESERVE_ERROR / log_sd) if name == BED_FACTOR and log_sd > 0.0 else 0.0
