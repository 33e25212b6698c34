"""Derivatives against central differences, parameter by parameter or along one direction.

A difference (f(x + δ) − f(x − δ))/(2δ) is wrong by the third derivative times δ²/6 and by the
noise of f over δ: with δ a thousandth of the parameter, f has to be solved to about 1e-10.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lumped.parameters import Parameter


class Comparison(NamedTuple):
    """A derivative and its central difference.

    Attributes:
        derivative: by differentiation.
        difference: by differences.
    """

    derivative: float
    difference: float

    @property
    def error(self) -> float:
        """Relative difference of the two."""
        return abs(self.derivative - self.difference) / abs(self.difference)


def steps_of(
    parameters: tuple[Parameter, ...], *, share: float = 1e-3, least: float = 1e-4
) -> np.ndarray:
    """Step of each parameter: a share of it, or `least` where it is zero."""
    values = np.asarray([float(value) for value in parameters])
    return np.where(values == 0.0, least, share * np.abs(values))


def compare_each(
    function: Callable[..., Float[Array, ""]],
    gradient: tuple[Parameter, ...],
    parameters: tuple[Parameter, ...],
) -> list[Comparison]:
    """Compare a gradient with central differences of a function of a named tuple of numbers."""
    kind, values = type(parameters), np.asarray([float(value) for value in parameters])
    result = []
    for i, step in enumerate(steps_of(parameters)):
        shift = np.zeros(len(values))
        shift[i] = step
        difference = _difference(function, kind, values, shift) / (2.0 * step)
        result.append(Comparison(float(gradient[i]), difference))
    return result


def compare_along(
    function: Callable[..., Float[Array, ""]],
    gradient: tuple[Parameter, ...],
    parameters: tuple[Parameter, ...],
    direction: np.ndarray,
) -> Comparison:
    """Compare the slope along a direction, given in steps of each parameter (see `steps_of`)."""
    kind, values = type(parameters), np.asarray([float(value) for value in parameters])
    shift = steps_of(parameters) * direction
    slope = float(np.dot(np.asarray([float(g) for g in gradient]), shift))
    return Comparison(slope, _difference(function, kind, values, shift) / 2.0)


def _difference(function, kind, values: np.ndarray, shift: np.ndarray) -> float:
    after, before = (
        float(function(kind(*(jnp.asarray(v) for v in values + sign * shift))))
        for sign in (1.0, -1.0)
    )
    return after - before
