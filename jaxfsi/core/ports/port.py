"""What a boundary condition of the 3D domain is: one object that knows its mask, load and tangent.

Q > 0 leaves the domain at every port. There are two families:

- A **traction boundary** (`AbstractTractionPort`) applies, with P at the time t + α_f Δt::

      −P n + ½ β ρ_f (c·n)₋ u,    P = P_offset + Z Q,    (c·n)₋ = min(c·n, 0)

  The second term stabilises backflow (Esmaily Moghadam et al. 2011): it takes out the share β of
  the kinetic energy that inflow brings in. A port gives P_offset and Z once a step.
- A **velocity boundary** (`AbstractVelocityPort`) prescribes the velocity of its nodes, and may
  move its surface; the pressure follows.

The assembler of a step calls these methods and never asks which port it holds. A new port is one
class in a file of its own and one line in ``tests/jaxfsi/core/ports/test_ports.py``.
"""

import abc
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.linear import area_vectors, face_load, flux
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.mesh import Mesh
from lumped.parameters import Parameter

if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar

BACKFLOW = 0.2
"""Share β of the kinetic energy that backflow stabilisation takes out."""

Field = Float[Array, "3 nodes"]


class PortSurface(NamedTuple):
    """The surface of a port.

    Attributes:
        faces: its triangles, pointing out of the domain.
        edges: unknowns of the mid-edge modes opposite to their corners; None where there are none.
        profile: field that the port made from the mesh, see `AbstractPort.setup`; None: none.
    """

    faces: Int[Array, "3 faces"]
    edges: Int[Array, "3 faces"] | None
    profile: Field | None


class PortState(NamedTuple):
    """A port between two steps.

    Attributes:
        x: internal state, such as that of a boundary block.
        P: pressure [dyn/cm²].
        Q: flow out of the domain [cm³/s].
    """

    x: Float[Array, " n"]
    P: Float[Array, ""]
    Q: Float[Array, ""]


class Traction(NamedTuple):
    """Pressure of a port during a step, at t + α_f Δt: P = P_offset + Z Q with the new flow Q.

    Attributes:
        P_offset: pressure without the new flow [dyn/cm²].
        Z: its derivative with respect to the new flow [dyn·s/cm⁵].
    """

    P_offset: Parameter
    Z: Parameter


class PortMotion(NamedTuple):
    """Fields on which a traction depends, at t + α_f Δt.

    Attributes:
        u: velocity [cm/s].
        c: advecting velocity, relative to the mesh [cm/s].
        x: node positions [cm].
        rho_f: density of the blood [g/cm³].
    """

    u: Field
    c: Field
    x: Field
    rho_f: Parameter


