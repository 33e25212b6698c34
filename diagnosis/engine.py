"""The numerical work of a diagnosis for a batch of records: compiled once, mapped over jobs.

A job is one record with one hypothesis. Jobs are advanced in chunks: within a chunk all fits take
as many steps as the slowest.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from threadpoolctl import threadpool_limits

from diagnosis.effects import Effect
from diagnosis.forcing import forcing_evidence
from diagnosis.hypothesis import (
    Catalogue,
    Fitted,
    fit_hypothesis,
    linearise,
    score_scan,
)
from diagnosis.measured import Measured
from diagnosis.prediction import n_unknowns

CHUNK = 8
"""Jobs advanced together; more leave a CPU's caches, fewer waste its vectors."""


class Scan(NamedTuple):
    """What one Jacobian says about every effect.

    Attributes:
        log_B: ln B of adding each effect.
        size: its expected standardised size.
    """

    log_B: Float[Array, "j e"]
    size: Float[Array, "j e"]


@partial(jax.jit, static_argnames=("effects", "nonlinear"))
def fit_jobs(
    batch: Measured,
    record: Int[Array, " j"],
    pair: Int[Array, "j 2"],
    start: Float[Array, "j k"],
    numbers: Catalogue,
    *,
    effects: tuple[Effect, ...],
    nonlinear: bool,
) -> Fitted:
    """Fit hypothesis `pair[j]` to record `record[j]`."""

    def one(job: tuple[Array, Array, Array]) -> Fitted:
        record, pair, start = job
        measured = jax.tree.map(lambda leaf: leaf[record], batch)
        return fit_hypothesis(
            measured, effects, numbers, pair, start, nonlinear=nonlinear
        )

    return jax.lax.map(one, (record, pair, start), batch_size=CHUNK)


@partial(jax.jit, static_argnames=("effects",))
def scan_jobs(
    batch: Measured,
    record: Int[Array, " j"],
    x: Float[Array, "j k"],
    sizes: Float[Array, "j e"],
    numbers: Catalogue,
    *,
    effects: tuple[Effect, ...],
) -> Scan:
    """Score scan of every effect about given optima."""

    def one(job: tuple[Array, Array, Array]) -> Scan:
        record, x, sizes = job
        measured = jax.tree.map(lambda leaf: leaf[record], batch)
        found = linearise(measured, effects, numbers, x, sizes)
        return Scan(*score_scan(found, numbers))

    return jax.lax.map(one, (record, x, sizes), batch_size=CHUNK)


@partial(jax.jit, static_argnames=("effects",))
def force_jobs(
    batch: Measured,
    x: Float[Array, "b k"],
    numbers: Catalogue,
    *,
    effects: tuple[Effect, ...],
) -> Float[Array, "b p l a"]:
    """ln Z of a free forcing at every place about the base optimum of every record."""

    def one(job: tuple[Measured, Array]) -> Array:
        measured, x = job
        found = linearise(measured, effects, numbers, x, jnp.zeros(len(effects)))
        return forcing_evidence(measured, found.linear, x)

    return jax.lax.map(one, (batch, x))


def run_fits(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    starts: Array,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
) -> Fitted:
    """Fit jobs of both kinds, with linear and nonlinear ostium, and join them in order."""
    record, pairs = np.asarray(record, int), np.asarray(pairs, int).reshape(-1, 2)
    bent = np.array([effect.nonlinear for effect in effects] + [False])
    kind = bent[pairs].any(axis=1)
    parts, order = [], []
    for nonlinear in (False, True):
        at = np.flatnonzero(kind == nonlinear)
        if at.size:
            # small factorisations: threads of the library would only fight over the cores
            with threadpool_limits(limits=1):
                fitted = fit_jobs(
                    batch, jnp.asarray(record[at]), jnp.asarray(pairs[at]), starts[at], numbers,
                    effects=effects, nonlinear=nonlinear,
                )  # fmt: skip
                parts.append(jax.tree.map(np.asarray, fitted))
            order.append(at)
    back = np.argsort(np.concatenate(order))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[back], *parts)


def base_start(batch: Measured) -> Float[Array, "b k"]:
    """Start of the base fits: the priors' means."""

    measured = jax.tree.map(lambda leaf: leaf[0], batch)
    return jnp.zeros((batch.period.shape[0], n_unknowns(measured) + 2))
