"""One diagnosis of two: with the assumed aortic waveform, and with the recorded one.

What the second finds acts beside the effect `aortic_waveform` in the form "recorded". The first
gives the base model, and the single effects with the assumed waveform, which all but vanish beside.
"""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import chdtrc, logsumexp

from diagnosis.circuit import FORCED
from diagnosis.effects import Effect, find_effect
from diagnosis.engine import ProgressCallback, base_fits, base_start
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue
from diagnosis.inlet import (
    EFFECT,
    RECORDED,
    SQUEEZE,
    inlet_rms,
    leads,
    recorded_waveform,
    with_free_inlet,
    with_inlet,
    with_inlet_mean,
)
from diagnosis.measured import Measured, compiled_weights
from diagnosis.prediction import SQUEEZE_SD
from diagnosis.resolution import HARMONICS
from diagnosis.result import Diagnosis
from diagnosis.verdict import CLOSED_P, Hypothesis, Judgement, cover_of, key_of
from lumped.units import MMHG

INLET_PASSES = 2
"""Fits of the base model about which a free inlet is linearised. The first starts from the priors'
means: with the assumed waveform the base model goes far from them."""

DELAYS = (0.0, 0.08)
"""Delays of the squeeze from which they start [beats]: a fit does not cross the fall of the
ventricular pressure. Where the foot of a wave is round, its start of ejection is found early."""


def needs_own_inlet(diagnosis: Diagnosis) -> bool:
    """Whether the recorded aortic pressure has another waveform than what was found explains.

    Nothing known explains the record, and either the aortic trace itself misfits or what acts would
    act at its inlet. Where an effect explains the record, a misfit of the aortic trace belongs to
    the form of that effect, such as a catheter's resonance.
    """
    known = any(effect.id == EFFECT for effect in diagnosis.effects)
    if not known or diagnosis.record.n_sensors == 0 or diagnosis.judgement.verdict != "unknown":
        return False
    return aortic_trace_misfits(diagnosis) or leads(diagnosis.forcing, diagnosis.accompanied)


def aortic_trace_misfits(diagnosis: Diagnosis) -> bool:
    """Whether the aortic traces are unlikely under the best hypothesis, by χ²."""
    count = 2 * HARMONICS + 1
    seen = np.asarray(compiled_weights(diagnosis.record))[:, :count] > 0.0
    residual = np.asarray(diagnosis.best.residual)[:, :count]
    return float(chdtrc(np.count_nonzero(seen), np.sum(residual[seen] ** 2))) < CLOSED_P


def inlet_freed(
    batch: Measured,
    numbers: Catalogue,
    forms: tuple[Effect, ...],
    progress: ProgressCallback,
) -> tuple[Measured, np.ndarray]:
    """Records with a free inlet about the base model, whose squeeze may be late.

    Args:
        batch: the records.
        numbers: of the forms.
        forms: every form of every effect.
        progress: called after each block of jobs.

    Returns:
        The records, and whether the base model could be fitted to each.
    """
    batch, B = with_inlet(batch), batch.period.shape[0]
    best, least = batch, np.full(B, np.inf)
    for delay in DELAYS:
        own, cost = _freed_from(delay, batch, numbers, forms, progress)
        better = cost < least
        best = jax.tree.map(
            lambda new, old, better=better: jnp.where(
                better.reshape(-1, *[1] * (new.ndim - 1)), new, old
            ),
            own,
            best,
        )
        least = np.where(better, cost, least)
    return best, np.isfinite(least)


