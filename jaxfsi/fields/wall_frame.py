"""Directions of an artery's wall: round the lumen and along it, from the shape of the lumen alone.

Normals of a tube, whatever its section, lie across its axis. Round each triangle of the lumen the
normals n of the nearest triangles, areas A, give::

    N = Σ A n⊗n / Σ A,      axis = eigenvector of the least eigenvalue of N

over as many triangles as it takes to see the wall turn: until the second eigenvalue is a sixth of
the first, which is a turn of 80° of a round tube. The axis is then turned into the wall, across the
normal there, and the circumference lies across both.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxfsi.mesh import INTERFACE, Mesh, Region

_FEWEST = 16
"""Triangles that are looked at first; each further look has twice as many."""

_TURNED = 1.0 / 6.0

_MOST = 20_000_000
"""Numbers gathered at once, which bounds the memory of fine meshes."""


class WallFrame(NamedTuple):
    """Unit vectors in each tetrahedron of the wall; which way along a line they point is open.

    Attributes:
        circumference: round the lumen.
        axis: along it.
        normal: across the wall.
    """

    circumference: Float[np.ndarray, "3 tets"]
    axis: Float[np.ndarray, "3 tets"]
    normal: Float[np.ndarray, "3 tets"]


def wall_frame(mesh: Mesh) -> WallFrame:
    """Directions in the wall, from the part of the lumen that is nearest.

    Tetrahedra that fill a wedge share those of the wedge.

    Args:
        mesh: with a wall round a lumen.

    Raises:
        ValueError: the mesh has no wall or no lumen's surface.
    """
    solid = mesh.tets_of(Region.SOLID)
    faces = mesh.labelled(INTERFACE) if INTERFACE in mesh.label_names else np.zeros((0, 3), int)
    if not len(solid) or not len(faces):
        raise ValueError(
            f"the mesh has {len(solid)} tetrahedra in its wall and {len(faces)} faces named"
            f" {INTERFACE!r}; directions need a wall round a lumen."
        )
    middle = mesh.points[faces].mean(axis=1)
    nearest = KDTree(middle).query(_centres(mesh, solid))[1]
    normal, axis = _lumen_frame(mesh, faces, middle)
    n, z = normal[nearest], axis[nearest]
    return WallFrame(np.cross(n, z).T, z.T, n.T)


def _centres(mesh: Mesh, solid: Int[np.ndarray, "tets 4"]) -> Float[np.ndarray, "tets 3"]:
    """Centres of tetrahedra, or of the wedges that they fill."""
    centre = mesh.points[solid].mean(axis=1)
    if len(mesh.wedges):
        place = np.cumsum(mesh.region == Region.SOLID) - 1
        centre[place[mesh.wedge_tets]] = mesh.points[mesh.wedges].mean(axis=1)[:, None]
    return centre


def _lumen_frame(
    mesh: Mesh, faces: Int[np.ndarray, "faces 3"], middle: Float[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "faces 3"], Float[np.ndarray, "faces 3"]]:
    """Normal and axis at each face of the lumen."""
    a, b, c = (mesh.points[faces[:, k]] for k in range(3))
    double = np.cross(b - a, c - a)
    size = np.linalg.norm(double, axis=1)[:, None]
    normal = double / size
    weighted = size[:, :, None] * normal[:, :, None] * normal[:, None, :]
    tree, axis = KDTree(middle), np.zeros_like(normal)
    left, count = np.arange(len(faces)), min(_FEWEST, len(faces))
    while len(left):
        still = []
        for part in np.array_split(left, -(-9 * count * len(left) // _MOST)):
            near = tree.query(middle[part], count)[1].reshape(len(part), count)
            values, vectors = np.linalg.eigh(weighted[near].sum(axis=1))
            done = (values[:, 1] >= _TURNED * values[:, 2]) | (count == len(faces))
            axis[part[done]] = vectors[done, :, 0]
            still.append(part[~done])
        left, count = np.concatenate(still), min(2 * count, len(faces))
    axis -= np.sum(axis * normal, axis=1)[:, None] * normal
    length = np.linalg.norm(axis, axis=1)[:, None]
    return normal, axis / np.where(length > 0.0, length, 1.0)
