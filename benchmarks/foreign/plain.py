"""What baselines see of a record: the fit of the base model, its linearisation, and the score scan.

The base model is fitted as the diagnosis fits it, with the colour of the noise that it leaves. No
effect is fitted. At the optimum x, with W whitening the noise, the model is linear in the unknowns
and in the standardised sizes φ of all forms of all effects,

    W (y − f(x)) = r,     f ≈ f(x) + J δ + G φ.
"""

import pathlib
from collections.abc import Iterable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.blind.diagnoses import records_in
from diagnosis import CATALOGUE, Effect, Record, measured, stacked
from diagnosis.colour import with_power
from diagnosis.effects import all_forms
from diagnosis.engine import coloured_base_fits, no_progress
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue, numbers_of
from diagnosis.measured import Measured
from diagnosis.scan import Linearised, Scan, linearise, score_scan

BATCH = 16
"""Records fitted together, after which answers so far are written."""

FORMS = all_forms(CATALOGUE)
"""Every form of every effect, in the order of G; those of the diagnosis, whose compiled fits are
used again."""


class PlainFit(NamedTuple):
    """The base model in one record.

    Attributes:
        conditions: their names.
        record: with the colour of its noise.
        fitted: the fit without any effect.
        linear: residuals and derivatives there; those by effects are of `FORMS`.
        scan: the score scan there, over `FORMS`.
    """

    conditions: tuple[str, ...]
    record: Measured
    fitted: Fitted
    linear: Linearised
    scan: Scan

    @property
    def sound(self) -> bool:
        """Whether the fit is finite."""
        return bool(self.fitted.sound)


def in_batches(
    places: Iterable[pathlib.Path], size: int = BATCH
) -> Iterator[tuple[list[pathlib.Path], list[Record], Measured]]:
    """Records of folders in batches of one shape: their folders, the records, and their arrays.

    Args:
        places: folders of records.
        size: largest number of records of a batch.
    """
    alike: dict[str, list[tuple[pathlib.Path, Record, Measured]]] = {}
    for place, record in records_in(places).items():
        one = measured(record)
        leaves, structure = jax.tree.flatten(one)
        alike.setdefault(f"{structure} {[leaf.shape for leaf in leaves]}", []).append(
            (place, record, one)
        )
    for group in alike.values():
        for first in range(0, len(group), size):
            at, records, arrays = zip(*group[first : first + size], strict=True)
            yield list(at), list(records), stacked(list(arrays))


def plain_fits(records: Iterable[Record], batch: Measured) -> list[PlainFit]:
    """Fits of the base model to a batch of records of one shape.

    Args:
        records: the records.
        batch: their arrays, see `in_batches`.

    Raises:
        ValueError: there are no waveforms.
    """
    if not batch.n_sensors:
        raise ValueError("These baselines look at waveforms. Give records that hold them.")
    numbers = numbers_of(FORMS)
    batch, fits = coloured_base_fits(with_power(batch), numbers, FORMS, no_progress)
    found = []
    for b, record in enumerate(records):
        arrays, fitted = (jax.tree.map(lambda leaf, b=b: leaf[b], own) for own in (batch, fits))
        linear, scan = jax.tree.map(
            np.asarray, _scanned(arrays, jnp.asarray(fitted.x), numbers, FORMS)
        )
        names = tuple(condition.name for condition in record.conditions)
        found.append(PlainFit(names, arrays, fitted, linear, scan))
    return found


@partial(jax.jit, static_argnames=("effects",))
def _scanned(
    record: Measured, x: Float[Array, " k"], numbers: Catalogue, effects: tuple[Effect, ...]
) -> tuple[Linearised, Scan]:
    linear = linearise(record, effects, numbers, x, jnp.zeros(len(effects)))
    return linear, score_scan(linear, numbers)
