"""Sources: elements that prescribe the pressure or the flow of their node."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform


class PressureSource(AbstractElement):
    """Prescribes the pressure of its node.

    Circuit: an ideal pressure source between the node and ground.

    Equation: P = waveform(t).

    Parameters: those of the waveform.

    Input file (svZeroDSolver): ``{"bc_type": "PRESSURE", "bc_values": {"t": [...], "P": [...]}}``

    Attributes:
        waveform: pressure [dyn/cm²] as a function of time.
    """

    n_ports: ClassVar[int] = 1
    waveform: AbstractWaveform

    @property
    def state_names(self) -> tuple[str, ...]:
        """Empty: a source has no states."""
        return ()

    @property
    def is_linear(self) -> bool:
        """True: the equation is linear."""
        return True

    def mass(self) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)

    def rate(
        self, t: Parameter, x: Float[Array, " 0"], P: Float[Array, " 1"], Q: Float[Array, " 1"]
    ) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)

    def closure(
        self, t: Parameter, x: Float[Array, " 0"], P: Float[Array, " 1"], Q: Float[Array, " 1"]
    ) -> Float[Array, " 1"]:
        """P − waveform(t)."""
        return P - self.waveform(t)

    def external_pressure(self, t: Parameter) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)


class FlowSource(AbstractElement):
    """Prescribes the flow that enters the network at its node.

    Circuit: an ideal flow source from ground into the node.

    Equation: Q = −waveform(t), Q being the flow *into* the source.

    Parameters: those of the waveform.

    Input file (svZeroDSolver): ``{"bc_type": "FLOW", "bc_values": {"t": [...], "Q": [...]}}``

    Attributes:
        waveform: flow into the network [cm³/s] as a function of time.
    """

    n_ports: ClassVar[int] = 1
    waveform: AbstractWaveform

    @property
    def state_names(self) -> tuple[str, ...]:
        """Empty: a source has no states."""
        return ()

    @property
    def is_linear(self) -> bool:
        """True: the equation is linear."""
        return True

    def mass(self) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)

    def rate(
        self, t: Parameter, x: Float[Array, " 0"], P: Float[Array, " 1"], Q: Float[Array, " 1"]
    ) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)

    def closure(
        self, t: Parameter, x: Float[Array, " 0"], P: Float[Array, " 1"], Q: Float[Array, " 1"]
    ) -> Float[Array, " 1"]:
        """Q + waveform(t)."""
        return Q + self.waveform(t)

    def external_pressure(self, t: Parameter) -> Float[Array, " 0"]:
        """Empty."""
        return jnp.zeros(0)
