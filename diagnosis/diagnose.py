"""Diagnosis of a batch of records: all hypotheses, their evidence, and the verdicts.

1. Fit the base model, learn the colour of the noise from what it leaves (`colour`), fit again.
2. Scan all effects and pairs with one Jacobian at its optimum. Fit every effect from there, in all
   forms that may matter (`singles`); without waveforms, integrate the evidence of some over their
   size. The evidence of an effect is the mean over its forms.
3. At the two best effects, scan all partners with one Jacobian. Fit the four best pairs, and the
   best effect with all partners that a scan from size zero may miss. Other pairs get the evidence
   of the scan, with at most the gain of the fitted pairs. If no effect stands out, fit no pair: all
   get the gain of the first scan over the fit of their better half.
4. Add a free forcing at every place, alone and to the best hypotheses: "unknown".
5. Probabilities and verdict from evidence and priors.
6. Compare how the best hypothesis and no gap predict conditions that were left out (`predictive`);
   one that predicts worse is not named. Nor is one that misses the held-out traces by more than no
   gap does (`shrink.heeding_held_out`).
   Nothing is named, and no gap is not stated, where the beats are not alike (`steadiness`).
7. Where nothing explains a record, and its aortic trace itself misfits or a free forcing would act
   at the inlet, repeat all this with the recorded aortic waveform in place of the assumed one
   (`inlet`, `own_inlet`).
"""

from collections.abc import Mapping, Sequence

import jax
import numpy as np
from scipy.special import logsumexp

from diagnosis.catalogue import CATALOGUE
from diagnosis.colour import with_power
from diagnosis.effects import SCALE, Effect, all_forms
from diagnosis.engine import (
    ProgressCallback,
    coloured_base_fits,
    compiled_ahead,
    no_progress,
    rows,
    run_forcings,
    run_predictions,
    run_scans,
)
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue, numbers_of
from diagnosis.measured import Measured, compiled_weights
from diagnosis.own_inlet import inlet_freed, needs_own_inlet, with_own_inlet
from diagnosis.pairs import (
    WORTH_PAIRING,
    Causes,
    Pairs,
    causes_of,
    pair_evidence,
    promising_pairs,
    row_of,
    scanned_gains,
)
from diagnosis.prediction import n_unknowns
from diagnosis.predictive import Predicted
from diagnosis.result import Diagnosis
from diagnosis.scan import Scan
from diagnosis.shrink import heeding_held_out
from diagnosis.singles import single_fits
from diagnosis.steadiness import unlike
from diagnosis.verdict import (
    PRIOR,
    Hypothesis,
    judge,
    of_unlike_beats,
    predicts_no_worse,
    probabilities_of,
    unconfirmed,
)

ACCOMPANIED = 2
"""Number of likeliest hypotheses to which a free forcing is added."""


def diagnose(
    batch: Measured,
    *,
    effects: Sequence[Effect] = CATALOGUE,
    prior_scale: float = 1.0,
    progress: ProgressCallback = no_progress,
) -> list[Diagnosis]:
    """Diagnose a batch of records of one shape.

    Args:
        batch: records with a leading axis, see `record.stacked`.
        effects: the catalogue.
        prior_scale: factor on the prior standard deviation of every size.
        progress: called after each block of jobs.

    Raises:
        ValueError: there is no effect, or the prior scale is not positive.
        RuntimeError: a base model could not be fitted.
    """
    effects = tuple(effects)
    if not effects or not (np.isfinite(prior_scale) and prior_scale > 0.0):
        raise ValueError(
            f"{len(effects)} effects with a prior scale of {prior_scale}: give at least one effect "
            "and a positive scale."
        )
    forms = all_forms(effects)
    numbers = numbers_of(forms, prior_scale)
    if batch.n_sensors:
        batch = with_power(batch)
    with compiled_ahead(batch, numbers, forms):
        found = _diagnosed(batch, effects, forms, numbers, progress)
    freed = np.array([b for b, d in enumerate(found) if needs_own_inlet(d)], int)
    if freed.size == 0:
        return [_heeding(d) for d in found]
    own, sound = inlet_freed(rows(batch, freed), numbers, forms, progress)
    if not np.any(sound):
        return [_heeding(d) for d in found]
    own = rows(own, np.flatnonzero(sound))
    with compiled_ahead(own, numbers, forms):
        again = _diagnosed(own, effects, forms, numbers, progress)
    for b, d in zip(freed[sound], again, strict=True):
        found[b] = with_own_inlet(found[b], d)
    return [_heeding(d) for d in found]


