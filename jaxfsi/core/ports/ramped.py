"""A port whose pressure can be given in place of its own condition, without another program."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

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
from lumped.waveforms import Ramp


class RampedPort(AbstractTractionPort):
    """A traction boundary that can be put under a pressure which changes linearly.

    ::

        P = pressure(t + α_f Δt), Z = 0    where `ramped`, as `PressurePort` has it
        P and Z of `port`                  else

    `ramped` is a number and not a choice of class: a step compiled for one of the two serves the
    other too. While it is true the internal state of `port` stays as it is.

    Attributes:
        port: the condition itself.
        pressure: the pressure in its place [dyn/cm²].
        ramped: whether that pressure is applied.
    """

    depends_on_flow: ClassVar[bool] = True
    port: AbstractTractionPort
    pressure: Ramp
    ramped: Bool[Array, ""]

    def initial_state(self) -> Float[Array, " n"]:
        """That of `port`."""
        return self.port.initial_state()

    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """That of `port`."""
        return self.port.reference_pressure(t)

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
        """The pressure at t + α_f Δt, whatever the flow; else that of `port`."""
        own = self.port.linearise(t, dt, state, u, x, surface, method)
        P = self.pressure(t + method.alpha_f * dt)
        return Traction(jnp.where(self.ramped, P, own.P_offset), jnp.where(self.ramped, 0.0, own.Z))

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
        """Mean pressure and flow, and the state as it was; else that of `port`."""
        given = PortState(state.x, mean_pressure(p, x, surface.faces), Q)
        own = self.port.end_step(t, dt, state, Q, p, x, surface, method)
        return jax.tree.map(lambda a, b: jnp.where(self.ramped, a, b), given, own)

    def summary(self) -> dict[str, Any]:
        """That of `port`; while ramped, that of a given pressure."""
        return {"kind": "pressure"} if bool(self.ramped) else self.port.summary()
