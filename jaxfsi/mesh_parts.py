"""Meshes made from a mesh: renumbered, one region alone, in another length unit."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from jaxfsi.faces import boundary_of, find_rows, row_order, same_sense, tet_edges
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region
from jaxfsi.opening import canonical_order


class Submesh(NamedTuple):
    """One region of a mesh as a mesh of its own.

    Attributes:
        mesh: the region; its boundary faces point out of it, those of the interface too.
        nodes: node of the whole mesh behind each of its nodes.
        tets: tetrahedron of the whole mesh behind each of its tetrahedra.
    """

    mesh: Mesh
    nodes: Int[np.ndarray, " nodes"]
    tets: Int[np.ndarray, " tets"]


def used_nodes(elements: Int[np.ndarray, "elements corners"]) -> Int[np.ndarray, " used"]:
    """Nodes that some tetrahedron or triangle uses, in rising order."""
    return np.unique(elements)


def node_order(mesh: Mesh) -> Int[np.ndarray, " nodes"]:
    """Nodes in reverse Cuthill-McKee order of the edge graph, which keeps neighbours close.

    Source: Cuthill & McKee 1969, Proc. 24th ACM National Conference, 157-172.
    """
    edges = tet_edges(mesh.tets)
    n_nodes = len(mesh.points)
    ones = np.ones(len(edges), dtype=np.int8)
    upper = csr_array((ones, (edges[:, 0], edges[:, 1])), shape=(n_nodes, n_nodes))
    graph = csr_array(upper + upper.T)
    return reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)


def reordered(mesh: Mesh) -> Mesh:
    """The same mesh with its nodes in `node_order` and its tetrahedra sorted by lowest node.

    Neighbours in space become neighbours in memory, which speeds every gather of the solver. The
    faces are sorted by label and then by lowest node; ``node_ids`` keep the old numbering.

    Args:
        mesh: any mesh.

    Returns:
        An equal mesh; its tetrahedra and faces keep their orientation.
    """
    order = node_order(mesh)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    tets, faces = rank[mesh.tets], rank[mesh.faces]
    by_node = row_order(np.sort(tets, axis=1))
    by_label = row_order(np.column_stack([mesh.face_label, np.sort(faces, axis=1)]))
    return dataclasses.replace(
        mesh,
        points=mesh.points[order],
        tets=tets[by_node],
        region=mesh.region[by_node],
        faces=faces[by_label],
        face_label=mesh.face_label[by_label],
        node_ids=mesh.ids[order],
        wedges=rank[mesh.wedges],
    )


def canonically_labelled(mesh: Mesh) -> Mesh:
    """The same mesh with its labels and faces in one order, whatever that of the file it is from.

    Labels are the openings in `jaxfsi.opening.canonical_order`, ``interface``, ``outer_wall`` and
    the rings in the order of their openings; faces are sorted by label and then by nodes.
    """
    held = set(mesh.label_names)
    rings = {name for name in held if name.endswith(RING_SUFFIX)}
    walls = [name for name in (INTERFACE, OUTER_WALL) if name in held]
    openings = canonical_order(held - rings - set(walls))
    stems = canonical_order(name.removesuffix(RING_SUFFIX) for name in rings)
    names = (*openings, *walls, *(f"{stem}{RING_SUFFIX}" for stem in stems))
    position = np.array([names.index(name) for name in mesh.label_names], dtype=np.int64)
    label = position[mesh.face_label]
    order = row_order(np.column_stack([label, np.sort(mesh.faces, axis=1)]))
    return dataclasses.replace(
        mesh, faces=mesh.faces[order], face_label=label[order], label_names=names
    )


def submesh(mesh: Mesh, region: Region) -> Submesh:
    """One region with its labelled faces.

    Args:
        mesh: mesh of fluid and solid.
        region: the region to keep.

    Returns:
        The region, and which nodes and tetrahedra of ``mesh`` it consists of. Its ``node_ids``
        are those of the whole mesh. Interface faces of a solid are turned to point out of it.

    Raises:
        ValueError: the mesh has no tetrahedron of this region.
    """
    kept = np.flatnonzero(mesh.region == region)
    if kept.size == 0:
        raise ValueError(
            f"the mesh has no {region.name.lower()} tetrahedra. Ask for the other region."
        )
    nodes = used_nodes(mesh.tets[kept])
    local = np.full(len(mesh.points), -1, dtype=np.int64)
    local[nodes] = np.arange(len(nodes))
    # Nodes alone do not tell: all three nodes of a blood face at a rim can lie on the wall too.
    boundary = boundary_of(mesh.tets[kept])
    entry = find_rows(mesh.faces, boundary)
    chosen = entry >= 0
    labels = mesh.face_label[chosen]
    faces = mesh.faces[chosen]
    turned = ~same_sense(faces, boundary[entry[chosen]])
    faces = local[np.where(turned[:, None], faces[:, ::-1], faces)]
    used = np.flatnonzero(np.isin(np.arange(len(mesh.label_names)), labels))
    position = np.zeros(len(mesh.label_names), dtype=np.int64)
    position[used] = np.arange(len(used))
    part = dataclasses.replace(
        mesh,
        points=mesh.points[nodes],
        tets=local[mesh.tets[kept]],
        region=mesh.region[kept],
        faces=faces,
        face_label=position[labels],
        label_names=tuple(mesh.label_names[i] for i in used),
        node_ids=mesh.ids[nodes],
        wedges=local[mesh.wedges] if region == Region.SOLID else mesh.wedges[:0],
    )
    return Submesh(part, nodes, kept)


def scaled(mesh: Mesh, factor: float) -> Mesh:
    """The same mesh with all lengths multiplied, such as ``scaled(mesh, MM)`` for a mesh in mm.

    Raises:
        ValueError: the factor is not positive and finite.
    """
    if not (np.isfinite(factor) and factor > 0.0):
        raise ValueError(
            f"a mesh cannot be scaled by {factor}. Give a positive factor, such as lumped.units.MM."
        )
    return dataclasses.replace(mesh, points=mesh.points * factor)
