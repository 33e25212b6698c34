"""Fluid and solid that were saved apart, joined at the nodes that they share.

The two number their nodes separately; nodes of the interface are recognised by their coordinates.
A node that nearly coincides, but not within the tolerance, means that the meshes do not conform,
and they are refused.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxfsi.faces import boundary_of, triangle_edges
from jaxfsi.mesh_checks import place
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_parts import used_nodes

RELATIVE_TOLERANCE = 1e-6  # of the extent: ten roundings of a coordinate in single precision
_NEAR_MISS = 0.1  # of the shortest edge at the node


class JoinedNodes(NamedTuple):
    """Nodes of fluid and solid in one numbering: those of the fluid, then the solid's own.

    Attributes:
        points: positions; where both have the node, that of the fluid.
        solid: node in the joint numbering of each node of the solid.
    """

    points: Float[np.ndarray, "nodes 3"]
    solid: Int[np.ndarray, " solid"]


def _shortest_edge(
    points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " nodes"]:
    edges = triangle_edges(faces).reshape(-1, 2)
    length = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, edges.reshape(-1), np.repeat(length, 2))
    return shortest


def join_nodes(
    fluid_points: Float[np.ndarray, "fluid 3"],
    fluid_tets: Int[np.ndarray, "fluid_tets 4"],
    solid_points: Float[np.ndarray, "solid 3"],
    solid_tets: Int[np.ndarray, "solid_tets 4"],
    *,
    tolerance: float | None = None,
) -> JoinedNodes:
    """Number the nodes of fluid and solid together.

    Args:
        fluid_points: positions of the fluid's nodes [cm].
        fluid_tets: its tetrahedra.
        solid_points: positions of the solid's nodes [cm].
        solid_tets: its tetrahedra.
        tolerance: distance up to which two nodes are one [cm]; None: a millionth of the extent.

    Raises:
        MeshFileError: no nodes coincide, some nearly do, or two coincide with the same one.
    """
    if tolerance is None:
        tolerance = RELATIVE_TOLERANCE * float(np.max(np.ptp(fluid_points, axis=0)))
    fluid_faces, solid_faces = boundary_of(fluid_tets), boundary_of(solid_tets)
    fluid_nodes, solid_nodes = used_nodes(fluid_faces), used_nodes(solid_faces)
    distance, nearest = KDTree(fluid_points[fluid_nodes]).query(solid_points[solid_nodes])
    nearest = fluid_nodes[nearest]
    edge = np.minimum(
        _shortest_edge(fluid_points, fluid_faces)[nearest],
        _shortest_edge(solid_points, solid_faces)[solid_nodes],
    )
    same = distance <= tolerance
    near = ~same & (distance < _NEAR_MISS * edge)
    if np.any(near):
        at = solid_points[solid_nodes[np.argmax(near)]]
        raise MeshFileError(
            f"{np.sum(near)} nodes of the solid nearly coincide with nodes of the fluid (up to"
            f" {np.max(distance[near]):.3g} cm apart, tolerance {tolerance:.3g} cm), the first at"
            f" {place(at)}. Make both meshes from one surface, or raise the tolerance if they are"
            " the same nodes."
        )
    if not np.any(same):
        raise MeshFileError(
            f"fluid and solid share no node; the nearest are {np.min(distance):.3g} cm apart. Check"
            " that both folders belong to one mesh and are in one unit."
        )
    shared = nearest[same]
    if len(np.unique(shared)) != len(shared):
        raise MeshFileError(
            f"several nodes of the solid coincide with one of the fluid within {tolerance:.3g} cm."
            " Merge its double nodes, or lower the tolerance."
        )
    number = np.full(len(solid_points), -1, dtype=np.int64)
    number[solid_nodes[same]] = shared
    own = number < 0
    number[own] = len(fluid_points) + np.arange(int(own.sum()))
    return JoinedNodes(np.concatenate([fluid_points, solid_points[own]]), number)
