"""Angles between neighbouring triangles of a surface, seen from inside."""

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.faces import triangle_edges
from jaxfsi.measures import triangle_normals


def at_sharp_corners(
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    *,
    least_deg: float,
) -> Int[np.ndarray, " vertices"]:
    """Vertices of pairs of triangles between which too little room is left for tetrahedra.

    Args:
        points: vertices [cm].
        triangles: normals out of what is to be filled; edges with one triangle count for nothing.
        least_deg: smallest angle between two neighbours, measured inside [degrees].
    """
    edges = np.sort(triangle_edges(triangles).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T[::-1])
    edges, owner = edges[order], order // 3
    twice = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    first, second = owner[twice], owner[twice + 1]
    normals = triangle_normals(points, triangles)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    centre = points[triangles].mean(axis=1)
    towards = np.einsum("ek,ek->e", normals[first], centre[second] - centre[first])
    cosine = np.clip(np.einsum("ek,ek->e", normals[first], normals[second]), -1.0, 1.0)
    # Neighbours that face each other have normals that point away from each other.
    sharp = (towards < 0.0) & (180.0 - np.degrees(np.arccos(cosine)) < least_deg)
    return np.unique(triangles[np.concatenate([first[sharp], second[sharp]])])
