"""A given pressure."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.ports.port import (
    AbstractTractionPort,
    Field,
    PortState,
    PortSurface,
    Traction,
    mean_pressure,
)
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform


class PressurePort(AbstractTractionPort):
    """An opening, or any named surface, under a given pressure.

    P = pressure(t + α_f Δt) and Z = 0; without internal state. The pressure it reports is the mean
    of the blood's over the surface.

    Attributes:
        pressure: waveform of the pressure [dyn/cm²].
    """

    depends_on_flow: ClassVar[bool] = False
    pressure: AbstractWaveform

    def initial_state(self) -> Float[Array, " n"]:
        """None."""
        return jnp.zeros(0)

    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """None."""
        return jnp.zeros(0)

    def linearise(
        self,
        t: Parameter,
        dt: Parameter,
        state: PortState,
        u: Field,
        x: Field,
        surface: PortSurface,
        method: GeneralizedAlpha,
    ) -> Traction:
        """The pressure at t + α_f Δt, whatever the flow."""
        return Traction(self.pressure(t + method.alpha_f * dt), 0.0)

    def end_step(
        self,
        t: Parameter,
        dt: Parameter,
        state: PortState,
        Q: Float[Array, ""],
        p: Float[Array, " nodes"],
        x: Field,
        surface: PortSurface,
        method: GeneralizedAlpha,
    ) -> PortState:
        """Mean pressure and flow."""
        return PortState(state.x, mean_pressure(p, x, surface.faces), Q)

    def summary(self) -> dict[str, Any]:
        """Kind alone."""
        return {"kind": "pressure"}
