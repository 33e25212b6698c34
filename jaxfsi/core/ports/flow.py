"""A given flow with the profile of a fully developed one."""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse.linalg import splu

from jaxfsi.core.ports.port import (
    AbstractVelocityPort,
    Field,
    PortState,
    PortSurface,
    mean_pressure,
)
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.faces import triangle_edges
from jaxfsi.mesh import Mesh
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform


class FlowPort(AbstractVelocityPort):
    """An opening with a given flow and the profile of a fully developed one.

    φ solves −∇²φ = 1 on the opening and vanishes on its rim; on a disc of radius R it is the
    paraboloid (R² − r²)/4. The velocity is u = −flow(t) n φ/∫φ dA. The surface stands still;
    without internal state.

    Source: White 2006, Viscous Fluid Flow, section 3-3.

    Attributes:
        flow: waveform of the flow into the domain [cm³/s]. It counts inwards, as inflows are
            measured; the port's Q is its negative.
    """

    moves_surface: ClassVar[bool] = False
    flow: AbstractWaveform

    def setup(
        self, mesh: Mesh, label: str, fixed: Bool[np.ndarray, " nodes"]
    ) -> Float[np.ndarray, "nodes 3"] | None:
        """Velocity of a unit inflow [1/cm²].

        Raises:
            ValueError: the opening has no node inside its rim.
        """
        return unit_flow_profile(mesh, label)

    def initial_state(self) -> Float[Array, " n"]:
        """None."""
        return jnp.zeros(0)

    def add_velocity(self, t: Parameter, u: Field, x: Field, surface: PortSurface) -> Field:
        """The profile times the flow."""
        assert surface.profile is not None
        return u + self.flow(t) * surface.profile

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
        return {"kind": "flow"}


def unit_flow_profile(mesh: Mesh, opening: str) -> Float[np.ndarray, "nodes 3"]:
    """Velocity at all nodes of the mesh of a unit flow through an opening into the domain [1/cm²].

    Raises:
        ValueError: the opening has no node inside its rim.
    """
    faces = mesh.labelled(opening)
    corner = mesh.points[faces]
    area_vector = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2.0
    area = np.linalg.norm(area_vector, axis=1)
    # ∇N_a of a triangle is its opposite edge turned by a right angle, over twice the area: their
    # products need the edges alone.
    edge = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
    stiffness = np.einsum("fai,fbi->fab", edge, edge) / (4.0 * area)[:, None, None]
    n_nodes = len(mesh.points)
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    matrix = sp.csr_matrix((stiffness.ravel(), (rows, columns)), shape=(n_nodes, n_nodes))
    load = np.bincount(faces.ravel(), np.repeat(area / 3.0, 3), n_nodes)
    inside = np.setdiff1d(faces, _rim_nodes(faces))
    if not len(inside):
        raise ValueError(
            f"the opening {opening!r} has no node inside its rim, so that no flow can be"
            " prescribed; use a finer mesh"
        )
    phi = np.zeros(n_nodes)
    phi[inside] = splu(matrix[inside][:, inside].tocsc()).solve(load[inside])
    normal = np.sum(area_vector, axis=0)
    normal /= np.linalg.norm(normal)
    flow = np.sum(np.mean(phi[faces], axis=1) * (area_vector @ normal))
    return -np.outer(phi, normal) / flow


def _rim_nodes(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, " rim"]:
    edges = np.sort(triangle_edges(faces).reshape(-1, 2), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    return np.unique(distinct[count == 1])
