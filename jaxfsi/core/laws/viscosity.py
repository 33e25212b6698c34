"""Viscosity of blood as a function of the shear rate.

| law | μ(γ) | source |
|---|---|---|
| Newtonian | μ | |
| Carreau-Yasuda | μ∞ + (μ₀ − μ∞)(1 + (λγ)^a)^((n−1)/a) | Yasuda 1979; Cho & Kensey 1991 |

γ = √(2 ε:ε), ε the symmetric velocity gradient.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.parameters import Parameter, parameter


class AbstractViscosity(eqx.Module):
    """A viscosity law."""

    @abc.abstractmethod
    def __call__(self, shear_rate: Float[Array, " n"]) -> Float[Array, " n"]:
        """Viscosity [g/(cm·s)] at shear rates [1/s]."""


class Newtonian(AbstractViscosity):
    """A viscosity that is the same at every shear rate.

    Attributes:
        mu: viscosity [g/(cm·s)].
    """

    mu: Parameter = parameter(default=0.04)

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

    mu_zero: Parameter = parameter(default=0.56)
    mu_infinite: Parameter = parameter(default=0.0345)
    relaxation_time: Parameter = parameter(default=1.902)
    exponent: Parameter = parameter(default=0.22)
    transition: Parameter = parameter(default=1.25)

    def __call__(self, shear_rate: Float[Array, " n"]) -> Float[Array, " n"]:
        """Viscosity [g/(cm·s)] at shear rates [1/s]."""
        scaled = jnp.maximum(self.relaxation_time * shear_rate, 1e-12) ** self.transition
        power = (self.exponent - 1.0) / self.transition
        return self.mu_infinite + (self.mu_zero - self.mu_infinite) * (1.0 + scaled) ** power
