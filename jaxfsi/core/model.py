"""A model: mesh, materials, ports and supports as arrays that the step in time works on.

Rigid-wall flow, a wall alone and both coupled are one model with different regions: without solid
elements the interface stands still, without fluid elements there is no pressure. Fluid and solid
share the velocity of the interface, so that neither continuity of velocity nor balance of
traction needs an equation of its own.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.fluid import Blood
from jaxfsi.core.ports import BlockPort, FlowPort, Port, PressurePort
from jaxfsi.core.profile import unit_flow_profile
from jaxfsi.core.solid import Wall
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region


class Model(eqx.Module):
    """What a step in time needs to know.

    Differentiated are the node positions, blood, wall, ports and profiles; index lists and masks
    are not.

    Attributes:
        x: reference positions of the nodes [cm].
        fluid_tets: corners of the fluid elements.
        solid_tets: corners of the solid elements.
        in_fluid: nodes that carry a pressure.
        in_solid: nodes of the wall.
        held: nodes whose velocity is prescribed.
        mesh_held: fluid nodes that the mesh motion does not move.
        blood: what the blood is like.
        wall: what the wall is made of.
        ports: condition of each port.
        profiles: velocity of unit inflow at flow ports [1/cm²]; a field without entries elsewhere.
        port_faces: triangles of each port.
        outer_faces: triangles that the tissue outside supports.
        names: of the ports.
    """

    x: Float[Array, "3 nodes"]
    fluid_tets: Int[Array, "4 fluid_tets"]
    solid_tets: Int[Array, "4 solid_tets"]
    in_fluid: Bool[Array, " nodes"]
    in_solid: Bool[Array, " nodes"]
    held: Bool[Array, " nodes"]
    mesh_held: Bool[Array, " nodes"]
    blood: Blood
    wall: Wall | None
    ports: tuple[Port, ...]
    profiles: tuple[Float[Array, "3 nodes"] | None, ...]
    port_faces: tuple[Int[Array, "3 _"], ...]
    outer_faces: Int[Array, "3 outer"]
    names: tuple[str, ...] = eqx.field(static=True)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.x.shape[1]

    @property
    def is_rigid(self) -> bool:
        """Whether there is no wall that moves."""
        return self.solid_tets.shape[1] == 0

    @property
    def is_dry(self) -> bool:
        """Whether there is no blood."""
        return self.fluid_tets.shape[1] == 0


def build_model(
    mesh: Mesh,
    ports: Mapping[str, Port],
    *,
    blood: Blood | None = None,
    wall: Wall | None = None,
    clamped: Sequence[str] | None = None,
) -> Model:
    """Put a model together.

    Args:
        mesh: labelled mesh in cm. Its regions decide what is modelled.
        ports: condition at labels of the mesh: at all its openings, and at any other surface that
            carries a load.
        blood: None for the defaults.
        wall: what the wall is made of; required where the mesh has one.
        clamped: labels whose nodes do not move; None: the cut ends of the wall.

    Raises:
        ValueError: ports and labels do not fit, or the wall is missing.
    """
    labels = [name for name in mesh.label_names if name.endswith(RING_SUFFIX)]
    clamped = tuple(labels) if clamped is None else tuple(clamped)
    _check(mesh, ports, wall, clamped)
    n_nodes = len(mesh.points)
    fluid, solid = mesh.tets_of(Region.FLUID), mesh.tets_of(Region.SOLID)
    in_fluid, in_solid = _marked(n_nodes, fluid), _marked(n_nodes, solid)
    held = _marked(n_nodes, *(mesh.labelled(name) for name in clamped))
    if not len(solid):
        held |= _marked(n_nodes, mesh.labelled(INTERFACE))
    profiles = []
    for name, port in ports.items():
        if isinstance(port, FlowPort):
            profiles.append(jnp.asarray(unit_flow_profile(mesh, name).T))
            held |= _marked(n_nodes, mesh.labelled(name))
        else:
            profiles.append(None)
    openings = _marked(n_nodes, *(mesh.labelled(name) for name in mesh.openings))
    outer = mesh.labelled(OUTER_WALL) if OUTER_WALL in mesh.label_names else np.zeros((0, 3), int)
    return Model(
        x=jnp.asarray(mesh.points.T, float),
        fluid_tets=jnp.asarray(fluid.T, jnp.int32),
        solid_tets=jnp.asarray(solid.T, jnp.int32),
        in_fluid=jnp.asarray(in_fluid),
        in_solid=jnp.asarray(in_solid),
        held=jnp.asarray(held),
        mesh_held=jnp.asarray(in_solid | openings | ~in_fluid),
        blood=Blood() if blood is None else blood,
        wall=wall if len(solid) else None,
        ports=tuple(ports.values()),
        profiles=tuple(profiles),
        port_faces=tuple(jnp.asarray(mesh.labelled(name).T, jnp.int32) for name in ports),
        outer_faces=jnp.asarray(outer.T, jnp.int32),
        names=tuple(ports),
    )


def _marked(n_nodes: int, *elements: Int[np.ndarray, "_ _"]) -> Bool[np.ndarray, " nodes"]:
    mark = np.zeros(n_nodes, bool)
    for e in elements:
        mark[e.ravel()] = True
    return mark


def _check(mesh: Mesh, ports: Mapping[str, Port], wall: Wall | None, clamped: tuple[str, ...]):
    faults = [
        f"there is no label {name!r}" for name in (*ports, *clamped) if name not in mesh.label_names
    ]
    missing = [name for name in mesh.openings if name not in ports]
    if missing:
        faults.append(f"the openings {', '.join(missing)} have no port")
    faults += [
        f"the port {name!r} is a {type(port).__name__}"
        for name, port in ports.items()
        if not isinstance(port, PressurePort | BlockPort | FlowPort)
    ]
    if wall is None and np.any(mesh.region == Region.SOLID):
        faults.append("the mesh has a wall but none is given")
    if faults:
        raise ValueError(
            "; ".join(faults)
            + f". The mesh has the labels {', '.join(mesh.label_names)}; give each opening a"
            " PressurePort, BlockPort or FlowPort."
        )
