"""A model: mesh, materials, ports and supports as arrays that the step in time works on.

Rigid-wall flow, a wall alone and both coupled are one model with different regions: without solid
elements the interface stands still, without fluid elements there is no pressure. Fluid and solid
share the velocity of the interface, so that neither continuity of velocity nor balance of
traction needs an equation of its own.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.bending import bending_element, mid_edges
from jaxfsi.core.elements.quadratic import QuadraticElement, numbered_edges
from jaxfsi.core.elements.wall import LinearElement
from jaxfsi.core.laws.contact import Contact, LeastGap, contact_pairs
from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.interface import MidEdgeInterface
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wall_balance import WallElements, WallPrestress
from jaxfsi.core.ports.port import AbstractPort, PortSurface
from jaxfsi.faces import find_rows, triangle_edges
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region, tet_faces
from lumped.elements import AbstractElement
from lumped.parameters import Parameter

WallElement = Literal["bending", "quadratic", "linear"]
"""Which element the wall is made of."""


class Model(eqx.Module):
    """What a step in time needs to know.

    Differentiated are the node positions, blood, wall, ports and profiles; index lists and masks
    are not.

    Attributes:
        x: reference positions of the nodes [cm]: vertex coordinates, followed by zeros for the
            mid-edge displacement modes of quadratic walls.
        fluid_tets: corners of the fluid elements.
        element: elements of the wall, linear ones without members where there is none.
        in_fluid: nodes that carry a pressure; where velocity is given at all openings of rigid
            walls, all but one, from which the pressure counts.
        in_solid: nodes of the wall.
        prescribed: nodes whose velocity is prescribed.
        mesh_prescribed: nodes whose mesh displacement is prescribed.
        blood: what the blood is like.
        wall: what the wall is made of.
        prestress: second Piola-Kirchhoff stress of the undeformed wall at the quadrature points of
            its elements [dyn/cm²]; None: without stress.
        P_ambient: pressure from which all others count in the equations [dyn/cm²]. The stress of
            the wall counts from a uniform −P_ambient, which is what holds it without strain where
            the same pressure acts on all its surfaces; a surface without a port is under it.
            Geometry is extrapolated in time, and so are the loads that turn with a surface: the
            smaller the pressures, the longer the steps that are stable.
        ports: condition of each port.
        profiles: field that each port made from the mesh; None: it needs none.
        port_faces: triangles of each port.
        port_edges: mid-edge unknowns opposite to their corners; None where there are none.
        outer_faces: triangles that the tissue outside supports.
        outer_edges: mid-edge unknowns opposite to their corners; None where there are none.
        mid_edge: faces of the interface with mid-edge modes; None where there are none.
        contact: least gap between the sides of the lumen; None: the sides do not see each other.
        names: of the ports (static).
        n_vertices: vertices of the mesh, which come before other nodes (static).
    """

    x: Float[Array, "3 nodes"]
    fluid_tets: Int[Array, "4 fluid_tets"]
    element: WallElements
    in_fluid: Bool[Array, " nodes"]
    in_solid: Bool[Array, " nodes"]
    prescribed: Bool[Array, " nodes"]
    mesh_prescribed: Bool[Array, " nodes"]
    blood: Blood
    wall: Wall | None
    prestress: WallPrestress
    P_ambient: Float[Array, ""]
    ports: tuple[AbstractPort, ...]
    profiles: tuple[Float[Array, "3 nodes"] | None, ...]
    port_faces: tuple[Int[Array, "3 _"], ...]
    port_edges: tuple[Int[Array, "3 _"] | None, ...]
    outer_faces: Int[Array, "3 outer"]
    outer_edges: Int[Array, "3 outer"] | None
    mid_edge: MidEdgeInterface | None
    contact: Contact | None
    names: tuple[str, ...] = eqx.field(static=True)
    n_vertices: int = eqx.field(static=True)

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.x.shape[1]

    @property
    def solid_tets(self) -> Int[Array, "4 solid_tets"]:
        """Corners of the solid elements."""
        return self.element.tets

    @property
    def is_rigid(self) -> bool:
        """Whether there is no wall that moves."""
        return self.solid_tets.shape[1] == 0

    @property
    def is_dry(self) -> bool:
        """Whether there is no blood."""
        return self.fluid_tets.shape[1] == 0

    @property
    def moves_mesh(self) -> bool:
        """Whether the mesh of the blood moves, with the wall or with the surface of a port."""
        moved = not self.is_rigid or any(port.moves_surface for port in self.ports)
        return moved and not self.is_dry

    @property
    def surfaces(self) -> tuple[PortSurface, ...]:
        """Surface of each port."""
        parts = zip(self.port_faces, self.port_edges, self.profiles, strict=True)
        return tuple(PortSurface(*part) for part in parts)

    def without_ports(self) -> "Model":
        """The same for statics, which do not see the ports: one program for all of them."""
        none = {name: () for name in ("ports", "profiles", "port_faces", "port_edges", "names")}
        return dataclasses.replace(self, **none)


def build_model(
    mesh: Mesh,
    ports: Mapping[str, AbstractPort],
    *,
    blood: Blood | None = None,
    wall: Wall | None = None,
    clamped: Sequence[str] | None = None,
    wall_element: WallElement | None = None,
    P_ambient: Parameter = 0.0,
    least_gap: LeastGap | None = None,
) -> Model:
    """Put a model together.

    Args:
        mesh: labelled mesh in cm. Its regions decide what is modelled.
        ports: condition at labels of the mesh: at all its openings, and at any other surface that
            carries a load.
        blood: None for the defaults.
        wall: what the wall is made of; required where the mesh has one.
        clamped: labels whose nodes do not move; None: the cut ends of the wall.
        wall_element: ``"bending"``: wedges where the mesh has them, which cost no more than linear
            elements, and quadratic ones elsewhere; ``"linear"``, as most codes have it, which
            hardly bends; or ``"quadratic"``, which bends and does not lock. None: bending where
            the mesh has wedges, linear elsewhere.
        P_ambient: pressure outside [dyn/cm²], at which the wall has its reference shape, see
            `Model`.
        least_gap: below which the sides of the lumen repel each other; None: never.

    Raises:
        ValueError: ports and labels do not fit, the wall is missing, or its arrays are not of one
            value an element.
    """
    labels = [name for name in mesh.label_names if name.endswith(RING_SUFFIX)]
    clamped = tuple(labels) if clamped is None else tuple(clamped)
    _check(mesh, ports, wall, clamped)
    n_nodes = len(mesh.points)
    fluid, solid = mesh.tets_of(Region.FLUID), mesh.tets_of(Region.SOLID)
    element, ends, held = _wall_elements(mesh, solid, wall_element)
    n_edges = len(held)
    in_fluid, in_solid = _marked(n_nodes, fluid), _marked(n_nodes, solid)
    prescribed = _marked(n_nodes, *(mesh.labelled(name) for name in clamped))
    if not len(solid):
        prescribed |= _marked(n_nodes, mesh.labelled(INTERFACE))
    profiles, fixed = [], prescribed.copy()
    for name, port in ports.items():
        profile = port.setup(mesh, name, fixed)
        if profile is not None:
            profile = jnp.asarray(np.pad(profile.T, ((0, 0), (0, n_edges))))
        profiles.append(profile)
        if port.prescribes_velocity:
            prescribed |= _marked(n_nodes, mesh.labelled(name))
    if len(fluid) and not len(solid) and all(p.prescribes_velocity for p in ports.values()):
        # Nothing sets the level of the pressure: it counts from one node, whose continuity
        # equation follows from the others.
        in_fluid[fluid[0, 0]] = False
    mesh_prescribed = in_solid | _marked(n_nodes, *(mesh.labelled(name) for name in mesh.openings))
    mesh_prescribed |= ~in_fluid if len(solid) else fixed
    outer = mesh.labelled(OUTER_WALL) if OUTER_WALL in mesh.label_names else np.zeros((0, 3), int)
    return Model(
        x=jnp.asarray(np.pad(mesh.points.T.astype(float), ((0, 0), (0, n_edges)))),
        fluid_tets=jnp.asarray(fluid.T, jnp.int32),
        element=element,
        in_fluid=jnp.asarray(np.append(in_fluid, np.zeros(n_edges, bool))),
        in_solid=jnp.asarray(np.append(in_solid, np.ones(n_edges, bool))),
        prescribed=jnp.asarray(np.append(prescribed, _held(held, _among(ends, mesh, clamped)))),
        mesh_prescribed=jnp.asarray(np.append(mesh_prescribed, np.ones(n_edges, bool))),
        blood=Blood() if blood is None else blood,
        wall=wall if len(solid) else None,
        prestress=None,
        P_ambient=jnp.asarray(P_ambient, float),
        ports=tuple(ports.values()),
        profiles=tuple(profiles),
        port_faces=tuple(jnp.asarray(mesh.labelled(name).T, jnp.int32) for name in ports),
        port_edges=tuple(_port_edges(mesh, name, element) for name in ports),
        outer_faces=jnp.asarray(outer.T, jnp.int32),
        outer_edges=mid_edges(element, outer.T),
        mid_edge=_mid_edge_interface(mesh, element) if len(fluid) else None,
        contact=_contact(mesh, solid, least_gap) if len(solid) else None,
        names=tuple(ports),
        n_vertices=n_nodes,
    )


def _wall_elements(
    mesh: Mesh, solid: Int[np.ndarray, "tets 4"], kind: WallElement | None
) -> tuple[WallElements, Int[np.ndarray, "edges 2"], Bool[np.ndarray, " edges"]]:
    """Elements of the wall, ends of the edges that carry unknowns, and which of them are held."""
    kind = kind or ("bending" if len(mesh.wedges) else "linear")
    _check_element(kind)
    n_nodes = len(mesh.points)
    if kind == "linear" or not len(solid):
        linear = LinearElement(jnp.asarray(solid.T, jnp.int32))
        return linear, np.zeros((0, 2), int), np.zeros(0, bool)
    if kind == "bending" and len(mesh.wedges):
        place = np.cumsum(mesh.region == Region.SOLID) - 1
        parts = bending_element(solid, mesh.wedges, place[mesh.wedge_tets], n_nodes)
        n_edges = len(parts.ends)
        # One more unknown, held, stands for the edges of faces that belong to wedges.
        return parts.element, parts.ends, np.append(parts.held, np.ones(min(n_edges, 1), bool))
    ends, index = numbered_edges(solid)
    element = QuadraticElement(
        jnp.asarray(solid.T, jnp.int32), jnp.asarray(n_nodes + index.T, jnp.int32)
    )
    return element, ends, np.zeros(len(ends), bool)


def _mid_edge_interface(mesh: Mesh, element: WallElements) -> MidEdgeInterface | None:
    """The interface, where the wall has mid-edge modes."""
    faces = mesh.labelled(INTERFACE)
    edges = mid_edges(element, faces.T)
    return None if edges is None else MidEdgeInterface(jnp.asarray(faces.T, jnp.int32), edges)


def _contact(
    mesh: Mesh, solid: Int[np.ndarray, "tets 4"], least_gap: LeastGap | None
) -> Contact | None:
    """The least gap of the lumen; None where there is none to keep."""
    faces = mesh.labelled(INTERFACE) if INTERFACE in mesh.label_names else np.zeros((0, 3), int)
    if least_gap is None or not len(faces):
        return None
    # A wall alone has its interface turned the other way: pairs lie where the wall does not.
    sides = tet_faces(solid).reshape(-1, 3)
    into_wall = sides[find_rows(faces, sides)][:, ::-1]
    return contact_pairs(least_gap, mesh.points, into_wall)


def _port_edges(mesh: Mesh, name: str, element: WallElements) -> Int[Array, "3 faces"] | None:
    """Mid-edge unknowns of a labelled surface; None at an opening of the blood."""
    return None if name in mesh.openings else mid_edges(element, mesh.labelled(name).T)


def _among(
    ends: Int[np.ndarray, "edges 2"], mesh: Mesh, labels: Sequence[str]
) -> Bool[np.ndarray, " edges"]:
    """Which edges belong to triangles under one of some labels."""
    sides = [triangle_edges(mesh.labelled(name)).reshape(-1, 2) for name in labels]
    own = np.sort(np.concatenate([*sides, np.zeros((0, 2), int)]), axis=1)
    n = len(mesh.points)
    return np.isin(ends[:, 0] * n + ends[:, 1], own[:, 0] * n + own[:, 1])


def _held(
    held: Bool[np.ndarray, " edges"], clamped: Bool[np.ndarray, " ends"]
) -> Bool[np.ndarray, " edges"]:
    """Edges that are held, on wedges or on clamped faces."""
    return held | np.pad(clamped, (0, len(held) - len(clamped)))


def _marked(n_nodes: int, *elements: Int[np.ndarray, "_ _"]) -> Bool[np.ndarray, " nodes"]:
    mark = np.zeros(n_nodes, bool)
    for e in elements:
        mark[e.ravel()] = True
    return mark


def _check_element(wall_element: str) -> None:
    if wall_element not in get_args(WallElement):
        raise ValueError(
            f"wall_element = {wall_element!r} is not known; take one of"
            f" {', '.join(get_args(WallElement))}."
        )


def _check(
    mesh: Mesh, ports: Mapping[str, AbstractPort], wall: Wall | None, clamped: tuple[str, ...]
):
    faults = [
        f"there is no label {name!r}" for name in (*ports, *clamped) if name not in mesh.label_names
    ]
    missing = [name for name in mesh.openings if name not in ports]
    if missing:
        faults.append(f"the openings {', '.join(missing)} have no port")
    faults += [
        f"the port {name!r} is of type {type(port).__name__}"
        + (", a block: write BlockPort(block)" if isinstance(port, AbstractElement) else "")
        for name, port in ports.items()
        if not isinstance(port, AbstractPort)
    ]
    if wall is None and np.any(mesh.region == Region.SOLID):
        faults.append("the mesh has a wall but none is given")
    if faults:
        raise ValueError(
            "; ".join(faults)
            + f". The mesh has the labels {', '.join(mesh.label_names)}; give each opening a"
            " port, such as PressurePort, BlockPort, FlowPort or VelocityPort."
        )
    n_solid = int(np.sum(mesh.region == Region.SOLID))
    faults = _array_faults(wall, n_solid) if wall is not None and n_solid else []
    if faults:
        raise ValueError(
            f"{'; '.join(faults)}. The wall has {n_solid} tetrahedra: give one number, or an array"
            " whose last axis has one value for each of them, in the order of the mesh."
        )


def _array_faults(wall: Wall, n_solid: int) -> list[str]:
    """Numbers of a wall by element whose count is another one."""
    by_element = {"material": wall.material, "rho_s": wall.rho_s, "damping": wall.damping}
    leaves, _ = jax.tree_util.tree_flatten_with_path(eqx.filter(by_element, eqx.is_inexact_array))
    return [
        f"wall.{jax.tree_util.keystr(path, simple=True, separator='.')} has the shape {leaf.shape}"
        for path, leaf in leaves
        if leaf.ndim and leaf.shape[-1] not in (1, n_solid)
    ]
