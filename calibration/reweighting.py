"""Samples weighed by what was measured (Bayes' rule), and drawn again by their weights.

Evidence, a measured value m ± s of something that the inputs predict as f(z), weighs a sample by
exp(−(f(z) − m)²/2s²).

Source: Douc & Cappé 2005, Comparison of resampling schemes (systematic resampling).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float, Int

LEAST_EFFECTIVE = 100.0
"""Samples of equal weight that must be left with evidence."""

FARTHEST = 3.0
"""Standard deviations by which the nearest sample may miss the evidence."""


class Evidence(NamedTuple):
    """A measured value of something that the inputs predict.

    Attributes:
        predicted: gives it from a value of each input by name and from the scalar there.
        value: what was measured.
        sd: its standard deviation.
    """

    predicted: Callable[[dict[str, Array], Float[Array, ""]], Float[Array, ""]]
    value: float
    sd: float


def _weights(
    predicted: Sequence[Float[np.ndarray, " samples"]], evidence: Sequence[Evidence]
) -> tuple[Float[np.ndarray, " samples"], float]:
    """Weight of each sample, and how far the nearest one is from the evidence."""
    misfit = sum(((p - e.value) / e.sd) ** 2 for p, e in zip(predicted, evidence, strict=True))
    misfit = np.asarray(misfit)
    if not misfit.size:
        return misfit, np.inf
    weights = np.exp(-0.5 * (misfit - np.min(misfit)))
    return weights / np.sum(weights), float(np.sqrt(np.min(misfit)))


def _out_of_reach(
    predicted: Sequence[Float[np.ndarray, " samples"]], evidence: Sequence[Evidence]
) -> bool:
    """Whether some measured value lies beyond all that is predicted of it."""
    return any(
        not p.size or not np.min(p) <= e.value <= np.max(p)
        for p, e in zip(predicted, evidence, strict=True)
    )


def agreeing(
    predicted: Sequence[Float[np.ndarray, " samples"]], evidence: Sequence[Evidence]
) -> float:
    """Samples of equal weight that agree with the evidence; infinite where none comes near."""
    weights, farthest = _weights(predicted, evidence)
    if farthest > FARTHEST and _out_of_reach(predicted, evidence):
        return np.inf
    return float(1.0 / np.sum(weights**2))


def drawn_again(
    predicted: Sequence[Float[np.ndarray, " samples"]], evidence: Sequence[Evidence], seed: int
) -> tuple[Int[np.ndarray, " samples"], float]:
    """Samples drawn by their weights, and how many of equal weight say as much."""
    weights, farthest = _weights(predicted, evidence)
    if farthest > FARTHEST and _out_of_reach(predicted, evidence):
        raise RuntimeError(
            f"what was measured and the other numbers contradict each other: the nearest of"
            f" {len(weights)} samples is {farthest:.1f} standard deviations away. Check the"
            " measured value and its standard deviation, or widen the other numbers."
        )
    n_effective = float(1.0 / np.sum(weights**2))
    if not n_effective >= LEAST_EFFECTIVE:
        raise RuntimeError(
            f"only {n_effective:.0f} of {len(weights)} samples agree with what was measured."
            " Give it a larger standard deviation, or take more samples."
        )
    n = len(weights)
    places = (np.arange(n) + np.random.default_rng(seed).uniform()) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), places), n - 1), n_effective
