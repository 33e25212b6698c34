"""Shape of tetrahedra: dihedral angles, aspect ratio, scaled Jacobian.

With V the volume, A_i and n_i area and outward unit normal of face i, e_k the edges::

    dihedral angle   cos θ_ij = −n_i · n_j
    aspect ratio     √(2/3) max |e_k| / min_i (3 V / A_i)            (1 for a regular tetrahedron)
    scaled Jacobian  min over corners of √2 · 6 V / (|e_a| |e_b| |e_c|)    (1 for a regular one)

Source of the scaled Jacobian: Stimpson, Ernst, Knupp, Pébay & Thompson 2007, "The Verdict
geometric quality library", SAND2007-1751, section 6.11.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.mesh import tet_faces, tet_volumes

_FACE_PAIRS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


class TetQuality(NamedTuple):
    """Shape of each tetrahedron.

    Attributes:
        min_dihedral_deg: smallest angle between two faces [degrees]; 70.5 at best.
        max_dihedral_deg: largest angle between two faces [degrees].
        aspect_ratio: longest edge over smallest height, over that of a regular tetrahedron.
        scaled_jacobian: 1 for a regular tetrahedron, 0 for a flat and negative for an inverted
            one.
    """

    min_dihedral_deg: Float[np.ndarray, " tets"]
    max_dihedral_deg: Float[np.ndarray, " tets"]
    aspect_ratio: Float[np.ndarray, " tets"]
    scaled_jacobian: Float[np.ndarray, " tets"]


def tet_quality(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> TetQuality:
    """Shape of each tetrahedron; a flat one has an infinite aspect ratio.

    Args:
        points: node positions [cm].
        tets: nodes of each tetrahedron.
    """
    volumes = tet_volumes(points, tets)
    corners = points[tets]
    lengths = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3)
    faces = points[tet_faces(tets)]
    vectors = np.cross(faces[:, :, 1] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 0])
    doubled = np.linalg.norm(vectors, axis=2)
    tiny = np.finfo(float).tiny
    normals = vectors / np.maximum(doubled, tiny)[:, :, None]
    cosines = -np.einsum(
        "tpi,tpi->tp", normals[:, _FACE_PAIRS[:, 0]], normals[:, _FACE_PAIRS[:, 1]]
    )
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    # Smallest height: 3 V over the largest face.
    largest = doubled.max(axis=1) / 2.0
    with np.errstate(divide="ignore", over="ignore"):
        aspect = np.sqrt(2.0 / 3.0) * lengths.max(axis=(1, 2)) * largest / (3.0 * np.abs(volumes))
    products = np.prod(np.stack([lengths[:, i][:, _OTHERS[i]] for i in range(4)], axis=1), axis=2)
    jacobian = np.sqrt(2.0) * 6.0 * volumes / np.maximum(products.max(axis=1), tiny)
    return TetQuality(angles.min(axis=1), angles.max(axis=1), aspect, jacobian)
