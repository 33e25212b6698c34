"""A velocity that is known in space and time."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxfsi.core.ports.port import (
    AbstractVelocityPort,
    Field,
    PortState,
    PortSurface,
    mean_pressure,
)
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.mesh import Mesh
from lumped.parameters import Parameter


class AbstractVelocity(eqx.Module):
    """A velocity field that is known in space and time."""

    @abc.abstractmethod
    def __call__(self, t: Parameter, x: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
        """Velocity [cm/s] at time t [s] and positions x [cm] of the undeformed mesh."""


class VelocityPort(AbstractVelocityPort):
    """A surface with a given velocity, such as a measured profile or an exact solution.

    u = velocity(t, x) at all nodes of the surface, also at those that it shares with the wall. The
    surface stands still; without internal state.

    Attributes:
        velocity: the field of which the surface takes the values.
    """

    moves_surface: ClassVar[bool] = False
    velocity: AbstractVelocity

    def setup(
        self, mesh: Mesh, label: str, fixed: Bool[np.ndarray, " nodes"]
    ) -> Float[np.ndarray, "nodes 3"] | None:
        """None: the velocity is known."""
        return None

    def initial_state(self) -> Float[Array, " n"]:
        """None."""
        return jnp.zeros(0)

    def add_velocity(self, t: Parameter, u: Field, x: Field, surface: PortSurface) -> Field:
        """The field at the nodes of the surface, in place of what other ports prescribe there."""
        on_port = jnp.zeros(u.shape[1], bool).at[surface.faces].set(True)
        return jnp.where(on_port, self.velocity(t, x), u)

    def add_displacement(
        self,
        t: Parameter,
        dt: Parameter,
        d: Field | float,
        state: PortState,
        surface: PortSurface,
    ) -> Field | float:
        """Nothing: the surface stands still."""
        return d

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
        return {"kind": "velocity"}