def _freed_from(
    delay: float,
    batch: Measured,
    numbers: Catalogue,
    forms: tuple[Effect, ...],
    progress: ProgressCallback,
) -> tuple[Measured, np.ndarray]:
    """Records with a free inlet from one delay of the squeeze on, and the cost of the fits."""
    x, cost = base_start(batch), np.zeros(batch.period.shape[0])
    x[:, SQUEEZE] = delay / SQUEEZE_SD
    for _ in range(INLET_PASSES):
        batch = with_free_inlet(batch, jnp.asarray(x))
        x[:, SQUEEZE] = 0.0
        fitted = base_fits(batch, x, numbers, forms, progress)
        cost = np.where(fitted.sound & np.isfinite(cost), fitted.cost, np.inf)
        x = np.array(fitted.x)
    return with_free_inlet(batch, jnp.asarray(x)), cost


def with_own_inlet(assumed: Diagnosis, own: Diagnosis) -> Diagnosis:
    """The diagnosis of a record whose aortic waveform is not the assumed one.

    Args:
        assumed: with the assumed waveform.
        own: with the recorded one.
    """
    effect = find_effect(own.effects, EFFECT)
    at = [effect.id for effect in own.effects].index(EFFECT)
    size = inlet_rms(own.record) / MMHG
    sd = float(np.nanmin(np.asarray(own.record.wave_offset_sd)[:, 0])) / MMHG
    fits, acting, log_B = dict(assumed.fits), dict(assumed.acting), dict(assumed.log_B)
    inlet = assumed.forcing[FORCED.index("inlet")]
    alone = float(logsumexp(inlet) - np.log(inlet.size))

    def placed(fitted: Fitted, count: int) -> Fitted:
        """A fit with the size of the waveform, whose sd comes after those of its effects."""
        sizes = np.array(fitted.sizes)
        sizes[at] = size
        return fitted._replace(
            sizes=sizes,
            size_sd=np.append(np.asarray(fitted.size_sd)[:count], sd),
            waves=with_inlet_mean(own.record, jnp.asarray(fitted.waves)),
        )

    for h, fitted in own.fits.items():
        if EFFECT not in h:
            fits[_beside(h)] = placed(fitted, len(h))
            form = recorded_waveform(effect, own.record, float(fitted.x[SQUEEZE]))
            acting[_beside(h)] = (*own.acting[h], form)
            log_B[_beside(h)] = alone + own.log_B[h]
    probabilities = dict.fromkeys((key_of(h) for h in [*assumed.fits, *fits]), 0.0)
    for name, p in own.judgement.probabilities.items():
        h = _beside(() if name == "none" else tuple(name.split("+")))
        key = "unknown" if name == "unknown" else key_of(h)
        probabilities[key] = probabilities.get(key, 0.0) + p
    forms = {**own.forms, EFFECT: {RECORDED: 1.0}}
    return own._replace(
        record=assumed.record,
        own=own.record,
        judgement=_judged(own.judgement, probabilities),
        fits=fits,
        acting=acting,
        forms=forms,
        log_B=log_B,
        forcing=assumed.forcing,
        accompanied={_beside(h): a for h, a in {(): own.forcing, **own.accompanied}.items()},
        beside=_summed(own.beside),
    )


def _beside(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with the aortic waveform as its last effect."""
    return (*(name for name in hypothesis if name != EFFECT), EFFECT)


def _summed(beside: Mapping[Hypothesis, float]) -> dict[Hypothesis, float]:
    found: dict[Hypothesis, float] = {}
    for h, p in beside.items():
        found[_beside(h)] = found.get(_beside(h), 0.0) + p
    return found


def _judged(own: Judgement, probabilities: dict[str, float]) -> Judgement:
    """The verdict, which names the aortic waveform beside what is found with the recorded one."""
    alone = "named" if own.closed else "unknown"
    verdict = alone if own.verdict == "no_gap" else own.verdict
    cover = cover_of(probabilities)
    named = cover if verdict == "ambiguous" else _beside(own.named)
    inclusion = {**own.inclusion, EFFECT: 1.0}
    return own._replace(
        verdict=verdict,
        named=named,
        probabilities=probabilities,
        inclusion=inclusion,
        cover=cover,
        best=_beside(own.best),
    )
