"""Diagnosis of a batch of records: all hypotheses, their evidence, and the verdicts.

1. Fit the base model.
2. Scan all effects and pairs with one Jacobian at its optimum. Fit every effect from there; without
   waveforms, integrate the evidence of some over their size.
3. At the two best effects, scan all partners with one Jacobian. Fit the four best pairs, and the
   best effect with all partners that a scan from size zero may miss. Other pairs get the evidence
   of the scan, with at most the gain of the fitted pairs. If no effect stands out, fit no pair: all
   get the gain of the first scan over the fit of their better half.
4. Add a free forcing at every place, alone and to the best hypotheses: "unknown".
5. Probabilities and verdict from evidence and priors.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diagnosis.catalogue import CATALOGUE
from diagnosis.effects import SCALE, Effect
from diagnosis.engine import (
    ProgressCallback,
    base_start,
    no_progress,
    run_fits,
    run_forcings,
    run_scans,
)
from diagnosis.hypothesis import Catalogue, Fitted, numbers_of
from diagnosis.measured import Measured, weights
from diagnosis.prediction import n_unknowns
from diagnosis.ridge import along_ridges
from diagnosis.scan import Scan
from diagnosis.verdict import PRIOR, Hypothesis, Judgement, judge, probabilities_of

WORTH_PAIRING = 3.0
"""ln B of the best single effect below which pairs are not tried."""

PARTNERS = (3, 1)
"""Partners tried of the best and the second best single effect."""

ACCOMPANIED = 2
"""Number of likeliest hypotheses to which a free forcing is added."""


class Diagnosis(NamedTuple):
    """The diagnosis of one record; `study` writes it as a report.

    Attributes:
        record: the record.
        effects: the catalogue.
        judgement: probabilities and verdict.
        fits: every fitted hypothesis.
        log_B: ln evidence of every fitted hypothesis over that of no gap.
        scan: ln B of every effect by the score scan about the base optimum.
        visibility: detectability λ of each effect in this record, per unit of its size.
        forcing: ln B of a free forcing alone, places × correlations × lengths × amplitudes.
        accompanied: the same together with other hypotheses, over no gap.
        beside: parts of the probability of "unknown", by the effects that act together with it.
        n_data: number of data.
    """

    record: Measured
    effects: tuple[Effect, ...]
    judgement: Judgement
    fits: Mapping[Hypothesis, Fitted]
    log_B: Mapping[Hypothesis, float]
    scan: Mapping[str, float]
    visibility: Mapping[str, float]
    forcing: Float[np.ndarray, "p s l a"]
    accompanied: Mapping[Hypothesis, Float[np.ndarray, "p s l a"]]
    beside: Mapping[Hypothesis, float]
    n_data: int

    @property
    def base(self) -> Fitted:
        """The fit without any effect."""
        return self.fits[()]

    @property
    def best(self) -> Fitted:
        """The fit of the most probable hypothesis."""
        return self.fits[self.judgement.best]


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
    numbers = numbers_of(effects, prior_scale)
    B, E = batch.period.shape[0], len(effects)
    base = run_fits(
        batch, range(B), [(-1, -1)] * B, base_start(batch), numbers, effects,
        step="fitting the base model", progress=progress,
    )  # fmt: skip
    if not np.all(base.sound):
        bad = ", ".join(str(k) for k in np.flatnonzero(~base.sound))
        raise RuntimeError(
            f"The base model could not be fitted to record(s) {bad} of the batch. Look for "
            "implausible pressures or periods, or leave the record out."
        )
    x = np.asarray(base.x)
    record = np.repeat(np.arange(B), E)
    pairs = np.array([(e, -1) for _ in range(B) for e in range(E)])
    curved = np.flatnonzero([effect.ridge and batch.n_sensors == 0 for effect in effects])
    free = ~np.isin(pairs[:, 0], curved)
    parts: list[Fitted] = []
    if np.any(free):
        start = x[record[free]]
        fits = _best_of_starts(batch, record[free], pairs[free], start, numbers, effects, progress)
        parts.append(fits)
    if curved.size:
        parts.append(along_ridges(batch, base, curved, numbers, effects, progress))
    back = np.argsort(~free, kind="stable").argsort()
    single = jax.tree.map(lambda *leaves: np.concatenate(leaves)[back], *parts)
    single_log_B = np.asarray(single.log_evidence).reshape(B, E) - base.log_evidence[:, None]

    scan = run_scans(batch, np.arange(B), x, np.zeros((B, E)), numbers, effects)
    found, scanned = _pairs(batch, single, single_log_B, numbers, effects, progress)
    forced = _forcings(batch, base, single, found, numbers, effects, progress)
    counts = np.asarray(jnp.sum(jax.vmap(weights)(batch) > 0.0, axis=(1, 2)))
    return [
        _assembled(batch, effects, b, base, single, found.get(b, {}),
                   scanned.get(b) or _gains(single_log_B[b], row_of(scan, b)),
                   row_of(scan, b), forced[b], int(counts[b]))
        for b in range(B)
    ]  # fmt: skip


def _best_of_starts(
    batch: Measured,
    record: np.ndarray,
    pairs: np.ndarray,
    starts: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> Fitted:
    """Fits from size zero, some also from the expected size; the better one is returned."""
    near = run_fits(
        batch,
        record,
        pairs,
        starts,
        numbers,
        effects,
        step="fitting every effect",
        progress=progress,
    )
    curved = np.array([effect.two_starts for effect in effects])
    again = np.flatnonzero(curved[pairs[:, 0]])
    if again.size == 0:
        return near
    moved = starts[again].copy()
    moved[:, -2] = 1.0 / SCALE
    far = run_fits(
        batch, record[again], pairs[again], moved, numbers, effects,
        step="fitting from a second start", progress=progress,
    )  # fmt: skip
    better = far.sound & (far.log_evidence > near.log_evidence[again])

    def merge(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        merged = first.copy()
        merged[again[better]] = second[better]
        return merged

    return jax.tree.map(merge, near, far)


T = TypeVar("T", Fitted, Scan)


def row_of(found: T, k: int) -> T:
    """One fit of many, or one scan."""
    return jax.tree.map(lambda leaf: leaf[k], found)


def _gains(log_B: np.ndarray, scan: Scan) -> dict[tuple[int, int], float]:
    """Gain in ln Z of every pair over its better half, by the scan about the base optimum."""
    upper = zip(*np.triu_indices(log_B.size, 1), strict=True)
    pairs = [(int(i), int(j)) if log_B[i] >= log_B[j] else (int(j), int(i)) for i, j in upper]
    return {(i, j): float(scan.pair_log_B[i, j] - scan.log_B[i]) for i, j in pairs}


def _pairs(
    batch: Measured,
    single: Fitted,
    log_B: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> tuple[dict[int, dict[tuple[int, int], Fitted]], dict[int, dict[tuple[int, int], float]]]:
    """Fits of the most promising pairs, and gains of all partners by the scan, by record."""
    E = len(effects)
    worth = np.flatnonzero(log_B.max(axis=1) > WORTH_PAIRING)
    if E < 2 or worth.size == 0:
        return {}, {}
    order = np.argsort(-log_B, axis=1)
    rows = np.concatenate([worth * E + order[worth, place] for place in (0, 1)])
    owner = np.concatenate([worth, worth])
    partners = run_scans(
        batch, owner, np.asarray(single.x)[rows], np.asarray(single.sizes)[rows], numbers, effects
    )
    jobs: list[tuple[int, int, int]] = []
    scanned: dict[int, dict[tuple[int, int], float]] = {}
    starts = []
    for place, count in enumerate(PARTNERS):
        for n, b in enumerate(worth):
            at = place * worth.size + n
            first = int(order[b, place])
            ranked = [int(e) for e in np.argsort(-partners.log_B[at]) if e != first]
            taken = [{i, j} for owner_, i, j in jobs if owner_ == b]
            fresh = [e for e in ranked if {first, e} not in taken][:count]
            scanned.setdefault(int(b), {}).update(
                {(first, e): float(partners.log_B[at, e]) for e in range(E) if e != first}
            )
            for e in fresh:
                jobs.append((int(b), first, e))
                start = np.asarray(single.x)[rows[at]].copy()
                start[-1] = 0.5 * np.clip(partners.size[at, e], -1.0, 1.0)
                starts.append(start)
            if place == 0:
                for e in np.flatnonzero([effect.two_starts for effect in effects]):
                    if e != first:
                        jobs.append((int(b), first, int(e)))
                        start = np.asarray(single.x)[rows[at]].copy()
                        start[-1] = 1.0 / SCALE
                        starts.append(start)
    fitted = run_fits(
        batch,
        [b for b, _, _ in jobs],
        [(i, j) for _, i, j in jobs],
        np.array(starts),
        numbers,
        effects,
        step="fitting pairs of effects",
        progress=progress,
    )
    found: dict[int, dict[tuple[int, int], Fitted]] = {}
    for k, (b, i, j) in enumerate(jobs):
        pairs = found.setdefault(b, {})
        if (i, j) not in pairs or fitted.log_evidence[k] > pairs[i, j].log_evidence:
            pairs[i, j] = row_of(fitted, k)
    return found, scanned


def _forcings(
    batch: Measured,
    base: Fitted,
    single: Fitted,
    pairs: Mapping[int, Mapping[tuple[int, int], Fitted]],
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> list[dict[tuple[int, ...], np.ndarray]]:
    """Ln Z of a free forcing alone and with the likeliest hypotheses of every record."""
    B, E = batch.period.shape[0], len(effects)
    jobs: list[tuple[int, tuple[int, int]]] = []
    x = []
    for b in range(B):
        jobs.append((b, (-1, -1)))
        x.append(np.asarray(base.x)[b])
        fits = {(e, -1): row_of(single, b * E + e) for e in range(E)} | dict(pairs.get(b, {}))
        share = {True: PRIOR["single"] / E, False: PRIOR["pair"] / max(E * (E - 1) / 2, 1)}
        score = {h: float(f.log_evidence) + np.log(share[h[1] < 0]) for h, f in fits.items()}
        score = {h: v for h, v in score.items() if v > float(base.log_evidence[b]) - WORTH_PAIRING}
        for h in sorted(score, key=lambda h: -score[h])[:ACCOMPANIED]:
            jobs.append((b, h))
            x.append(np.asarray(fits[h].x))
    log_Z = run_forcings(
        batch,
        [b for b, _ in jobs],
        [h for _, h in jobs],
        np.array(x),
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
    b: int,
    base: Fitted,
    single: Fitted,
    pairs: Mapping[tuple[int, int], Fitted],
    scanned: Mapping[tuple[int, int], float],
    scan: Scan,
    forced: Mapping[tuple[int, ...], np.ndarray],
    n_data: int,
) -> Diagnosis:
    names = tuple(effect.id for effect in effects)
    E = len(names)
    fits: dict[Hypothesis, Fitted] = {(): row_of(base, b)}
    fits |= {(name,): row_of(single, b * E + e) for e, name in enumerate(names)}
    for (i, j), fitted in pairs.items():
        fits[(names[i], names[j])] = fitted
    log_Z = {h: float(f.log_evidence) for h, f in fits.items()}
    record = jax.tree.map(lambda leaf: leaf[b], batch)
    unknown = {tuple(names[e] for e in h): value for h, value in forced.items()}
    every = {**_unfitted(log_Z, scanned, names), **log_Z}
    probabilities, beside = probabilities_of(every, unknown, E)
    misfit = {h: float(f.misfit) for h, f in fits.items() if bool(f.sound)}
    judgement = judge(probabilities, names, misfit, n_data, n_unknowns(record), beside)
    none = log_Z[()]
    return Diagnosis(
        record=record,
        effects=effects,
        judgement=judgement,
        fits=fits,
        log_B={h: value - none for h, value in log_Z.items()},
        scan=dict(zip(names, (float(v) for v in scan.log_B), strict=True)),
        visibility={
            n: float(v) / (SCALE * e.sd)
            for n, v, e in zip(names, scan.length, effects, strict=True)
        },
        forcing=unknown[()] - none,
        accompanied={h: value - none for h, value in unknown.items() if h},
        beside=beside,
        n_data=n_data,
    )


def _unfitted(
    log_Z: Mapping[Hypothesis, float],
    scanned: Mapping[tuple[int, int], float],
    names: tuple[str, ...],
) -> dict[Hypothesis, float]:
    """Ln Z of pairs that were scanned but not fitted."""
    gains: dict[str, list[float]] = {}
    for pair in (h for h in log_Z if len(h) == 2):
        gains.setdefault(pair[0], []).append(log_Z[pair] - log_Z[pair[:1]])
    known = {frozenset(h) for h in log_Z}
    found: dict[Hypothesis, float] = {}
    for (i, j), gain in scanned.items():
        pair = (names[i], names[j])
        if frozenset(pair) not in known and np.isfinite(log_Z[pair[:1]]):
            known.add(frozenset(pair))
            # the least gain of the fitted partners bounds the gain predicted for others
            own = sorted(gains.get(names[i], []), reverse=True)[: max(PARTNERS)]
            found[pair] = log_Z[pair[:1]] + min([gain, *own])
    return found
