"""Interface of the elements of a 0D network: small differential-algebraic systems with ports.

An element with states x, port pressures P and port flows Q (positive *into* the element) obeys

    M ẋ = f(t, x, P, Q)        (one row a state; M is diagonal: capacitances and inertances)
    0   = g(t, x, P, Q)        (one row a port)

From this one definition follow the diffrax vector field, the implicit step of a 3D coupling, the
transfer impedance and the direct-current network (`lumped.views`); a chamber or a valve would be
one more class with these methods.
"""

import abc
from typing import TYPE_CHECKING

import equinox as eqx
from jaxtyping import Array, Float

from lumped.parameters import Parameter

if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar


class AbstractElement(eqx.Module):
    """One element of a network. States are transmural pressures or flows."""

    n_ports: AbstractClassVar[int]

    @property
    @abc.abstractmethod
    def state_names(self) -> tuple[str, ...]:
        """Names of the internal states, in order."""

    @property
    @abc.abstractmethod
    def is_linear(self) -> bool:
        """Whether f and g are affine in (x, P, Q) and in the element's waveforms together."""

    @abc.abstractmethod
    def mass(self) -> Float[Array, " n"]:
        """The diagonal of M: capacitances [cm⁵/dyn] and inertances [dyn·s²/cm⁵]."""

    @abc.abstractmethod
    def rate(
        self, t: Parameter, x: Float[Array, " n"], P: Float[Array, " p"], Q: Float[Array, " p"]
    ) -> Float[Array, " n"]:
        """The right-hand side f of M ẋ = f(t, x, P, Q)."""

    @abc.abstractmethod
    def closure(
        self, t: Parameter, x: Float[Array, " n"], P: Float[Array, " p"], Q: Float[Array, " p"]
    ) -> Float[Array, " p"]:
        """The algebraic residual g(t, x, P, Q), one row a port."""

    @abc.abstractmethod
    def external_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Pressure outside each state's wall [dyn/cm²]: state + this = pressure; 0 for flows."""
