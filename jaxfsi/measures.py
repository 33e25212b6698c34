"""Lengths of edges, normals and areas of triangles, and the volume within a closed surface."""

import numpy as np
from jaxtyping import Float, Int


def edge_lengths(
    points: Float[np.ndarray, "nodes 3"], edges: Int[np.ndarray, "edges 2"]
) -> Float[np.ndarray, " edges"]:
    """Length of each edge [cm]."""
    return np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)


def triangle_normals(
    points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3"]:
    """Normals of the triangles, twice their area long [cm²]."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def triangle_areas(
    points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " faces"]:
    """Area of each triangle [cm²]."""
    return np.linalg.norm(triangle_normals(points, faces), axis=1) / 2.0


def enclosed_volume(
    points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> float:
    """Volume inside outward triangles [cm³], ⅙ Σ det(a, b, c) about a point among them.

    It is negative where the surface is inside out.
    """
    if len(faces) == 0:
        return 0.0
    a, b, c = (points[faces[:, i]] - points[faces[0, 0]] for i in range(3))
    return float(np.einsum("ij,ij->", np.cross(a, b), c)) / 6.0
