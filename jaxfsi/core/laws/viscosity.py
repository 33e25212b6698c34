"""Viscosity of blood as a function of the shear rate.

| law | μ(γ) | source |
|---|---|---|
| Newtonian | μ | |
| Carreau-Yasuda | μ∞ + (μ₀ − μ∞)(1 + (λγ)^a)^((n−1)/a) | Yasuda 1979; Cho & Kensey 1991 |

γ = √(2 ε:ε), ε the symmetric velocity gradient.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.nominal import BLOOD_VISCOSITY, CHO_KENSEY
from lumped.parameters import Parameter, Range, check_range, parameter


class AbstractViscosity(eqx.Module):
    """A viscosity law; its parameters lie in `ranges`."""

    ranges: ClassVar[Range] = Range()

    def __check_init__(self):
        """Refuse numbers out of their range; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)

    @abc.abstractmethod
    def __call__(self, shear_rate: Float[Array, " n"]) -> Float[Array, " n"]:
        """Viscosity [g/(cm·s)] at shear rates [1/s]."""


class Newtonian(AbstractViscosity):
    """A viscosity that is the same at every shear rate.

    Attributes:
        mu: viscosity [g/(cm·s)].
    """

    ranges: ClassVar[Range] = Range(least=("mu",))
    mu: Parameter = parameter(default=BLOOD_VISCOSITY)

    def __call__(self, shear_rate: Float[Array, " n"]) -> Float[Array, " n"]:
        """Viscosity [g/(cm·s)] at shear rates [1/s]."""
        return jnp.broadcast_to(self.mu, shear_rate.shape)


class CarreauYasuda(AbstractViscosity):
    """Shear-thinning blood; the defaults are those of Cho & Kensey 1991.

    Attributes:
        mu_zero: viscosity at rest [g/(cm·s)].
        mu_infinite: viscosity at a high shear rate [g/(cm·s)].
        relaxation_time: λ [s].
        exponent: n.
        transition: a.
    """

    ranges: ClassVar[Range] = Range(
        above=("mu_zero", "transition"),
        least=("mu_infinite", "relaxation_time"),
        finite=("exponent",),
    )
    mu_zero: Parameter = parameter(default=CHO_KENSEY["mu_zero"])
    mu_infinite: Parameter = parameter(default=CHO_KENSEY["mu_infinite"])
    relaxation_time: Parameter = parameter(default=CHO_KENSEY["relaxation_time"])
    exponent: Parameter = parameter(default=CHO_KENSEY["exponent"])
    transition: Parameter = parameter(default=CHO_KENSEY["transition"])

    def __call__(self, shear_rate: Float[Array, " n"]) -> Float[Array, " n"]:
        """Viscosity [g/(cm·s)] at shear rates [1/s]."""
        scaled = jnp.maximum(self.relaxation_time * shear_rate, 1e-12) ** self.transition
        power = (self.exponent - 1.0) / self.transition
        return self.mu_infinite + (self.mu_zero - self.mu_infinite) * (1.0 + scaled) ** power
