"""Distributions of uncertain numbers, as increasing functions of a standard normal number."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm
from jaxtyping import Array, Float

from lumped.parameters import Parameter, Range, check_range, is_traced, parameter

EDGE = 1e-12
"""Least distance of a uniform number from 0 and 1."""

_TAIL = 1.6448536269514722
"""Standard normal number that 5 of 100 exceed."""


class AbstractSpread(eqx.Module):
    """Distribution of an input, as an increasing function of a standard normal number."""

    ranges: ClassVar[Range]

    def __check_init__(self):
        """Refuse numbers out of their range, and bounds that do not ascend; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range, or the upper bound of a distribution
                that has bounds is not above the lower one.
        """
        check_range(self)
        if not isinstance(self, Uniform | Truncated) or is_traced(self.low, self.high):
            return
        if np.any(self.high <= self.low):
            raise ValueError(
                f"{type(self).__name__}: high = {self.high} is not above low = {self.low}"
            )

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

    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Low + (high − low) Φ(z)."""
        return self.low + (self.high - self.low) * norm.cdf(z)


class Truncated(AbstractSpread):
    """A normal distribution between two bounds, what lies outside cut off.

    Attributes:
        mean: of the whole distribution.
        sd: likewise.
        low, high: the bounds.
    """

    ranges: ClassVar[Range] = Range(finite=("mean", "low", "high"), above=("sd",))
    mean: Parameter = parameter()
    sd: Parameter = parameter()
    low: Parameter = parameter()
    high: Parameter = parameter()

    def value(self, z: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Mean + sd Φ⁻¹(Φ(a) + Φ(z) (Φ(b) − Φ(a))) with the bounds a, b in standard deviations."""
        a, b = (norm.cdf((bound - self.mean) / self.sd) for bound in (self.low, self.high))
        inside = norm.ppf(jnp.clip(a + norm.cdf(z) * (b - a), EDGE, 1.0 - EDGE))
        return jnp.clip(self.mean + self.sd * inside, self.low, self.high)


def central_range(spread: AbstractSpread) -> tuple[float, float, float]:
    """Median of a number, and the bounds that 5 of 100 lie below and above.

    Args:
        spread: its distribution.
    """
    median, low, high = (float(spread.value(jnp.asarray(z))) for z in (0.0, -_TAIL, _TAIL))
    return median, low, high
