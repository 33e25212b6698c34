"""The topology that a mesh of blood in a wall must have, and in words what is wrong with it.

A lumen without holes is a ball: the Euler characteristic of its boundary is 2, and so is that of
the outer boundary of blood and wall together. The wall is a shell with n openings, whose boundary
is a surface of genus n − 1: χ = 2 (2 − n). A septum with a hole in it looks perfect in every
measure of element quality; only these numbers show it.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from jaxfsi.faces import boundary_of, face_table, find_rows
from jaxfsi.measures import enclosed_volume
from jaxfsi.mesh import OUTER_WALL, RING_SUFFIX, Mesh, Region, tet_volumes
from jaxfsi.mesh_checks import cell_faults, element_faults, is_crowded, label_faults, place
from jaxfsi.mesh_parts import used_nodes
from jaxfsi.meshing.labels import face_components
from jaxfsi.meshing.surface.topology import SurfaceTopology, surface_topology

_VOLUME_TOLERANCE = 1e-9  # round-off of a sum over 1e6 faces, relative
_OUTSIDE = -1e-9  # barycentric coordinate below which a node lies off a tetrahedron


class TopologyFault(NamedTuple):
    """One thing wrong with the topology of a mesh.

    Attributes:
        what: what is wrong.
        where: the surface or region, and a position if there is one.
        cure: what to try.
    """

    what: str
    where: str
    cure: str


@dataclasses.dataclass(frozen=True)
class TopologyReport:
    """Topology of a mesh and its faults.

    Attributes:
        surfaces: topology of the boundary of the ``lumen``, the ``wall`` and of both together
            (``outer``); those that the mesh has.
        n_components: pieces of each region, connected through faces.
        volume: volume of each region from its tetrahedra [cm³].
        volume_from_faces: the same from its labelled faces [cm³].
        faults: all that is wrong; empty for a good mesh.
    """

    surfaces: dict[str, SurfaceTopology]
    n_components: dict[str, int]
    volume: dict[str, float]
    volume_from_faces: dict[str, float]
    faults: tuple[TopologyFault, ...]

    @property
    def euler(self) -> dict[str, int]:
        """Euler characteristic of each surface."""
        return {name: surface.euler for name, surface in self.surfaces.items()}

    def raise_faults(self) -> None:
        """Refuse the mesh if anything is wrong with it.

        Raises:
            ValueError: lists every fault with its place and cure.
        """
        if self.faults:
            lines = [f"{fault.where}: {fault.what}. {fault.cure}." for fault in self.faults]
            raise ValueError("the mesh has the wrong topology. " + " ".join(lines))

    def to_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""
        return {
            "euler": self.euler,
            "n_components": self.n_components,
            "volume_cm3": self.volume,
            "volume_from_faces_cm3": self.volume_from_faces,
            "faults": [fault._asdict() for fault in self.faults],
        }


def check_topology(mesh: Mesh) -> TopologyReport:
    """Topology of a mesh of blood, of blood in a wall, or of a wall alone.

    Expected are one piece per region, χ = 2 of the lumen and of the outer boundary, χ = 2 (2 − n)
    of the boundary of a wall with n openings, all of them closed manifolds, no inverted
    tetrahedron, no node of the wall in the blood, every boundary face labelled once, and equal
    volumes from tetrahedra and from labelled faces. A wall alone may have any shape, so its χ is
    reported but not judged. Where three tetrahedra share a face there are no surfaces to examine,
    and the faults of the elements are all that is reported.

    The wall round blood that is one piece and a ball is one piece itself; a second piece of wall
    touches no blood, or touches it in a way that the Euler characteristics do not allow either.

    Args:
        mesh: mesh with labels.

    Returns:
        The numbers and the faults; nothing is raised.
    """
    elements = [
        TopologyFault(clause, "elements", _CURE_ELEMENTS) for clause in element_faults(mesh)
    ]
    if is_crowded(mesh):
        return TopologyReport({}, {}, {}, {}, tuple(elements))
    regions = [region for region in Region if np.any(mesh.region == region)]
    surfaces = _surfaces(mesh, regions)
    components = {_REGION[region]: count_components(mesh.tets_of(region)) for region in regions}
    volumes = tet_volumes(mesh.points, mesh.tets)
    volume = {_REGION[region]: float(np.sum(volumes[mesh.region == region])) for region in regions}
    from_faces = {_REGION[region]: _labelled_volume(mesh, region) for region in regions}
    faults = [
        *elements,
        *(TopologyFault(clause, "labels", _CURE_LABELS) for clause in label_faults(mesh)),
        *_surface_faults(surfaces, _expected_euler(mesh, regions)),
        *_component_faults(components),
        *_volume_faults(volume, from_faces),
        *_intrusion_faults(mesh),
    ]
    return TopologyReport(surfaces, components, volume, from_faces, tuple(faults))


def unlabelled_faults(mesh: Mesh) -> list[TopologyFault]:
    """What is wrong with tetrahedra and regions alone, before their faces can be labelled.

    Args:
        mesh: mesh whose labels are not looked at; nodes that no tetrahedron uses are no fault.
    """
    faults = [TopologyFault(clause, "elements", _CURE_ELEMENTS) for clause in cell_faults(mesh)]
    if is_crowded(mesh):
        return faults
    regions = [region for region in Region if np.any(mesh.region == region)]
    components = {_REGION[region]: count_components(mesh.tets_of(region)) for region in regions}
    expected = {} if regions == [Region.SOLID] else {"lumen": 2}
    return [
        *faults,
        *_surface_faults(_surfaces(mesh, regions), expected),
        *_component_faults(components),
    ]


def _surfaces(mesh: Mesh, regions: list[Region]) -> dict[str, SurfaceTopology]:
    """Topology of the boundary of each region and of both together."""
    surfaces = {
        _SURFACE[region]: surface_topology(mesh.points, boundary_of(mesh.tets_of(region)))
        for region in regions
    }
    if len(regions) == len(Region):
        surfaces["outer"] = surface_topology(mesh.points, boundary_of(mesh.tets))
    return surfaces


_SURFACE = {Region.FLUID: "lumen", Region.SOLID: "wall"}
_REGION = {Region.FLUID: "fluid", Region.SOLID: "solid"}
_CURE_ELEMENTS = "Mesh again with smaller elements there"
_CURE_LABELS = "Label the faces from the tetrahedra with jaxfsi.meshing.label_faces"
_CURE_EULER = {
    "lumen": "Two lumens touch where a septum should part them, or the lumen has a loop: refine"
    " the septum, or give it a least thickness",
    "outer": "The wall closes on itself or leaves a hole: lower its thickness or refine there",
    "wall": "The septum or the wall has a hole, or an opening is missing: refine there",
}


def _expected_euler(mesh: Mesh, regions: list[Region]) -> dict[str, int]:
    if regions == [Region.SOLID]:
        return {}
    expected = {"lumen": 2}
    if Region.SOLID in regions:
        expected |= {"outer": 2, "wall": 2 * (2 - _count_openings(mesh))}
    return expected


def _count_openings(mesh: Mesh) -> int:
    """Patches of the fluid's boundary under the names of openings; one name can have several."""
    named = [mesh.labelled(name) for name in mesh.openings]
    faces = np.concatenate([*named, np.zeros((0, 3), dtype=np.int64)])
    faces = faces[find_rows(faces, boundary_of(mesh.tets_of(Region.FLUID))) >= 0]
    return len(np.unique(face_components(faces)))


