"""Compiled fits, scans and forcings over blocks of jobs.

A job is one record with one hypothesis. Jobs run in blocks of `BLOCK`, the last one padded, so
that all batch sizes and hypotheses share the same compiled code. Within a block all fits take as
many steps as the slowest: after a few, those that are not done go on in blocks of their own.

XLA compiles a program on one core. The first diagnosis of a process compiles all of them, side by
side (`compiled_ahead`); a call waits for its own.
"""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import ArrayLike, PyTree

from diagnosis.colour import coloured
from diagnosis.descent import Descent, at_start
from diagnosis.effects import Effect
from diagnosis.evidence import Whitened
from diagnosis.fit import Fitted, fit_about, towards_optimum
from diagnosis.forcing import forcing_evidence
from diagnosis.form_columns import KINDS
from diagnosis.hypothesis import FITTED, Catalogue, numbers_of
from diagnosis.measured import Measured
from diagnosis.prediction import n_unknowns
from diagnosis.predictive import Predicted, predictive_density
from diagnosis.programs import Program
from diagnosis.scan import Linearised, Scan, base_linearised, scan_about

BLOCK = 2
"""Jobs advanced together: with sixteen each takes a third longer, and all wait for the slowest."""

STEPS = (4, 4, 5, 7, 20)
"""Steps of fits before those that are not done are gathered."""

SAME = 0.2
"""Distance of two optima that count as one [sd of the priors]."""

ProgressCallback = Callable[[str, int, int], None]
"""Called with the name of a step, the number of jobs done, 0 as it begins, and the total."""

T = TypeVar("T")


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def no_progress(step: str, done: int, of: int) -> None:
    """Report nothing."""


_descend, _fit = Program(towards_optimum, Descent), Program(fit_about, Fitted)
_scan, _predict = Program(scan_about, Scan), Program(predictive_density, Predicted)
_force = Program(forcing_evidence, lambda log_Z: log_Z)
_linearise = Program(base_linearised, lambda e, J, G: Linearised(Whitened(e, J), G))


@contextlib.contextmanager
def compiled_ahead(
    batch: Measured, numbers: Catalogue, effects: tuple[Effect, ...]
) -> Iterator[None]:
    """Compile side by side what a diagnosis of a batch calls, while the block is at work.

    Args:
        batch: the records.
        numbers: of the catalogue.
        effects: the catalogue.
    """
    cores = usable_cores()
    if cores == 1:
        yield
        return

    def shaped(*shape: int, dtype: Any = float) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct((BLOCK, *shape), dtype)

    records = jax.tree.map(lambda leaf: shaped(*leaf.shape[1:], dtype=leaf.dtype), batch)
    pairs = shaped(2, dtype=int)
    x = shaped(n_unknowns(jax.tree.map(lambda leaf: leaf[0], batch)) + 2)
    descent = (records, pairs, jax.eval_shape(at_start, x), shaped(), shaped(dtype=int))
    plan: list[tuple[Any, tuple, bool]] = [
        (_descend, descent, False),
        (_fit, (records, pairs, x, shaped()), False),
        (_scan, (records, pairs, x, shaped(len(KINDS))), True),
        (_force, (records, pairs, x, shaped(len(KINDS))), False),
    ]
    if any(effect.nonlinear for effect in effects):
        plan.insert(2, (_descend, descent, True))
        plan.insert(3, (_fit, (records, pairs, x, shaped()), True))
    if batch.n_sensors:
        plan.append((_predict, (records, pairs, x), True))
    first = tuple(effect for effect in effects if not effect.form)
    one = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct((1, *leaf.shape[1:]), leaf.dtype), (records, pairs, x)
    )
    with ThreadPoolExecutor(min(cores, len(plan)), "compile-ahead") as pool:
        for program, given, nonlinear in plan:
            program.ahead(pool, *given, numbers=numbers, effects=effects, nonlinear=nonlinear)
        _linearise.ahead(pool, *one, numbers=numbers_of(first), effects=first, nonlinear=True)
        try:
            yield
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def rows(arrays: T, at: np.ndarray) -> T:
    """Some rows of arrays."""
    return jax.tree.map(lambda leaf: leaf[at], arrays)