def _heeding(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis with a verdict that heeds what was held out, and beats that are not alike."""
    heeded = heeding_held_out(diagnosis)
    numbers = heeded.record.steadiness
    if numbers is None:
        return heeded
    ways = unlike(np.asarray(numbers))
    return heeded._replace(judgement=of_unlike_beats(heeded.judgement, ways))


def _diagnosed(
    batch: Measured,
    effects: tuple[Effect, ...],
    forms: tuple[Effect, ...],
    numbers: Catalogue,
    progress: ProgressCallback,
) -> list[Diagnosis]:
    """Diagnoses with the inlet as it is."""
    causes = causes_of(effects, forms)
    B, F = batch.period.shape[0], len(forms)

    batch, base = coloured_base_fits(batch, numbers, forms, progress)
    if not np.all(base.sound):
        bad = ", ".join(str(k) for k in np.flatnonzero(~base.sound))
        raise RuntimeError(
            f"The base model could not be fitted to record(s) {bad} of the batch. Look for "
            "implausible pressures or periods, or leave the record out."
        )
    scan = run_scans(
        batch, range(B), [(-1, -1)] * B, np.asarray(base.x), np.asarray(base.kinds), numbers, forms
    )
    single = single_fits(batch, base, scan, causes, numbers, forms, progress)
    log_B = np.asarray(single.log_evidence).reshape(B, F) - base.log_evidence[:, None]
    found = promising_pairs(batch, single, log_B, causes, numbers, forms, progress)
    pairs = [
        found.get(b) or Pairs({}, scanned_gains(log_B[b], row_of(scan, b), causes))
        for b in range(B)
    ]
    forced = _forcings(batch, base, single, pairs, causes, numbers, forms, progress)
    counts = np.sum(np.asarray(jax.vmap(compiled_weights)(batch)) > 0.0, axis=(1, 2))
    drafts = [
        _assembled(
            batch, effects, forms, b, base, single, pairs[b], row_of(scan, b), forced[b],
            int(counts[b]),
        )
        for b in range(B)
    ]  # fmt: skip
    return _checked(batch, drafts, numbers, forms, progress)


def _forcings(
    batch: Measured,
    base: Fitted,
    single: Fitted,
    pairs: Sequence[Pairs],
    causes: Causes,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> list[dict[tuple[int, ...], np.ndarray]]:
    """Ln Z of a free forcing alone and with the likeliest hypotheses of every record."""
    B, F, E = batch.period.shape[0], len(effects), len(causes.names)
    log_Z = np.asarray(single.log_evidence).reshape(B, F)
    jobs: list[tuple[int, tuple[int, int]]] = []
    fitted: list[Fitted] = []
    for b in range(B):
        jobs.append((b, (-1, -1)))
        fitted.append(row_of(base, b))
        fits = {(int(e), -1): row_of(single, b * F + int(e)) for e in causes.leaders(log_Z[b])}
        fits |= pairs[b].fits
        share = {True: PRIOR["single"] / E, False: PRIOR["pair"] / max(E * (E - 1) / 2, 1)}
        score = {h: float(f.log_evidence) + np.log(share[h[1] < 0]) for h, f in fits.items()}
        score = {h: v for h, v in score.items() if v > float(base.log_evidence[b]) - WORTH_PAIRING}
        for h in sorted(score, key=lambda h: -score[h])[:ACCOMPANIED]:
            jobs.append((b, h))
            fitted.append(fits[h])
    log_Z = run_forcings(
        batch,
        [b for b, _ in jobs],
        [h for _, h in jobs],
        np.array([fit.x for fit in fitted]),
        np.array([fit.kinds for fit in fitted]),
        numbers,
        effects,
        progress=progress,
    )
    found: list[dict[tuple[int, ...], np.ndarray]] = [{} for _ in range(B)]
    for (b, h), value in zip(jobs, log_Z, strict=True):
        found[b][tuple(e for e in h if e >= 0)] = value
    return found


def _assembled(
    batch: Measured,
    effects: tuple[Effect, ...],
    forms: tuple[Effect, ...],
    b: int,
    base: Fitted,
    single: Fitted,
    pairs: Pairs,
    scan: Scan,
    forced: Mapping[tuple[int, ...], np.ndarray],
    n_data: int,
) -> Diagnosis:
    causes = causes_of(effects, forms)
    F, E = len(forms), len(effects)
    member = (causes.of[:, None] == np.arange(E)).astype(float)

    def row(found: Fitted, k: int) -> Fitted:
        fitted = row_of(found, k)
        return fitted._replace(sizes=np.asarray(fitted.sizes) @ member)

    def named(positions: Sequence[int]) -> Hypothesis:
        return tuple(forms[k].id for k in positions)

    own = np.asarray(single.log_evidence)[b * F : (b + 1) * F]
    alone = causes.evidence(own)
    chosen: dict[tuple[int, ...], Fitted] = {
        (int(k),): row(single, b * F + int(k)) for k in causes.leaders(own)
    }
    for pair, fitted in pairs.likeliest(causes).items():
        chosen[pair] = fitted._replace(sizes=np.asarray(fitted.sizes) @ member)
    fits = {(): row(base, b)} | {named(h): f for h, f in chosen.items()}
    acting = {(): ()} | {named(h): tuple(forms[k] for k in h) for h in chosen}
    every: dict[Hypothesis, float] = {(): float(base.log_evidence[b])}
    every |= {(e.id,): float(value) for e, value in zip(effects, alone, strict=True)}
    for (i, j), value in pair_evidence(pairs, alone, causes).items():
        pair = (effects[i].id, effects[j].id)
        every[pair if pair in fits or pair[::-1] not in fits else pair[::-1]] = value
    record = jax.tree.map(lambda leaf: leaf[b], batch)
    unknown = {named(h): value for h, value in forced.items()}
    settled = [effect.id for effect in effects if not effect.forms]
    probabilities, beside = probabilities_of(every, unknown, E, settled)
    misfit = {h: float(f.misfit) for h, f in fits.items() if bool(f.sound)}
    judgement = judge(probabilities, causes.names, misfit, n_data, n_unknowns(record), beside)
    none = every[()]
    lengths = np.asarray(scan.length)[[int(causes.forms(c)[0]) for c in range(E)]]
    return Diagnosis(
        record=record,
        effects=effects,
        judgement=judgement,
        fits=fits,
        acting=acting,
        forms=_form_probabilities(own, causes, forms),
        log_B={h: every[h] - none for h in fits},
        scan=dict(zip(causes.names, causes.evidence(np.asarray(scan.log_B)), strict=True)),
        visibility={e.id: float(v) / (SCALE * e.sd) for e, v in zip(effects, lengths, strict=True)},
        forcing=unknown[()] - none,
        accompanied={h: value - none for h, value in unknown.items() if h},
        beside=beside,
        n_data=n_data,
    )


def _checked(
    batch: Measured,
    drafts: Sequence[Diagnosis],
    numbers: Catalogue,
    forms: tuple[Effect, ...],
    progress: ProgressCallback,
) -> list[Diagnosis]:
    """Diagnoses with their predictions of what was left out, and verdicts that heed them."""
    place = {(form.id, form.form): k for k, form in enumerate(forms)}
    jobs, x = [], []
    for b, draft in enumerate(drafts):
        for hypothesis in ((), draft.judgement.best):
            at = [place[e.id, e.form] for e in draft.acting[hypothesis]]
            jobs.append((b, tuple([*at, -1, -1][:2])))
            x.append(np.asarray(draft.fits[hypothesis].x))
    if not batch.n_sensors:
        return list(drafts)
    found = run_predictions(
        batch, [b for b, _ in jobs], [pair for _, pair in jobs], np.array(x), numbers, forms,
        progress=progress,
    )  # fmt: skip
    checked = []
    for b, draft in enumerate(drafts):
        none, best = row_of(found, 2 * b), row_of(found, 2 * b + 1)
        gain = Predicted(*(after - before for before, after in zip(none, best, strict=True)))
        hidden = bool(np.any(np.asarray(draft.record.held_out) > 0.5))
        held_out = float(gain.held_out) if hidden else None
        better = predicts_no_worse(held_out, float(np.sum(gain.left_out)))
        heeded = better or not draft.judgement.best
        judgement = draft.judgement if heeded else unconfirmed(draft.judgement)
        checked.append(draft._replace(judgement=judgement, predicted=gain))
    return checked


def _form_probabilities(
    log_Z: np.ndarray, causes: Causes, forms: tuple[Effect, ...]
) -> dict[str, dict[str, float]]:
    """Probabilities of the forms of every effect that has several, if it acts alone."""
    found = {}
    for c, name in enumerate(causes.names):
        own = causes.forms(c)
        if own.size > 1:
            p = np.exp(log_Z[own] - logsumexp(log_Z[own]))
            found[name] = {forms[k].form: float(v) for k, v in zip(own, p, strict=True)}
    return found
