"""Refusal of meshes that no solver can use: inverted elements and wrong or missing labels."""

import numpy as np
from jaxtyping import Float, Int, Shaped

from jaxfsi.faces import (
    crowded_faces,
    face_table,
    find_rows,
    region_faces,
    same_sense,
)
from jaxfsi.mesh import Mesh, tet_faces, tet_volumes
from jaxfsi.mesh_parts import used_nodes

_FLAT = 1e-10  # six volumes over the cube of the longest edge; a good wall element has 1e-3


def check_mesh(mesh: Mesh) -> None:
    """Refuse a mesh with any fault that makes a computation on it meaningless.

    Topology that is merely unexpected, such as a perforated septum, is for
    `jaxfsi.meshing.check.topology.check_topology`.

    Args:
        mesh: mesh to check.

    Raises:
        ValueError: inverted or flat tetrahedra, three tetrahedra at one face, tetrahedra or nodes
            that are there twice, two tetrahedra on the same side of a face, nodes without a
            tetrahedron, faces labelled twice, labelled faces inside a region or of the wrong
            sense, boundary faces without a label, labels without faces. All faults found are
            listed.
    """
    faults = element_faults(mesh)
    if not is_crowded(mesh):
        faults += label_faults(mesh)
    if faults:
        raise ValueError(
            f"the mesh cannot be used: {'; '.join(faults)}. Mesh again, or label its faces with"
            " jaxfsi.meshing.label_faces."
        )


def place(point: Float[np.ndarray, " 3"]) -> str:
    """A position for a message."""
    return f"({point[0]:.4g}, {point[1]:.4g}, {point[2]:.4g}) cm"


def is_crowded(mesh: Mesh) -> bool:
    """Whether three tetrahedra share a face somewhere, so that no side of it can be told."""
    return len(crowded_faces(mesh.tets)) > 0


def element_faults(mesh: Mesh) -> list[str]:
    """Faults of the tetrahedra and nodes of a mesh, each in one clause."""
    faults = cell_faults(mesh)
    used = used_nodes(mesh.tets)
    if len(used) < len(mesh.points):
        loose = np.setdiff1d(np.arange(len(mesh.points)), used)
        faults.append(
            f"{len(loose)} nodes belong to no tetrahedron, the first, number {loose[0]}, at"
            f" {place(mesh.points[loose[0]])}"
        )
    return faults


def cell_faults(mesh: Mesh) -> list[str]:
    """Faults of the tetrahedra of a mesh and of the nodes that they use, each in one clause."""
    faults = _volume_faults(mesh) + _double_faults(mesh)
    crowded = crowded_faces(mesh.tets)
    if len(crowded):
        faults.append(
            f"{len(crowded)} faces are shared by three or more tetrahedra, the first at"
            f" {_middle(mesh, crowded[0])}"
        )
        return faults
    table = face_table(mesh.tets)
    shared = np.flatnonzero(~table.on_boundary)
    behind = tet_faces(mesh.tets)[table.second[shared], table.second_side[shared]]
    folded = same_sense(table.nodes[shared], behind)
    if np.any(folded):
        faults.append(
            f"{np.sum(folded)} faces have both their tetrahedra on the same side, the first at"
            f" {_middle(mesh, table.nodes[shared[np.argmax(folded)]])}"
        )
    return faults


def _middle(mesh: Mesh, nodes: Int[np.ndarray, " corners"]) -> str:
    return place(mesh.points[nodes].mean(axis=0))


def _volume_faults(mesh: Mesh) -> list[str]:
    """Tetrahedra without a positive volume, beside the size that their edges give them."""
    corners = mesh.points[mesh.tets]
    edges = corners[:, [1, 2, 3, 2, 3, 3]] - corners[:, [0, 0, 0, 1, 1, 2]]
    longest = np.sqrt(np.max(np.sum(edges**2, axis=2), axis=1))
    bad = np.flatnonzero(6.0 * tet_volumes(mesh.points, mesh.tets) <= _FLAT * longest**3)
    if bad.size == 0:
        return []
    return [
        f"{bad.size} tetrahedra are inverted or flat, the first, number {bad[0]}, at"
        f" {_middle(mesh, mesh.tets[bad[0]])}"
    ]


def _double_faults(mesh: Mesh) -> list[str]:
    """Tetrahedra of the same nodes, and nodes at the same place."""
    faults = []
    twin = _twins(np.sort(mesh.tets, axis=1))
    if twin.size:
        faults.append(
            f"{twin.size} tetrahedra are there twice, the first, number {twin[0]}, at"
            f" {_middle(mesh, mesh.tets[twin[0]])}"
        )
    used = used_nodes(mesh.tets)
    twin = used[_twins(mesh.points[used])]
    if twin.size:
        faults.append(
            f"{twin.size} nodes lie where another one lies, the first, number {twin[0]}, at"
            f" {place(mesh.points[twin[0]])}"
        )
    return faults


def _twins(rows: Shaped[np.ndarray, "rows columns"]) -> Int[np.ndarray, " twins"]:
    """Rows that an earlier row equals, in rising order."""
    order = np.lexsort(rows.T[::-1])
    same = np.all(rows[order[1:]] == rows[order[:-1]], axis=1)
    return np.sort(order[1:][same])


def label_faults(mesh: Mesh) -> list[str]:
    """Faults of the labelled faces of a mesh, each in one clause."""
    faults = []
    empty = np.setdiff1d(np.arange(len(mesh.label_names)), mesh.face_label)
    if empty.size:
        faults.append(
            f"{empty.size} labels have no faces: {', '.join(mesh.label_names[i] for i in empty)}"
        )
    bounds = region_faces(mesh.tets, mesh.region)
    wanted = np.concatenate([bounds.interface, bounds.fluid, bounds.solid])
    entry = find_rows(mesh.faces, wanted)
    inside = np.flatnonzero(entry < 0)
    if inside.size:
        name = mesh.label_names[mesh.face_label[inside[0]]]
        faults.append(
            f"{inside.size} labelled faces bound no region, the first, number {inside[0]}, under"
            f" {name!r} at {_middle(mesh, mesh.faces[inside[0]])}"
        )
    found = entry[entry >= 0]
    times = np.bincount(found, minlength=len(wanted))
    if np.any(times > 1):
        faults.append(
            f"{np.sum(times > 1)} faces carry more than one label, the first at"
            f" {_middle(mesh, wanted[np.argmax(times > 1)])}"
        )
    if np.any(times == 0):
        faults.append(
            f"{np.sum(times == 0)} faces of the boundary or the interface have no label, the first"
            f" at {_middle(mesh, wanted[np.argmax(times == 0)])}"
        )
    wrong = ~same_sense(mesh.faces[entry >= 0], wanted[found])
    if np.any(wrong):
        faults.append(
            f"{np.sum(wrong)} labelled faces point into their region, the first at"
            f" {_middle(mesh, wanted[found[np.argmax(wrong)]])}"
        )
    return faults