def _in_blocks(
    function: Callable[..., Any],
    batch: Measured,
    record: np.ndarray,
    arrays: Sequence[PyTree[np.ndarray]],
    advance: Callable[[int], None],
) -> Any:
    """Call a function on blocks of jobs, one on each core, and join what it returns, in NumPy."""
    host = jax.tree.map(np.asarray, batch)

    def run(first: int) -> Any:
        at = np.arange(first, min(first + BLOCK, record.size))
        padded = np.concatenate([at, np.full(BLOCK - at.size, at[-1])])
        found = function(rows(host, record[padded]), *rows(arrays, padded))
        return jax.tree.map(lambda leaf: np.asarray(leaf)[: at.size], found)

    parts = [run(0)]  # what is not compiled yet is now, once
    advance(min(BLOCK, record.size))
    with ThreadPoolExecutor(usable_cores(), "diagnosis") as pool:
        for part in pool.map(run, range(BLOCK, record.size, BLOCK)):
            parts.append(part)
            advance(jax.tree.leaves(part)[0].shape[0])
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def run_fits(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    starts: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    *,
    further: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    fixed_size: np.ndarray | None = None,
    step: str = "fitting",
    progress: ProgressCallback = no_progress,
) -> Fitted:
    """Fit hypothesis `pairs[j]` to record `record[j]`.

    Args:
        batch: the records.
        record: position of each job's record.
        pairs: positions of the two effects of each job, −1 for none.
        starts: where each fit starts, standardised.
        numbers: of the catalogue.
        effects: the catalogue.
        further: positions of jobs that start elsewhere as well, and where; of several optima that
            of most evidence counts.
        fixed_size: fixed size of the first effect of each job, see `fit_about`; None fits all.
        step: name of this step for `progress`.
        progress: called after each block.
    """
    record, pairs = np.asarray(record, int), np.asarray(pairs, int).reshape(-1, 2)
    if fixed_size is None:
        fixed_size = np.full(record.size, FITTED)
    owner = np.concatenate([np.arange(record.size), *(at for at, _ in further)])
    found = jax.tree.map(np.array, at_start(np.concatenate([starts, *(x for _, x in further)])))
    whole, going = record.size, np.arange(owner.size)
    calls = partial(_by_kind, batch=batch, numbers=numbers, effects=effects)

    # a job counts one half at its optimum and one when its evidence is known
    progress(step, 0, whole)
    for steps in STEPS:
        at = owner[going]
        given = rows(found, going), fixed_size[at], np.full(going.size, steps)
        come = calls(_descend, record[at], pairs[at], given, lambda count: None)
        for kept, new in zip(found, come, strict=True):
            kept[going] = new
        going = going[~come.done]
        progress(step, (whole - np.unique(owner[going]).size) // 2, whole)
        if going.size == 0:
            break
    at = _distinct(found.x, owner)
    of = owner[at]
    half = whole // 2

    def second_half(step: str, done: int, jobs: int) -> None:
        progress(step, half + done * (whole - half) // jobs, whole)

    advance = _counted(second_half, step, of.size)
    fits = calls(_fit, record[of], pairs[of], (found.x[at], fixed_size[of]), advance)
    return rows(fits, _likeliest(fits, of))


def _distinct(x: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Positions of the optima of every owner, each once, by owner."""
    kept: dict[int, list[int]] = {}
    for k, own in enumerate(owner):
        before = x[kept.setdefault(int(own), [])]
        if not np.any(np.all(np.abs(before - x[k]) < SAME, axis=-1)):
            kept[int(own)].append(k)
    return np.array([k for own in sorted(kept) for k in kept[own]], int)


def _likeliest(fits: Fitted, owner: np.ndarray) -> np.ndarray:
    """Of every owner the position of the fit with most evidence."""
    order = np.lexsort([-np.where(fits.sound, fits.log_evidence, -np.inf), owner])
    return order[np.unique(owner[order], return_index=True)[1]]


def _by_kind(
    program: Any,
    record: np.ndarray,
    pairs: np.ndarray,
    arrays: Sequence[PyTree[np.ndarray]],
    advance: Callable[[int], None],
    *,
    batch: Measured,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
) -> Any:
    """Call a program on jobs, separately for linear and nonlinear ostia."""
    bent = np.array([effect.nonlinear for effect in effects] + [False])
    kind = bent[pairs].any(axis=1)
    parts, order = [], []
    for nonlinear in (False, True):
        at = np.flatnonzero(kind == nonlinear)
        if at.size:
            called = partial(program, numbers=numbers, effects=effects, nonlinear=nonlinear)
            own = [pairs[at], *rows(arrays, at)]
            parts.append(_in_blocks(called, batch, record[at], own, advance))
            order.append(at)
    back = np.argsort(np.concatenate(order))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[back], *parts)


def _counted(progress: ProgressCallback, step: str, jobs: int) -> Callable[[int], None]:
    """A function that reports that some more jobs are done; none is yet."""
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        progress(step, done, jobs)

    advance(0)
    return advance


def run_scans(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    x: np.ndarray,
    kinds: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
) -> Scan:
    """Score scan about hypothesis `pairs[j]` of record `record[j]`, in NumPy arrays.

    The fit of each job gave x and the probabilities of what its equations are. All take the
    nonlinear solution: some effects need it.
    """
    scan = partial(_scan, numbers=numbers, effects=effects, nonlinear=True)
    arrays = np.asarray(pairs, int).reshape(-1, 2), x, kinds
    return _in_blocks(scan, batch, np.asarray(record, int), arrays, lambda count: None)


def run_forcings(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    x: np.ndarray,
    kinds: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    *,
    progress: ProgressCallback = no_progress,
) -> np.ndarray:
    """Ln Z of a free forcing at every place beside hypothesis `pairs[j]` of record `record[j]`.

    The fit of each job gave x and the probabilities of what its equations are.
    """
    record, pairs = np.asarray(record, int), np.asarray(pairs, int).reshape(-1, 2)
    counted = _counted(progress, "looking for what is not in the catalogue", record.size)
    return _by_kind(
        _force, record, pairs, (x, kinds), counted,
        batch=batch, numbers=numbers, effects=effects,
    )  # fmt: skip


def run_predictions(
    batch: Measured,
    record: Sequence[int] | np.ndarray,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    x: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    *,
    progress: ProgressCallback = no_progress,
) -> Predicted:
    """Ln predictive densities of hypothesis `pairs[j]` of record `record[j]`.

    All take the nonlinear solution: jobs are few, and one compilation is less than two.
    """
    predict = partial(_predict, numbers=numbers, effects=effects, nonlinear=True)
    arrays = (np.asarray(pairs, int).reshape(-1, 2), x)
    advance = _counted(progress, "predicting conditions that were left out", len(record))
    return _in_blocks(predict, batch, np.asarray(record, int), arrays, advance)


def linearised_base(record: Measured, effects: tuple[Effect, ...], x: ArrayLike) -> Linearised:
    """One record's model, linearised at an optimum x of the base model, in NumPy arrays.

    Args:
        record: without a leading axis.
        effects: the catalogue.
        x: the optimum, of which the unknowns of the base model are taken.
    """
    given = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (record, np.array([-1, -1]), x))
    found = _linearise(*given, numbers=numbers_of(effects), effects=effects, nonlinear=True)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[0], found)


def base_start(batch: Measured) -> np.ndarray:
    """Start of the base fits: the priors' means."""
    measured = jax.tree.map(lambda leaf: leaf[0], batch)
    return np.zeros((batch.period.shape[0], n_unknowns(measured) + 2))


def base_fits(
    batch: Measured,
    start: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback,
) -> Fitted:
    """Fits of the base model, by record."""
    B = batch.period.shape[0]
    return run_fits(
        batch, range(B), [(-1, -1)] * B, start, numbers, effects,
        step="fitting the base model", progress=progress,
    )  # fmt: skip


def coloured_base_fits(
    batch: Measured, numbers: Catalogue, effects: tuple[Effect, ...], progress: ProgressCallback
) -> tuple[Measured, Fitted]:
    """Records with the colour of noise that the base model leaves, and its fits with that."""
    fits = base_fits(batch, base_start(batch), numbers, effects, progress)
    if batch.n_sensors and np.all(fits.sound):
        batch = coloured(batch, fits.residual)
        fits = base_fits(batch, np.asarray(fits.optimum), numbers, effects, progress)
    return batch, fits
