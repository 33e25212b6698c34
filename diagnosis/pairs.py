"""Pairs of effects: which are worth fitting, and the gain of a second effect over the first.

Only causes are paired: of every effect the form that alone explains a record best leads. The gain
of a partner is the mean over its forms.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from diagnosis.effects import EXPECTED, Effect
from diagnosis.engine import ProgressCallback, run_fits, run_scans
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue
from diagnosis.measured import Measured
from diagnosis.predictive import Predicted
from diagnosis.scan import Scan

WORTH_PAIRING = 3.0
"""ln B of the best single effect below which pairs are not tried."""

PARTNERS = (3, 1)
"""Partners tried of the best and the second best single effect."""

T = TypeVar("T", Fitted, Scan, Predicted)


def row_of(found: T, k: int) -> T:
    """One fit of many, one scan, or one prediction."""
    return jax.tree.map(lambda leaf: leaf[k], found)


class Causes(NamedTuple):
    """Forms of effects, and which effect each belongs to.

    Attributes:
        names: ids of the effects.
        of: position in `names` of the effect of every form.
    """

    names: tuple[str, ...]
    of: Int[np.ndarray, " forms"]

    def forms(self, cause: int) -> Int[np.ndarray, " _"]:
        """Positions of an effect's forms."""
        return np.flatnonzero(self.of == cause)

    def evidence(self, log_Z: Float[np.ndarray, " forms"]) -> Float[np.ndarray, " causes"]:
        """Ln of the mean evidence of the forms of every effect."""
        found = [log_Z[self.forms(c)] for c in range(len(self.names))]
        return np.array([logsumexp(own) - np.log(own.size) for own in found])

    def leaders(self, log_Z: Float[np.ndarray, " forms"]) -> Int[np.ndarray, " causes"]:
        """Position of the likeliest form of every effect."""
        found = [self.forms(c) for c in range(len(self.names))]
        return np.array([own[np.argmax(log_Z[own])] for own in found])


def causes_of(effects: Sequence[Effect], forms: Sequence[Effect]) -> Causes:
    """Which effect of a catalogue each form belongs to."""
    names = tuple(effect.id for effect in effects)
    return Causes(names, np.array([names.index(form.id) for form in forms]))


class Pairs(NamedTuple):
    """Pairs of one record.

    Attributes:
        fits: by the positions of two forms.
        gains: ln Z over that of the first alone, by the positions of two forms; scanned, or fitted.
    """

    fits: dict[tuple[int, int], Fitted]
    gains: dict[tuple[int, int], float]

    def likeliest(self, causes: Causes) -> dict[tuple[int, int], Fitted]:
        """Of every two effects the fit whose forms gain most."""
        found: dict[frozenset[int], tuple[int, int]] = {}
        for pair in sorted(self.fits, key=lambda pair: self.gains[pair]):
            found[frozenset(int(causes.of[k]) for k in pair)] = pair
        return {pair: self.fits[pair] for pair in found.values()}


def scanned_gains(
    log_B: Float[np.ndarray, " forms"], scan: Scan, causes: Causes
) -> dict[tuple[int, int], float]:
    """Gain of every pair of leading forms over its better half, by the scan about the base."""
    lead = causes.leaders(log_B)
    found = {}
    for a, i in enumerate(lead):
        for j in lead[a + 1 :]:
            first, second = (i, j) if log_B[i] >= log_B[j] else (j, i)
            gain = float(scan.pair_log_B[first, second] - scan.log_B[first])
            found[int(first), int(second)] = gain
    return found


