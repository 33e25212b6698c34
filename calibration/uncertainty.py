"""How uncertain a scalar is whose inputs are: an interval, its causes, and what would shrink it.

Every input x_i is an increasing function of a standard normal number z_i, so that all inputs of any
distribution are one vector z ~ N(0, I), and a scalar y = f(x(z)). To first order about z = 0::

    y ≈ y₀ + Σ g_i z_i,   g_i = ∂y/∂z_i,   var y ≈ Σ g_i²

g_i is what one standard deviation of an input does to y, and g_i²/Σ g² its share. A scalar that
calibrates inside, such as FFR with α tuned to the resting ratio, has the right correlations by
itself. Shape, quantiles and chances come from samples of z, a scrambled Sobol sequence: for smooth
scalars of a few inputs their error falls nearly as 1/n.

If an input were known c times as well, to first order about the samples::

    y(z with c z_i) = y(z) − (1 − c) g_i(z) z_i ≈ y(z) − (1 − c) g_i z_i

Source: Smith 2013, Uncertainty Quantification, chapters 8 and 15; Owen 1998, ACM TOMACS 8:71.
"""

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm
from jaxtyping import Array, Float
from scipy.special import ndtri
from scipy.stats import qmc

from calibration.sweep import BATCH
from lumped.parameters import Parameter, Range, check_range, is_traced, parameter

MOST_FAILED = 0.01
"""Share of the samples that may have no value."""

_EDGE = 1e-12
"""Least distance of a uniform number from 0 and 1."""


class AbstractSpread(eqx.Module):
    """Distribution of an input, as an increasing function of a standard normal number."""

    ranges: ClassVar[Range]

    def __check_init__(self):
        """Refuse numbers out of their range; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)

    @abc.abstractmethod
    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Value at a standard normal number; at 0 it is the median."""


class Normal(AbstractSpread):
    """A normal distribution.

    Attributes:
        mean: its mean.
        sd: its standard deviation.
    """

    ranges: ClassVar[Range] = Range(finite=("mean",), least=("sd",))
    mean: Parameter = parameter()
    sd: Parameter = parameter()

    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Mean + sd z."""
        return self.mean + self.sd * z


class LogNormal(AbstractSpread):
    """A positive number known up to a factor.

    Attributes:
        median: its median.
        log_sd: standard deviation of its natural logarithm; for small ones that of the number over
            itself.
    """

    ranges: ClassVar[Range] = Range(above=("median",), least=("log_sd",))
    median: Parameter = parameter()
    log_sd: Parameter = parameter()

    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Median exp(log_sd z)."""
        return self.median * jnp.exp(self.log_sd * z)


class Uniform(AbstractSpread):
    """Any number between two bounds.

    Attributes:
        low, high: the bounds.
    """

    ranges: ClassVar[Range] = Range(finite=("low", "high"))
    low: Parameter = parameter()
    high: Parameter = parameter()

    def __check_init__(self):
        """Refuse bounds that do not ascend; traced ones pass.

        Raises:
            ValueError: the upper bound is not above the lower one.
        """
        if not is_traced(self.low, self.high) and np.any(self.high <= self.low):
            raise ValueError(f"Uniform: high = {self.high} is not above low = {self.low}")

    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Low + (high − low) Φ(z)."""
        return self.low + (self.high - self.low) * norm.cdf(z)


class Uncertainty(eqx.Module):
    """A scalar with its error bar.

    Attributes:
        nominal: value where all inputs have their medians.
        slopes: change of the scalar by one standard deviation of each input, to first order.
        z: samples of the inputs as standard normal numbers, in the order of `slopes`.
        samples: values of the scalar there, those without one left out.
        n_failed: samples without a value.
    """

    nominal: float
    slopes: dict[str, float]
    z: Float[np.ndarray, "samples inputs"]
    samples: Float[np.ndarray, " samples"]
    n_failed: int

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
        """The interval if an input were known better and had its median, to first order.

        Args:
            name: of the input.
            factor: its standard deviation then over that now; 0: known exactly.
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
        return _bounds(self.samples - (1.0 - factor) * self.slopes[name] * z, level)


def uncertainty(
    scalar: Callable[[dict[str, Array]], Float[Array, ""]],
    inputs: Mapping[str, AbstractSpread],
    *,
    n_samples: int = 2**12,
    batch_size: int = BATCH,
    seed: int = 0,
) -> Uncertainty:
    """The uncertainty of a scalar.

    Args:
        scalar: gives it from a value of each input by name; jittable and differentiable, NaN where
            there is none.
        inputs: distribution of each input.
        n_samples: samples, rounded up to a power of two.
        batch_size: samples evaluated at once.
        seed: of the scrambling.

    Raises:
        ValueError: no input, or less than two samples.
        RuntimeError: the scalar has no value or derivative at the medians, or lacks one in more
            than `MOST_FAILED` of the samples.
    """
    if not inputs:
        raise ValueError("nothing is uncertain: give at least one input")
    if n_samples < 2:
        raise ValueError(f"n_samples = {n_samples!r}: at least 2 are needed")
    names, spreads = tuple(inputs), tuple(inputs.values())

    def of(z: Float[Array, " inputs"], spreads: Any) -> Float[Array, ""]:
        return scalar({n: s.value(v) for n, s, v in zip(names, spreads, z, strict=True)})

    middle = jnp.zeros(len(names))
    nominal, slopes = eqx.filter_jit(jax.value_and_grad(of))(middle, spreads)
    slopes = np.asarray(slopes)
    if not (np.isfinite(float(nominal)) and np.all(np.isfinite(slopes))):
        missing = [n for n, g in zip(names, slopes, strict=True) if not np.isfinite(g)]
        raise RuntimeError(
            f"the scalar is {float(nominal):g} where all inputs have their medians, with no"
            f" derivative by {', '.join(missing) or 'none'}. Check those inputs."
        )
    z = standard_normals(n_samples, len(names), seed)

    @eqx.filter_jit
    def evaluated(z: Float[Array, "samples inputs"], spreads: Any) -> Float[Array, " samples"]:
        return jax.lax.map(lambda row: of(row, spreads), z, batch_size=batch_size)

    values = np.asarray(evaluated(jnp.asarray(z), spreads))
    good = np.isfinite(values)
    n_failed = int(np.sum(~good))
    if n_failed > MOST_FAILED * len(values):
        raise RuntimeError(
            f"the scalar has no value in {n_failed} of {len(values)} samples. Narrow the inputs to"
            " what can be: see which samples fail with `standard_normals`."
        )
    by_name = dict(zip(names, slopes.tolist(), strict=True))
    return Uncertainty(float(nominal), by_name, z[good], values[good], n_failed)


def standard_normals(n: int, n_inputs: int, seed: int = 0) -> Float[np.ndarray, "samples inputs"]:
    """A scrambled Sobol sequence of standard normal numbers, as many as the next power of two."""
    sequence = qmc.Sobol(n_inputs, scramble=True, rng=np.random.default_rng(seed))
    uniform = sequence.random_base2(int(np.ceil(np.log2(n))))
    return ndtri(np.clip(uniform, _EDGE, 1.0 - _EDGE))


def _bounds(samples: Float[np.ndarray, " samples"], level: float) -> tuple[float, float]:
    if not 0.0 < level < 1.0:
        raise ValueError(f"level = {level!r} is not between 0 and 1")
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(samples, [tail, 1.0 - tail])
    return float(low), float(high)