class AbstractPort(eqx.Module):
    """A boundary condition on a labelled surface of the mesh.

    Parameters are array leaves and are differentiated. Methods that start with ``add`` return the
    field that they are given with the port's own part.
    """

    prescribes_velocity: AbstractClassVar[bool]
    """Whether the velocity of all nodes of the surface is prescribed."""

    moves_surface: AbstractClassVar[bool]
    """Whether the port moves the mesh at its surface; see `add_displacement`."""

    @abc.abstractmethod
    def setup(
        self, mesh: Mesh, label: str, fixed: Bool[np.ndarray, " nodes"]
    ) -> Float[np.ndarray, "nodes 3"] | None:
        """A field that the port needs, from the mesh; None: none.

        Args:
            mesh: the mesh.
            label: name of the surface.
            fixed: nodes whose velocity the wall prescribes: clamped, or on a rigid wall.

        Raises:
            ValueError: the surface does not suit the port.
        """

    @abc.abstractmethod
    def initial_state(self) -> Float[Array, " n"]:
        """Internal state at rest; its shape is that of all later ones."""

    @abc.abstractmethod
    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Pressure from which each internal state counts at time t [dyn/cm²]; 0 for other states.

        State + this is continuous where a run goes on with another port of the same kind.
        """

    @abc.abstractmethod
    def add_velocity(self, t: Parameter, u: Field, x: Field, surface: PortSurface) -> Field:
        """Prescribe the velocity at time t [cm/s].

        Args:
            t: time [s].
            u: prescribed velocities of the ports before this one, 0 elsewhere [cm/s].
            x: reference positions of the nodes [cm].
            surface: the surface.
        """

    @abc.abstractmethod
    def add_displacement(
        self,
        t: Parameter,
        dt: Parameter,
        d: Field | float,
        state: PortState,
        surface: PortSurface,
    ) -> Field | float:
        """Displacement of the surface at the end of a step from t to t + dt [cm].

        Args:
            t: time at the start [s].
            dt: length of the step [s].
            d: displacements of the ports before this one, 0 elsewhere [cm].
            state: the port at t.
            surface: the surface.
        """

    @abc.abstractmethod
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
        """Pressure as a function of the new flow, at the start of a step from t to t + dt.

        Args:
            t: time at the start [s].
            dt: length of the step [s].
            state: the port at t.
            u: extrapolated velocity at t + dt, at which to linearise [cm/s].
            x: node positions at t + α_f dt [cm].
            surface: the surface.
            method: coefficients in time.
        """

    @abc.abstractmethod
    def add_load(
        self, load: Field, P: Float[Array, ""], motion: PortMotion, surface: PortSurface
    ) -> Field:
        """Add the forces of the port on the nodes [dyn].

        Args:
            load: forces so far [dyn].
            P: P_offset + Z Q, less the ambient pressure [dyn/cm²].
            motion: see `PortMotion`.
            surface: the surface.
        """

    @abc.abstractmethod
    def add_load_tangent(
        self,
        load: Field,
        Z: Float[Array, ""],
        weight: Parameter,
        motion: PortMotion,
        surface: PortSurface,
    ) -> Field:
        """Add the derivative of `add_load` along a change of the new velocity [dyn].

        The advecting velocity is lagged, as in the equations of the blood.

        Args:
            load: changes so far [dyn].
            Z: see `Traction`.
            weight: derivative of the velocity at t + α_f dt by the new one.
            motion: as in `add_load`, but for u, which is the change [cm/s].
            surface: the surface.
        """

    @abc.abstractmethod
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
        """The port at the end of a step from t to t + dt.

        Args:
            t: time at the start [s].
            dt: length of the step [s].
            state: the port at t.
            Q: flow at t + dt [cm³/s].
            p: pressure of the blood at t + dt [dyn/cm²].
            x: node positions at t + α_f dt [cm].
            surface: the surface.
            method: coefficients in time.
        """

    @abc.abstractmethod
    def summary(self) -> dict[str, Any]:
        """``kind``, and the numbers by name, for reports."""


class AbstractTractionPort(AbstractPort):
    """A port that applies a pressure; the flow follows. See the module for the equation."""

    prescribes_velocity: ClassVar[bool] = False
    moves_surface: ClassVar[bool] = False

    depends_on_flow: AbstractClassVar[bool]
    """Whether Z is not always zero."""

    def setup(
        self, mesh: Mesh, label: str, fixed: Bool[np.ndarray, " nodes"]
    ) -> Float[np.ndarray, "nodes 3"] | None:
        """None: nothing is needed."""
        return None

    def add_velocity(self, t: Parameter, u: Field, x: Field, surface: PortSurface) -> Field:
        """Nothing: no velocity is prescribed."""
        return u

    def add_displacement(
        self,
        t: Parameter,
        dt: Parameter,
        d: Field | float,
        state: PortState,
        surface: PortSurface,
    ) -> Field | float:
        """Nothing: the surface moves with the wall alone."""
        return d

    def add_load(
        self, load: Field, P: Float[Array, ""], motion: PortMotion, surface: PortSurface
    ) -> Field:
        """Add −∫ P N_a n dA and the backflow stabilisation."""
        faces, n_nodes = surface.faces, load.shape[1]
        area = area_vectors(motion.x, faces)
        backflow = _backflow(area, motion, faces) * jnp.mean(motion.u[:, faces], axis=1)
        load = load + face_load(backflow - P * area, faces, n_nodes)
        if surface.edges is not None:  # ∫ 4 N_a N_b over a triangle is a third of its area too
            load = load - face_load(P * area, surface.edges, n_nodes)
        return load

    def add_load_tangent(
        self,
        load: Field,
        Z: Float[Array, ""],
        weight: Parameter,
        motion: PortMotion,
        surface: PortSurface,
    ) -> Field:
        """Add −Z δQ ∫ N_a n dA and the change of the backflow stabilisation."""
        faces, n_nodes = surface.faces, load.shape[1]
        area = area_vectors(motion.x, faces)
        change = weight * _backflow(area, motion, faces) * jnp.mean(motion.u[:, faces], axis=1)
        if not self.depends_on_flow:
            return load + face_load(change, faces, n_nodes)
        P = Z * flux(motion.u, motion.x, faces)
        load = load + face_load(change - P * area, faces, n_nodes)
        if surface.edges is not None:
            load = load - face_load(P * area, surface.edges, n_nodes)
        return load


class AbstractVelocityPort(AbstractPort):
    """A port that prescribes the velocity of all nodes of its surface; the pressure follows."""

    prescribes_velocity: ClassVar[bool] = True

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
        """No pressure."""
        return Traction(0.0, 0.0)

    def reference_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Zero: no state is a pressure."""
        return jnp.zeros_like(self.initial_state())

    def add_load(
        self, load: Field, P: Float[Array, ""], motion: PortMotion, surface: PortSurface
    ) -> Field:
        """Nothing: no traction."""
        return load

    def add_load_tangent(
        self,
        load: Field,
        Z: Float[Array, ""],
        weight: Parameter,
        motion: PortMotion,
        surface: PortSurface,
    ) -> Field:
        """Nothing: no traction."""
        return load


def _backflow(
    area: Float[Array, "3 faces"], motion: PortMotion, faces: Int[Array, "3 faces"]
) -> Float[Array, " faces"]:
    """½ β ρ_f ∫ (c·n)₋ dA of each triangle [g/s]."""
    c = jnp.mean(motion.c[:, faces], axis=1)
    inflow = jnp.minimum(jnp.sum(c * area, axis=0), 0.0)
    return 0.5 * BACKFLOW * motion.rho_f * inflow


def mean_pressure(
    p: Float[Array, " nodes"], x: Field, faces: Int[Array, "3 faces"]
) -> Float[Array, ""]:
    """Mean of a pressure over triangles [dyn/cm²]."""
    area = jnp.sqrt(jnp.sum(area_vectors(x, faces) ** 2, axis=0))
    return jnp.sum(jnp.mean(p[faces], axis=0) * area) / jnp.sum(area)
