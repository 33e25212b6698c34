"""An uncertain scalar: its interval, its causes, the chance of a limit, what would shrink it.

If an input were known better, with c times its standard deviation σ_i, and had its median m_i, the
samples would have the weights of such a measurement::

    exp(−(z_i − m_i)²/2s²),   1/s² = 1/(c σ_i)² − 1/σ_i²
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from calibration.spreads import EDGE
from calibration.two_levels import Correction

SHARPEST = 0.15
"""Least standard deviation of an input that is known better, over that now."""


class Uncertainty(eqx.Module):
    """A scalar with its error bar.

    Attributes:
        nominal: value where all inputs have their medians.
        slopes: change of the scalar by one standard deviation of each input, and of the error of
            each costlier scalar, to first order; with evidence its square is the part of the
            variance that the input explains beside the others.
        z: samples of the inputs as standard normal numbers, in the order of `slopes`.
        samples: values of the scalar there, those without one left out.
        n_failed: samples without a value.
        n_effective: samples of equal weight that say as much as those with evidence.
        corrections: what runs of costlier scalars added, in turn.
    """

    nominal: float
    slopes: dict[str, float]
    z: Float[np.ndarray, "samples inputs"]
    samples: Float[np.ndarray, " samples"]
    n_failed: int
    n_effective: float
    corrections: tuple[Correction, ...] = ()

    @property
    def median(self) -> float:
        """Median of the samples."""
        return float(np.median(self.samples))

    @property
    def sd(self) -> float:
        """Standard deviation of the samples."""
        return float(np.std(self.samples))

    @property
    def linear_sd(self) -> float:
        """Standard deviation to first order, √(Σ g²)."""
        return float(np.sqrt(sum(slope**2 for slope in self.slopes.values())))

    @property
    def shares(self) -> dict[str, float]:
        """Part of each input in the variance to first order, largest first; they sum up to 1."""
        total = self.linear_sd**2
        parts = {name: slope**2 / total if total else 0.0 for name, slope in self.slopes.items()}
        return dict(sorted(parts.items(), key=lambda part: -part[1]))

    def interval(self, level: float = 0.9) -> tuple[float, float]:
        """Bounds that leave out as many samples below as above.

        Args:
            level: part of the samples inside.

        Raises:
            ValueError: a level that is not between 0 and 1.
        """
        return _bounds(self.samples, level)

    def chance(self, limit: float) -> float:
        """Part of the samples at or below a limit."""
        return float(np.mean(self.samples <= limit))

    def known_better(
        self, name: str, factor: float = 0.0, *, level: float = 0.9
    ) -> tuple[float, float]:
        """The interval if an input were known better and had its median.

        Args:
            name: of the input.
            factor: its standard deviation then over that now; what is below `SHARPEST` counts as
                that, so that samples are left.
            level: see `interval`.

        Raises:
            KeyError: there is no such input.
            ValueError: a factor below 0 or above 1, or a level that is not between 0 and 1.
        """
        if name not in self.slopes:
            known = ", ".join(self.slopes)
            raise KeyError(f"there is no input {name!r}; take one of {known}")
        if not 0.0 <= factor <= 1.0:
            raise ValueError(f"factor = {factor!r} is not between 0 and 1")
        z = self.z[:, list(self.slopes).index(name)]
        sharp = max(factor, SHARPEST)
        if sharp == 1.0:
            return self.interval(level)
        scale = np.std(z) * sharp / np.sqrt(1.0 - sharp**2)
        weights = np.exp(-0.5 * ((z - np.median(z)) / max(scale, EDGE)) ** 2)
        return _bounds(self.samples, level, weights)


def _bounds(
    samples: Float[np.ndarray, " samples"],
    level: float,
    weights: Float[np.ndarray, " samples"] | None = None,
) -> tuple[float, float]:
    tail = tail_of(level)
    if weights is None:
        low, high = np.quantile(samples, [tail, 1.0 - tail])
    else:
        order = np.argsort(samples)
        below = np.cumsum(weights[order])
        share = (below - 0.5 * weights[order]) / below[-1]
        low, high = np.interp([tail, 1.0 - tail], share, samples[order])
    return float(low), float(high)


def tail_of(level: float) -> float:
    """Part of the samples below an interval."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level!r} is not between 0 and 1")
    return (1.0 - level) / 2.0
