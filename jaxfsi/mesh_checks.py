"""Refusal of meshes that no solver can use: inverted elements and wrong or missing labels."""

import numpy as np
from jaxtyping import Float

from jaxfsi.faces import face_table, find_rows, region_faces, same_sense
from jaxfsi.mesh import Mesh, tet_faces, tet_volumes
from jaxfsi.mesh_parts import used_nodes


def check_mesh(mesh: Mesh) -> None:
    """Refuse a mesh with any fault that makes a computation on it meaningless.

    Topology that is merely unexpected, such as a perforated septum, is for
    `jaxfsi.meshing.topology.check_topology`.

    Args:
        mesh: mesh to check.

    Raises:
        ValueError: inverted tetrahedra, three tetrahedra at one face, two tetrahedra on the same
            side of a face, nodes without a tetrahedron, faces labelled twice, labelled faces
            inside a region or of the wrong sense, boundary faces without a label. All faults
            found are listed.
    """
    faults = element_faults(mesh) + label_faults(mesh)
    if faults:
        raise ValueError(
            f"the mesh cannot be used: {'; '.join(faults)}. Mesh again, or label its faces with"
            " jaxfsi.meshing.label_faces."
        )


def place(point: Float[np.ndarray, " 3"]) -> str:
    """A position for a message."""
    return f"({point[0]:.4g}, {point[1]:.4g}, {point[2]:.4g}) cm"


def element_faults(mesh: Mesh) -> list[str]:
    """Faults of the tetrahedra and nodes of a mesh, each in one clause."""
    faults = []
    volumes = tet_volumes(mesh.points, mesh.tets)
    bad = np.flatnonzero(volumes <= 0.0)
    if bad.size:
        at = mesh.points[mesh.tets[bad[0]]].mean(axis=0)
        faults.append(
            f"{bad.size} tetrahedra are inverted or flat, the first, number {bad[0]}, at"
            f" {place(at)}"
        )
    table = face_table(mesh.tets)
    shared = np.flatnonzero(~table.on_boundary)
    behind = tet_faces(mesh.tets)[table.second[shared], table.second_side[shared]]
    folded = same_sense(table.nodes[shared], behind)
    if np.any(folded):
        face = table.nodes[shared[np.argmax(folded)]]
        faults.append(
            f"{np.sum(folded)} faces have both their tetrahedra on the same side, the first at"
            f" {place(mesh.points[face].mean(axis=0))}"
        )
    unused = len(mesh.points) - len(used_nodes(mesh.tets))
    if unused:
        faults.append(f"{unused} nodes belong to no tetrahedron")
    return faults


def label_faults(mesh: Mesh) -> list[str]:
    """Faults of the labelled faces of a mesh, each in one clause."""
    faults = []
    bounds = region_faces(mesh.tets, mesh.region)
    wanted = np.concatenate([bounds.interface, bounds.fluid, bounds.solid])
    entry = find_rows(mesh.faces, wanted)
    inside = np.flatnonzero(entry < 0)
    if inside.size:
        name = mesh.label_names[mesh.face_label[inside[0]]]
        faults.append(
            f"{inside.size} labelled faces bound no region, the first, number {inside[0]}, under"
            f" {name!r} at {place(mesh.points[mesh.faces[inside[0]]].mean(axis=0))}"
        )
    found = entry[entry >= 0]
    times = np.bincount(found, minlength=len(wanted))
    if np.any(times > 1):
        faults.append(f"{np.sum(times > 1)} faces carry more than one label")
    if np.any(times == 0):
        where = wanted[np.argmax(times == 0)]
        faults.append(
            f"{np.sum(times == 0)} faces of the boundary or the interface have no label, the first"
            f" at {place(mesh.points[where].mean(axis=0))}"
        )
    wrong = ~same_sense(mesh.faces[entry >= 0], wanted[found])
    if np.any(wrong):
        faults.append(f"{np.sum(wrong)} labelled faces point into their region")
    return faults
