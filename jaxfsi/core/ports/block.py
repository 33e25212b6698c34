"""A boundary block of `lumped` behind an opening."""

import dataclasses
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.port import (
    AbstractTractionPort,
    Field,
    PortState,
    PortSurface,
    Traction,
)
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from lumped.elements import AbstractElement
from lumped.parameters import Parameter
from lumped.views import advance, driven, implicit_step
from lumped.waveforms import Constant


class BlockPort(AbstractTractionPort):
    """An opening into a boundary block, such as a Windkessel or a coronary bed.

    The block's implicit step gives P(t + Δt) = Z′ Q(t + Δt) + b, of second order, so that at
    t + α_f Δt::

        P = P(t) + α_f (b − P(t)) + α_f Z′ Q(t + Δt)

    Nonlinear blocks are linearised at the extrapolated flow, and advanced with the flow found.
    The internal state is that of the block.

    Attributes:
        block: the block; its port takes what leaves the domain.
    """

    depends_on_flow: ClassVar[bool] = True
    block: AbstractElement

    def initial_state(self) -> Float[Array, " n"]:
        """States of the block, zero."""
        return jnp.zeros(driven(self.block, Constant(0.0)).n_states)

    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Pressure outside the wall of each state of the block."""
        return self.block.external_pressure(t)

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
        """The implicit step of the block at t + α_f Δt."""
        Q_guess = flux(u, x, surface.faces)
        Z, offset = implicit_step(t, dt, state.x, self.block, state.Q, Q_guess)
        return Traction(state.P + method.alpha_f * (offset - state.P), method.alpha_f * Z)

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
        """The block advanced with the flow found, and its pressure."""
        after = advance(t, dt, state.x, self.block, state.Q, Q)
        return PortState(after.x, after.P, Q)

    def summary(self) -> dict[str, Any]:
        """The block's class and numbers."""
        block = self.block
        values = {f.name: getattr(block, f.name) for f in dataclasses.fields(block)}
        numbers = {name: float(v) for name, v in values.items() if isinstance(v, jax.Array)}
        return {"kind": type(block).__name__, **numbers}
