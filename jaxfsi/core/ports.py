"""Where the domain meets the world: pressures, flows and boundary blocks at openings.

Q > 0 leaves the domain at every port. A traction −P n acts on the faces of a port, P being

| port | P |
|---|---|
| `PressurePort` | a waveform |
| `BlockPort` | the pressure of a block of `lumped` into which the port's flow enters |

and a `FlowPort` prescribes the velocity instead.
"""

import equinox as eqx

from lumped.elements import AbstractElement
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


Port = PressurePort | BlockPort | FlowPort
