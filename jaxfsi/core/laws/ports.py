"""Where the domain meets the world: pressures, flows and boundary blocks at openings.

Q > 0 leaves the domain at every port. A traction −P n acts on the faces of a port, P being

| port | P |
|---|---|
| `PressurePort` | a waveform |
| `BlockPort` | the pressure of a block of `lumped` into which the port's flow enters |

and a `FlowPort` or a `VelocityPort` prescribes the velocity instead.
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform


class PressurePort(eqx.Module):
    """An opening, or any named surface, under a given pressure.

    Attributes:
        pressure: waveform of the pressure [dyn/cm²].
    """

    pressure: AbstractWaveform


class BlockPort(eqx.Module):
    """An opening into a boundary block.

    Attributes:
        block: the block; its port takes what leaves the domain.
    """

    block: AbstractElement


class FlowPort(eqx.Module):
    """An opening with a given flow and the profile of a fully developed one.

    The profile solves −∇²φ = 1 on the opening with φ = 0 on its rim: a paraboloid on a disc.

    Attributes:
        flow: waveform of the flow into the domain [cm³/s]. It counts inwards, as inflows are
            measured; the port's Q is its negative.
    """

    flow: AbstractWaveform


class AbstractVelocity(eqx.Module):
    """A velocity field that is known in space and time."""

    @abc.abstractmethod
    def __call__(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
        """Velocity [cm/s] at time t [s] and positions x [cm] of the undeformed mesh."""


class VelocityPort(eqx.Module):
    """A surface with a given velocity, such as a measured profile or an exact solution.

    It holds at all nodes of the surface, also at those that it shares with the wall.

    Attributes:
        velocity: the field of which the surface takes the values.
    """

    velocity: AbstractVelocity


OpenPort = PressurePort | BlockPort
"""Ports at which a pressure acts and the flow follows."""

HeldPort = FlowPort | VelocityPort
"""Ports at which the velocity is given and the pressure follows."""

Port = OpenPort | HeldPort
