"""Fits of single effects: the first form of each, and further forms where they may matter.

The scan about the base optimum predicts how much better another form of an effect would do than its
first one. A form is fitted where that prediction comes near the best effect of the record, or its
scan near the best one, and either favours it over no effect; and where its effect leads, whatever
the scan says: a scan of a strong effect is far off. The others get the predicted evidence, at most
that of the first form.
Records without waveforms hardly tell forms apart: there all are predicted.

A fit starts from the base optimum. Where an unknown of the patient has gone far from its prior
there, it stands in for what the base model lacks, and a fit of the effect itself may stay: a damped
distal trace looks like an artery of forty times its compliance. Such a record is fitted from the
priors' means as well.
"""

import jax
import numpy as np
from jaxtyping import Bool, Float

from diagnosis.effects import EXPECTED, Effect
from diagnosis.engine import ProgressCallback, run_fits
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue
from diagnosis.measured import Measured
from diagnosis.pairs import Causes
from diagnosis.ridge import along_ridges
from diagnosis.scan import Scan

NEAR = 12.0
"""ln B below that of the best effect down to which further forms are fitted."""

LINEAR = 0.2
"""The same as a share of the best scan: of a strong effect a scan, which is linear in the size, is
off by a part of itself."""

STRONG = 30.0
"""ln B of the best effect from which all forms of it, and of those near it, are fitted."""

WORTH_FITTING = 0.0
"""ln B by the prediction or the scan below which a further form is not fitted: the record is then
likelier without the effect."""

STRAINED = 3.0
"""Distance of an unknown from its prior, in standard deviations, from which fits of effects start
from the priors' means as well."""


def single_fits(
    batch: Measured,
    base: Fitted,
    scan: Scan,
    causes: Causes,
    numbers: Catalogue,
    forms: tuple[Effect, ...],
    progress: ProgressCallback,
) -> Fitted:
    """Fits of every form alone, by record, then form.

    Args:
        batch: the records.
        base: fits of the base model.
        scan: of all forms about these.
        causes: which effect each form belongs to.
        numbers: of the forms.
        forms: every form of every effect.
        progress: called after each block of jobs.
    """
    B, F = batch.period.shape[0], len(forms)
    first = np.array([causes.forms(c)[0] for c in range(len(causes.names))])
    fits = _first_fits(batch, base, first, numbers, forms, progress)
    row = np.arange(B)[:, None] * first.size + causes.of[None, :]
    log_B = (np.asarray(fits.log_evidence).reshape(B, -1) - base.log_evidence[:, None])[
        :, causes.of
    ]
    scanned = np.asarray(scan.log_B)
    expected = log_B + scanned - scanned[:, first][:, causes.of]
    further = ~np.isin(np.arange(F), first)[None, :]
    wanted = further & worth_fitting(expected, scanned, log_B)
    if not batch.n_sensors:
        wanted[:] = False
    every = jax.tree.map(lambda leaf: np.asarray(leaf)[row.ravel()], fits)
    log_Z = np.minimum(expected, log_B) + base.log_evidence[:, None]
    every = every._replace(log_evidence=np.where(further, log_Z, every.log_evidence.reshape(B, F)))
    every = every._replace(log_evidence=every.log_evidence.ravel())
    record, form = np.nonzero(wanted)
    if record.size == 0:
        return every
    positions = np.stack([form, np.full_like(form, -1)], axis=1)
    # a strained record takes the way that its first form took
    strange = strained(base)[record]
    starts = np.where(
        strange[:, None], every.optimum[record * F + form], np.asarray(base.optimum)[record]
    )
    more = run_fits(
        batch, record, positions, starts, numbers, forms,
        further=_elsewhere(starts, record, form, base, forms),
        step="fitting further forms", progress=progress,
    )  # fmt: skip

    def placed(whole: np.ndarray, part: np.ndarray) -> np.ndarray:
        found = whole.copy()
        found[record * F + form] = part
        return found

    return jax.tree.map(placed, every, more)


def worth_fitting(
    expected: Float[np.ndarray, "b forms"],
    scanned: Float[np.ndarray, "b forms"],
    first: Float[np.ndarray, "b forms"],
) -> Bool[np.ndarray, "b forms"]:
    """Which forms may matter.

    Args:
        expected: ln B of every form as the fit of its effect's first form and the scan predict it.
        scanned: ln B by the scan alone: a first form that is far from what happened tells nothing
            of the others.
        first: ln B of the first form of each form's effect.
    """
    lead = first.max(axis=1, keepdims=True)
    leads = (first > lead - NEAR) & (lead > STRONG)
    best, most = (ln_B.max(axis=1, keepdims=True) for ln_B in (expected, scanned))
    near = expected > np.maximum(best - NEAR, WORTH_FITTING)
    within = np.maximum(NEAR, LINEAR * most)
    return leads | near | (scanned > np.maximum(most - within, WORTH_FITTING))


def strained(base: Fitted) -> np.ndarray:
    """Whether an unknown of the base model is far from its prior, by record."""
    return np.any(np.abs(np.asarray(base.x)[:, :-2]) > STRAINED, axis=1)


def _first_fits(
    batch: Measured,
    base: Fitted,
    first: np.ndarray,
    numbers: Catalogue,
    forms: tuple[Effect, ...],
    progress: ProgressCallback,
) -> Fitted:
    """Fits of the first form of every effect, by record, then effect."""
    B = batch.period.shape[0]
    record = np.repeat(np.arange(B), first.size)
    positions = np.stack([np.tile(first, B), np.full(record.size, -1)], axis=1)
    curved = first[[forms[k].ridge and batch.n_sensors == 0 for k in first]]
    free = ~np.isin(positions[:, 0], curved)
    parts: list[Fitted] = []
    if np.any(free):
        record_of, effect_of = record[free], positions[free, 0]
        start = np.asarray(base.optimum)[record_of]
        parts.append(
            run_fits(
                batch, record_of, positions[free], start, numbers, forms,
                further=_elsewhere(start, record_of, effect_of, base, forms),
                step="fitting every effect", progress=progress,
            )
        )  # fmt: skip
    if curved.size:
        parts.append(along_ridges(batch, base, curved, numbers, forms, progress))
    back = np.argsort(~free, kind="stable").argsort()
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[back], *parts)


def _expected(starts: np.ndarray) -> np.ndarray:
    """Starts at the expected size of the effect."""
    moved = starts.copy()
    moved[:, -2] = EXPECTED
    return moved


def _elsewhere(
    starts: np.ndarray,
    record: np.ndarray,
    form: np.ndarray,
    base: Fitted,
    forms: tuple[Effect, ...],
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Further starts of fits, see `run_fits`: at the expected size, and from the priors' means."""
    two = np.flatnonzero(np.array([effect.two_starts for effect in forms])[form])
    far = np.flatnonzero(strained(base)[record])
    none = np.zeros((far.size, starts.shape[1]))
    return [(two, _expected(starts[two])), (far, none), (far, _expected(none))]