def promising_pairs(
    batch: Measured,
    single: Fitted,
    log_B: Float[np.ndarray, "records forms"],
    causes: Causes,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> dict[int, Pairs]:
    """Fits of the most promising pairs, and gains of all partners by the scan, by record.

    Args:
        batch: the records.
        single: fits of every form, by record, then form.
        log_B: their ln evidence over that of no gap.
        causes: of the forms.
        numbers: of the forms.
        effects: the forms.
        progress: called after each block of jobs.
    """
    E = len(effects)
    worth = np.flatnonzero(log_B.max(axis=1) > WORTH_PAIRING)
    if len(causes.names) < 2 or worth.size == 0:
        return {}
    leads = {}
    for b in worth:
        order = np.argsort(-causes.evidence(log_B[b]))[:2]
        leads[b] = causes.leaders(log_B[b])[order]
    rows = np.array([b * E + leads[b][place] for place in (0, 1) for b in worth])
    partners = run_scans(
        batch, np.concatenate([worth, worth]), [(int(row % E), -1) for row in rows],
        np.asarray(single.x)[rows], np.asarray(single.kinds)[rows], numbers, effects,
    )  # fmt: skip
    jobs: list[tuple[int, int, int]] = []
    scanned: dict[int, dict[tuple[int, int], float]] = {}
    starts = []

    def add(b: int, at: int, first: int, e: int, size: float) -> None:
        start = np.asarray(single.optimum)[rows[at]].copy()
        start[-1] = size
        jobs.append((b, first, e))
        starts.append(start)

    for place, count in enumerate(PARTNERS):
        for n, b in enumerate(int(b) for b in worth):
            at = place * worth.size + n
            first = int(leads[b][place])
            others = np.flatnonzero(causes.of != causes.of[first])
            gain = np.asarray(partners.log_B[at])
            scanned.setdefault(b, {}).update({(first, int(e)): float(gain[e]) for e in others})
            best = [int(e) for e in causes.leaders(gain) if causes.of[e] != causes.of[first]]
            taken = [{causes.of[i], causes.of[j]} for owner, i, j in jobs if owner == b]
            fresh = [e for e in best if {causes.of[first], causes.of[e]} not in taken]
            for e in sorted(fresh, key=lambda e: -gain[e])[:count]:
                add(b, at, first, e, 0.5 * float(np.clip(partners.size[at, e], -1.0, 1.0)))
            if place == 0:
                for e in best:
                    if effects[e].two_starts:
                        add(b, at, first, e, EXPECTED)
    fitted = run_fits(
        batch, [b for b, _, _ in jobs], [(i, j) for _, i, j in jobs], np.array(starts), numbers,
        effects, step="fitting pairs of effects", progress=progress,
    )  # fmt: skip
    found: dict[int, dict[tuple[int, int], Fitted]] = {int(b): {} for b in worth}
    for k, (b, i, j) in enumerate(jobs):
        fits = found[b]
        if (i, j) not in fits or fitted.log_evidence[k] > fits[i, j].log_evidence:
            fits[i, j] = row_of(fitted, k)
    log_Z = np.asarray(single.log_evidence).reshape(-1, E)
    return {b: Pairs(fits, _bounded(scanned[b], fits, log_Z[b])) for b, fits in found.items()}


def _bounded(
    scanned: Mapping[tuple[int, int], float],
    fits: Mapping[tuple[int, int], Fitted],
    log_Z: Float[np.ndarray, " forms"],
) -> dict[tuple[int, int], float]:
    """Gains of all pairs: those of fits, and scanned ones up to the least of the fitted."""
    own = {pair: float(fit.log_evidence) - log_Z[pair[0]] for pair, fit in fits.items()}
    bound: dict[int, float] = {}
    for first in {pair[0] for pair in scanned}:
        best = sorted((g for (i, _), g in own.items() if i == first), reverse=True)
        # the least gain of the fitted partners bounds the gain predicted for others
        bound[first] = min(best[: max(PARTNERS)], default=np.inf)
    return {(i, j): min(g, bound[i]) for (i, j), g in scanned.items()} | own


def pair_evidence(
    pairs: Pairs, log_Z: Float[np.ndarray, " causes"], causes: Causes
) -> dict[tuple[int, int], float]:
    """Ln Z of pairs of effects: that of the first, and the mean gain over the second's forms.

    Args:
        pairs: of one record.
        log_Z: of every effect alone.
        causes: of the forms.

    Returns:
        By the positions of two effects; a pair stands once, fitted ones first.
    """
    gains: dict[tuple[int, int], list[float]] = {}
    for (i, j), gain in pairs.gains.items():
        gains.setdefault((int(causes.of[i]), int(causes.of[j])), []).append(gain)
    fitted = {(int(causes.of[i]), int(causes.of[j])) for i, j in pairs.fits}
    found: dict[tuple[int, int], float] = {}
    for first, second in sorted(gains, key=lambda pair: pair not in fitted):
        if (second, first) not in found and np.isfinite(log_Z[first]):
            own = np.array(gains[first, second])
            # forms of the second that were not scanned count as those that were
            found[first, second] = float(log_Z[first] + logsumexp(own) - np.log(own.size))
    return found
