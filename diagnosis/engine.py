"""The numerical work of a diagnosis: few compiled functions over blocks of jobs.

A job is one record with one hypothesis. Jobs go in blocks of `BLOCK`, the last one padded, so that
every batch size and every kind of hypothesis runs the same compiled code; within a block all fits
take as many steps as the slowest.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from diagnosis.effects import Effect
from diagnosis.forcing import forcing_evidence
from diagnosis.hypothesis import FITTED, Catalogue, Fitted, fit_hypothesis
from diagnosis.measured import Measured
from diagnosis.prediction import n_unknowns
from diagnosis.scan import Scan, linearise, score_scan

BLOCK = 16
"""Jobs advanced together; more leave a CPU's caches, fewer waste its vectors."""

Tell = Callable[[str, int, int], None]
"""Called with the name of a step, the jobs done and the jobs in all."""


def silent(step: str, done: int, of: int) -> None:
    """Tell nobody."""


def _block(job: Callable[..., Any]) -> Callable[..., Any]:
    """A function of one record and one hypothesis, compiled for a block of them."""

    @partial(jax.jit, static_argnames=("effects", "nonlinear"))
    def block(
        records: Measured,
        pairs: Int[Array, "j 2"],
        x: Float[Array, "j k"],
        *more: Float[Array, " j"],
        numbers: Catalogue,
        effects: tuple[Effect, ...],
        nonlinear: bool,
    ) -> Any:
        def one(measured: Measured, pair: Array, x: Array, *more: Array) -> Any:
            return job(measured, effects, numbers, pair, x, *more, nonlinear=nonlinear)

        return jax.vmap(one)(records, pairs, x, *more)

    return block


_fit_block, _force_block = _block(fit_hypothesis), _block(forcing_evidence)


@partial(jax.jit, static_argnames=("effects",))
def _scan_block(
    records: Measured,
    x: Float[Array, "j k"],
    sizes: Float[Array, "j e"],
    numbers: Catalogue,
    *,
    effects: tuple[Effect, ...],
) -> Scan:
    def one(measured: Measured, x: Array, sizes: Array) -> Scan:
        return score_scan(linearise(measured, effects, numbers, x, sizes), numbers)

    return jax.vmap(one)(records, x, sizes)


def _in_blocks(
    function: Callable[..., Any],
    batch: Measured,
    record: np.ndarray,
    arrays: Sequence[np.ndarray],
    told: Callable[[int], None],
) -> Any:
    """Call a function on blocks of jobs and join what it returns, as NumPy arrays."""
    host = jax.tree.map(np.asarray, batch)
    parts = []
    for first in range(0, record.size, BLOCK):
        at = np.arange(first, min(first + BLOCK, record.size))
        padded = np.concatenate([at, np.full(BLOCK - at.size, at[-1])])
        chosen = jax.tree.map(lambda leaf, p=padded: leaf[record[p]], host)
        found = function(chosen, *(a[padded] for a in arrays))
        parts.append(jax.tree.map(lambda leaf, n=at.size: np.asarray(leaf)[:n], found))
        told(at.size)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def run_fits(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    starts: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    *,
    held: np.ndarray | None = None,
    step: str = "fitting",
    tell: Tell = silent,
) -> Fitted:
    """Fit hypothesis `pairs[j]` to record `record[j]`.

    Args:
        batch: the records.
        record: position of each job's record.
        pairs: positions of the two effects of each job, −1 for none.
        starts: where each fit starts, standardised.
        numbers: of the catalogue.
        effects: the catalogue.
        held: size at which the first effect of each job is held, see `fit_hypothesis`; None where
            all are fitted.
        step: what to call this, for `tell`.
        tell: told of progress.
    """
    fit = partial(_fit_block, numbers=numbers, effects=effects)
    if held is None:
        held = np.full(len(record), FITTED)
    return _by_kind(fit, batch, record, pairs, (starts, held), effects, partial(tell, step))


def _by_kind(
    function: Callable[..., Any],
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    arrays: tuple[np.ndarray, ...],
    effects: tuple[Effect, ...],
    tell: Callable[[int, int], None],
) -> Any:
    """Call a function on jobs, those with a linear and those with a nonlinear ostium apart."""
    record, pairs = np.asarray(record, int), np.asarray(pairs, int).reshape(-1, 2)
    bent = np.array([effect.nonlinear for effect in effects] + [False])
    kind = bent[pairs].any(axis=1)
    parts, order, done = [], [], 0

    def told(count: int) -> None:
        nonlocal done
        done += count
        tell(done, record.size)

    for nonlinear in (False, True):
        at = np.flatnonzero(kind == nonlinear)
        if at.size:
            called = partial(function, nonlinear=nonlinear)
            own = [pairs[at], *(a[at] for a in arrays)]
            parts.append(_in_blocks(called, batch, record[at], own, told))
            order.append(at)
    back = np.argsort(np.concatenate(order))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[back], *parts)


def run_scans(
    batch: Measured,
    record: np.ndarray,
    x: np.ndarray,
    sizes: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
) -> Scan:
    """Score scans about given optima, in NumPy arrays."""
    scan = partial(_scan_block, numbers=numbers, effects=effects)
    return _in_blocks(scan, batch, np.asarray(record, int), (x, sizes), lambda count: None)


def run_forcings(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    x: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    *,
    tell: Tell = silent,
) -> np.ndarray:
    """Ln Z of a free forcing at every place beside hypothesis `pairs[j]` of record `record[j]`."""
    force = partial(_force_block, numbers=numbers, effects=effects)
    told = partial(tell, "looking for what is not in the catalogue")
    return _by_kind(force, batch, record, pairs, (x,), effects, told)


def base_start(batch: Measured) -> np.ndarray:
    """Start of the base fits: the priors' means."""
    measured = jax.tree.map(lambda leaf: leaf[0], batch)
    return np.zeros((batch.period.shape[0], n_unknowns(measured) + 2))
