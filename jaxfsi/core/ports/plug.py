"""A plug that slides in an opening, such as the piston of a flow phantom."""

from typing import Any, ClassVar

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
from lumped.waveforms import AbstractWaveform


class PlugPort(AbstractVelocityPort):
    """A plane opening closed by a plug that moves along its normal and takes the mesh with it.

    With the inward normal −n, the velocity and the position of the plug are::

        u = −V(t) n,    d_mesh = −s n,    ds/dt = V

    No blood crosses the surface: it moves with it. The plug seals: it sweeps the volume V A, so
    that the port's flow is Q = −V A with the area A of the opening. On the rim the wall decides:

    - Where the wall is free there, the rim belongs to the plug, and u is uniform.
    - Where the wall is clamped or rigid, the rim keeps its place (no slip), and the velocity falls
      to zero over the outermost ring of faces. The rest of the plug is faster by the area over
      that of the part that moves, A/∫φ dA, a factor that tends to 1 on finer meshes.

    The internal state is the position s [cm], by the trapezoidal rule. Next to a rim that keeps its
    place the plug can travel less than one element; the march ends with ``inverted`` beyond that.

    Attributes:
        velocity: waveform of V, into the domain [cm/s].
    """

    moves_surface: ClassVar[bool] = True
    velocity: AbstractWaveform

    def setup(
        self, mesh: Mesh, label: str, fixed: Bool[np.ndarray, " nodes"]
    ) -> Float[np.ndarray, "nodes 3"] | None:
        """Velocity of the nodes for V = 1.

        Raises:
            ValueError: all nodes of the opening are held by the wall.
        """
        faces = mesh.labelled(label)
        moves = np.zeros(len(mesh.points))
        moves[faces] = 1.0
        moves[fixed] = 0.0
        corner = mesh.points[faces]
        area_vector = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2.0
        normal = np.sum(area_vector, axis=0)
        normal /= np.linalg.norm(normal)
        area = area_vector @ normal
        swept = np.sum(area * np.mean(moves[faces], axis=1))
        if not swept > 0.0:
            raise ValueError(
                f"the opening {label!r} has no node that a plug could move: the wall holds all of"
                " its rim; use a finer mesh"
            )
        return -np.sum(area) / swept * np.outer(moves, normal)

    def initial_state(self) -> Float[Array, " n"]:
        """In the place of the undeformed mesh."""
        return jnp.zeros(1)

    def add_velocity(self, t: Parameter, u: Field, x: Field, surface: PortSurface) -> Field:
        """The profile times the velocity."""
        assert surface.profile is not None
        return u + self.velocity(t) * surface.profile

    def add_displacement(
        self,
        t: Parameter,
        dt: Parameter,
        d: Field | float,
        state: PortState,
        surface: PortSurface,
    ) -> Field | float:
        """The profile times the position."""
        assert surface.profile is not None
        return d + self._position(t, dt, state) * surface.profile

    def _position(self, t: Parameter, dt: Parameter, state: PortState) -> Float[Array, ""]:
        """Position at t + dt [cm]."""
        return state.x[0] + 0.5 * dt * (self.velocity(t) + self.velocity(t + dt))

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
        """Position, mean pressure and flow."""
        position = self._position(t, dt, state)
        return PortState(position[None], mean_pressure(p, x, surface.faces), Q)

    def summary(self) -> dict[str, Any]:
        """Kind alone."""
        return {"kind": "plug"}