def count_components(tets: Int[np.ndarray, "tets 4"]) -> int:
    """Number of pieces that tetrahedra form when joined through shared faces."""
    table = face_table(tets)
    shared = ~table.on_boundary
    ones = np.ones(int(shared.sum()), dtype=np.int8)
    graph = csr_array(
        (ones, (table.first[shared], table.second[shared])), shape=(len(tets), len(tets))
    )
    return int(connected_components(graph, directed=False)[0])


def _labelled_volume(mesh: Mesh, region: Region) -> float:
    """Volume of a region from the labelled faces that bound it; the interface bounds both."""
    of_solid = np.array(
        [name == OUTER_WALL or name.endswith(RING_SUFFIX) for name in mesh.label_names], dtype=bool
    )
    if not np.any(mesh.region == Region.FLUID):
        return enclosed_volume(mesh.points, mesh.faces)
    solid = of_solid[mesh.face_label]
    if region == Region.FLUID:
        return enclosed_volume(mesh.points, mesh.faces[~solid])
    # The whole domain less the blood: the interface drops out of the sum over both.
    openings = np.isin(mesh.face_label, [mesh.label_names.index(name) for name in mesh.openings])
    whole = enclosed_volume(mesh.points, mesh.faces[solid | openings])
    return whole - enclosed_volume(mesh.points, mesh.faces[~solid])


def _at(point: tuple[float, float, float] | None) -> str:
    return "" if point is None else f" at {place(np.array(point))}"


