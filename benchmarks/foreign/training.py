"""Simulations of the project's own generator, from which methods that learn are trained.

Every record has no effect, one effect of the catalogue, or one cause outside of it: the truths of
`benchmarks.blind.cases`, which no foreign generator shares. A third holds one beat whose samples
divide it, the others are recorded by a clock that does not know the beats. Of each is kept what
`features_of` gives, its cause and its size.
"""

import pathlib
import sys
import tempfile
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.blind.cases import Cases
from benchmarks.blind.clocked import Clock
from benchmarks.blind.truth import OUTSIDE, RANGES
from benchmarks.foreign.features import features_of
from benchmarks.foreign.plain import in_batches, plain_fits
from study.store.cache_folder import use_cache

NONE, UNKNOWN = "none", "unknown"

CLASSES = (NONE, *RANGES, UNKNOWN)
"""What a record may hold; a cause outside the catalogue is "unknown"."""

SHARES = {"none": 0.2, "single": 0.6, "outside": 0.2}
"""Of the records."""

RATES, BEATS, MEMORIES = (50.0, 100.0, 250.0, 500.0), (3, 5, 8, 12), (None, 0.005, 0.015, 0.03)
"""Samples a second [Hz], beats, and memory of the noise [s] of clocks; None is half white."""

SD_MMHG = (0.2, 0.8)
"""Range of the noise: of a mean beat, or of a clock's samples; drawn by chunk."""

OFFSET_SD_MMHG = 0.3
"""Slow offset of each trace."""

CHUNK = 120
"""Records drawn together."""


class Training(NamedTuple):
    """What methods learn from.

    Attributes:
        features: records × features, NaN where a record lacks what a feature is made of.
        cause: position in `CLASSES` of each record's cause.
        size: of the effect [its unit]; NaN without one of the catalogue.
    """

    features: Float[np.ndarray, "n k"]
    cause: np.ndarray
    size: np.ndarray


def train(folder: pathlib.Path, records: int, seed: int) -> Training:
    """Draw and fit records, and write `features.npz`; after an interruption, go on.

    Args:
        folder: of the training.
        records: how many.
        seed: of everything.

    Raises:
        ValueError: the folder holds simulations of another seed.
    """
    use_cache()
    folder.mkdir(parents=True, exist_ok=True)
    done, parts = 0, []
    if (folder / "features.npz").is_file():
        with np.load(folder / "features.npz") as kept:
            if int(kept["seed"]) != seed:
                raise ValueError(
                    f"{folder} holds simulations of seed {int(kept['seed'])}. Use that seed, or "
                    "another folder."
                )
            done = int(kept["records"])
        parts = [load(folder)]
    while done < records:
        count = min(CHUNK, records - done)
        parts.append(simulated(np.random.default_rng([seed, done]), count))
        done += count
        joined = Training(*(np.concatenate(own) for own in zip(*parts, strict=True)))
        partial = folder / "features.part.npz"
        np.savez_compressed(partial, seed=seed, records=done, **joined._asdict())
        partial.replace(folder / "features.npz")
        print(f"{done} of {records}", file=sys.stderr, flush=True)
    return load(folder)


def load(folder: pathlib.Path) -> Training:
    """The simulations that `train` has written."""
    with np.load(folder / "features.npz") as kept:
        return Training(*(kept[name] for name in Training._fields))


def simulated(rng: np.random.Generator, count: int) -> Training:
    """Features of so many new records; one that cannot be read or fitted is left out."""
    causes = draw_causes(rng, count)
    cases = Cases(int(rng.integers(2**31)), count, effects=causes, offset=OFFSET_SD_MMHG)
    sd = float(np.exp(rng.uniform(*np.log(SD_MMHG))))
    clocks = draw_clocks(rng, count)
    features, cause, size = [], [], []
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        cases.write(folder / "clocked", sd, state=False, clocks=clocks)
        cases.write(folder / "dividing", sd)
        places = [
            folder / ("clocked" if k % 3 else "dividing") / f"case-{k:04d}" for k in range(count)
        ]
        for at, records, batch in in_batches(places):
            for where, fit in zip(at, plain_fits(records, batch), strict=True):
                if not fit.sound:
                    continue
                k = int(where.name.split("-")[1])
                name, sizes = causes[k], cases.labels[k]["sizes"]
                known = NONE if name is None else name if name in RANGES else UNKNOWN
                features.append(features_of(fit))
                cause.append(CLASSES.index(known))
                size.append(sizes.get(known, np.nan))
    return Training(np.array(features), np.array(cause), np.array(size))


def draw_causes(rng: np.random.Generator, count: int) -> list[str | None]:
    """The cause of each record, each kind in its share, the causes of a kind evenly."""
    kinds = rng.choice(list(SHARES), count, p=list(SHARES.values()))
    names: dict[str, Sequence[str | None]] = {
        "none": (None,), "single": tuple(RANGES), "outside": tuple(OUTSIDE)
    }  # fmt: skip
    return [names[kind][int(rng.integers(len(names[kind])))] for kind in kinds]


def draw_clocks(rng: np.random.Generator, count: int) -> list[Clock]:
    """Ways to record."""
    return [
        Clock(
            rate=RATES[int(rng.integers(len(RATES)))],
            beats=BEATS[int(rng.integers(len(BEATS)))],
            jitter=float(rng.uniform(0.0, 0.04)),
            stretch=("diastole", "stretched")[int(rng.integers(2))],
            anywhere=bool(rng.random() < 0.5),
            breath=float(rng.choice([0.0, 1.0])),
            memory=MEMORIES[int(rng.integers(len(MEMORIES)))],
        )
        for _ in range(count)
    ]
