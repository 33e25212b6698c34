"""A resistance and an inertance in series behind an opening."""

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
from lumped.parameters import Parameter, Range, check_range, parameter


class ResistanceInertancePort(AbstractTractionPort):
    """An opening into a rigid tube full of blood, such as a catheter or a long graft.

    ::

        P = P_ref + R Q + L dQ/dt

    The internal state is the rate of the flow dQ/dt [cm³/s²]. It follows the flow as the blood's
    acceleration follows its velocity, and is taken at t + α_m Δt where R Q is at t + α_f Δt, so
    that the port is of the second order of generalised-α::

        (dQ/dt)⁺ = (Q⁺ − Q)/(γ Δt) − (1 − γ)/γ dQ/dt,    Z = α_f R + α_m L/(γ Δt)

    The pressure it reports is the mean of the blood's over the surface.

    Source: Jansen, Whiting & Hulbert 2000, eqs. 13-24, for the method in time.

    Attributes:
        R: resistance [dyn·s/cm⁵].
        L: inertance [dyn·s²/cm⁵].
        P_ref: pressure at the far end [dyn/cm²].
    """

    depends_on_flow: ClassVar[bool] = True
    ranges: ClassVar[Range] = Range(least=("R", "L"), finite=("P_ref",))
    R: Parameter = parameter()
    L: Parameter = parameter()
    P_ref: Parameter = parameter(default=0.0)

    def __check_init__(self):
        """Refuse negative numbers; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)

    def initial_state(self) -> Float[Array, " n"]:
        """A steady flow."""
        return jnp.zeros(1)

    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Zero: the state is no pressure."""
        return jnp.zeros(1)

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
        """Exact: the pressure is linear in the new flow."""
        alpha, beta = method.alpha_f, method.alpha_m
        at_rest = self._rate(dt, state, jnp.zeros(()), method)
        rate = (1.0 - beta) * state.x[0] + beta * at_rest
        P = self.P_ref + self.R * (1.0 - alpha) * state.Q + self.L * rate
        return Traction(P, alpha * self.R + beta * self.L / (method.gamma * dt))

    def _rate(
        self, dt: Parameter, state: PortState, Q: Float[Array, ""], method: GeneralizedAlpha
    ) -> Float[Array, ""]:
        """Rate of the flow at the end of a step [cm³/s²]."""
        gamma = method.gamma
        return (Q - state.Q) / (gamma * dt) - (1.0 - gamma) / gamma * state.x[0]

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
        """Rate of the flow, mean pressure and flow."""
        rate = self._rate(dt, state, Q, method)
        return PortState(rate[None], mean_pressure(p, x, surface.faces), Q)

    def summary(self) -> dict[str, Any]:
        """Kind and numbers."""
        numbers = {name: float(getattr(self, name)) for name in ("R", "L", "P_ref")}
        return {"kind": "resistance and inertance", **numbers}