def _surface_faults(
    surfaces: dict[str, SurfaceTopology], expected: dict[str, int]
) -> list[TopologyFault]:
    faults = []
    for name, surface in surfaces.items():
        where = f"boundary of the {name}" if name != "outer" else "outer boundary"
        if not surface.is_closed_manifold:
            counts = {
                "edges in one triangle": surface.open_edges,
                "edges in more than two": surface.crowded_edges,
                "edges between triangles of opposite sense": surface.unmatched_edges,
                "nodes where it touches itself": surface.pinched_nodes,
            }
            said = ", ".join(f"{number} {what}" for what, number in counts.items() if number)
            faults.append(
                TopologyFault(
                    f"it is no closed manifold: {said}",
                    where + _at(surface.fault_at),
                    "Refine there, or widen the gap that is pinched",
                )
            )
        if name in expected and surface.euler != expected[name]:
            pieces = (
                f": it has {surface.n_components} pieces, the smallest{_at(surface.piece_at)}"
                if surface.n_components > 1
                else ""
            )
            faults.append(
                TopologyFault(
                    f"its Euler characteristic is {surface.euler}, not {expected[name]}{pieces}",
                    where,
                    _CURE_EULER[name],
                )
            )
    return faults


def _component_faults(components: dict[str, int]) -> list[TopologyFault]:
    return [
        TopologyFault(
            f"it falls into {number} pieces",
            name,
            "Keep the largest piece, or join the pieces by smaller elements where they part",
        )
        for name, number in components.items()
        if number != 1
    ]


def _volume_faults(volume: dict[str, float], from_faces: dict[str, float]) -> list[TopologyFault]:
    return [
        TopologyFault(
            f"its tetrahedra fill {volume[name]:.9g} cm³, its labelled faces enclose"
            f" {from_faces[name]:.9g} cm³",
            name,
            "Elements overlap or faces are missing or reversed: label the faces again, then mesh"
            " again",
        )
        for name in volume
        if abs(volume[name] - from_faces[name])
        > _VOLUME_TOLERANCE * sum(np.abs(list(volume.values())))
    ]


def _intrusion_faults(mesh: Mesh) -> list[TopologyFault]:
    faults = []
    for inner, outer in ((Region.SOLID, Region.FLUID), (Region.FLUID, Region.SOLID)):
        inside = nodes_inside(mesh, inner, outer)
        if inside.size:
            faults.append(
                TopologyFault(
                    f"{inside.size} nodes of the {_REGION[inner]} that the {_REGION[outer]} does"
                    " not share lie in or on it",
                    f"{_REGION[outer]} at {place(mesh.points[inside[0]])}",
                    "The two regions overlap or do not conform: mesh both in one go, or lower the"
                    " wall's thickness",
                )
            )
    return faults


def nodes_inside(mesh: Mesh, inner: Region, outer: Region) -> Int[np.ndarray, " inside"]:
    """Nodes of one region, not shared with the other, that lie in or on the other's tetrahedra."""
    tets = mesh.tets_of(outer)
    nodes = np.setdiff1d(used_nodes(mesh.tets_of(inner)), used_nodes(tets))
    if len(nodes) == 0 or len(tets) == 0:
        return np.zeros(0, dtype=np.int64)
    corners = mesh.points[tets]
    centre = corners.mean(axis=1)
    reach = np.sqrt(np.max(np.sum((corners - centre[:, None]) ** 2, axis=2), axis=1))
    tree = KDTree(mesh.points[nodes])
    near = tree.query_ball_point(centre, reach, return_length=True) > 0
    found = tree.query_ball_point(centre[near], reach[near])
    lengths = np.array([len(entry) for entry in found], dtype=np.int64)
    tet = np.repeat(np.flatnonzero(near), lengths)
    if len(tet) == 0:
        return np.zeros(0, dtype=np.int64)
    node = nodes[np.concatenate([np.asarray(entry, dtype=np.int64) for entry in found])]
    weights = barycentric(corners[tet], mesh.points[node])
    return np.unique(node[np.all(weights > _OUTSIDE, axis=1)])


def barycentric(
    corners: Float[np.ndarray, "tets 4 3"], x: Float[np.ndarray, "tets 3"]
) -> Float[np.ndarray, "tets 4"]:
    """Barycentric coordinates of one point in each tetrahedron; all positive inside.

    λ_i is the volume of the tetrahedron with its vertex i moved to x over the whole volume; flat
    tetrahedra give λ = −1.
    """

    def volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
        return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)

    a, b, c, d = (corners[:, i] for i in range(4))
    parts = np.stack(
        [volume(x, b, c, d), volume(a, x, c, d), volume(a, b, x, d), volume(a, b, c, x)], axis=1
    )
    whole = volume(a, b, c, d)[:, None]
    return np.where(whole != 0.0, parts / np.where(whole != 0.0, whole, 1.0), -1.0)
