"""Signed distance to a closed triangulated surface.

The nearest point of a triangle is found by regions (Ericson 2005, "Real-Time Collision Detection",
5.1.5), the nearest triangle among those whose centroids are nearest (KD-tree). The sign is that of
(x − c)·n with n the normal of the feature on which the nearest point c lies: the face, the edge
(sum of its two face normals) or the corner (face normals weighted by angle), which is the right
sign for every closed manifold (Bærentzen & Aanæs 2005, IEEE TVCG 11:243).
"""

import dataclasses
from typing import NamedTuple

import numpy as np
import scipy.spatial
from jaxtyping import Bool, Float, Int

from jaxfsi.anatomy.surfaces.triangles import (
    Triangles,
    edges_of,
    neighbours,
    unit,
    vertex_normals,
)
from jaxfsi.measures import triangle_normals

_CANDIDATES = (10, 60)
_CHUNK = 40_000


@dataclasses.dataclass(frozen=True)
class SurfaceDistance:
    """A surface made ready for distances.

    Attributes:
        surface: triangles of similar size, closed where signs are wanted.
        tree: over the centroids of the triangles.
        reach: distance of the farthest corner of each triangle from its centroid [cm].
        face_normal: unit normals of the triangles.
        edge_normal: sum of the normals at the edge from corner i to i + 1 of each triangle.
        point_normal: angle-weighted normals of the points.
    """

    surface: Triangles
    tree: scipy.spatial.KDTree
    reach: Float[np.ndarray, " faces"]
    face_normal: Float[np.ndarray, "faces 3"]
    edge_normal: Float[np.ndarray, "faces 3 3"]
    point_normal: Float[np.ndarray, "points 3"]


class Nearest(NamedTuple):
    """The nearest point of a surface.

    Attributes:
        distance: signed by the side [cm], negative inside.
        face: the triangle it lies on.
        weights: of the corners of that triangle at it.
    """

    distance: Float[np.ndarray, " points"]
    face: Int[np.ndarray, " points"]
    weights: Float[np.ndarray, "points 3"]


def surface_distance(surface: Triangles) -> SurfaceDistance:
    """Prepare a surface for `nearest`."""
    corners = surface.points[surface.faces]
    centroid = corners.mean(axis=1)
    reach = np.max(np.linalg.norm(corners - centroid[:, None], axis=2), axis=1)
    normal = unit(triangle_normals(*surface))
    edge_normal = np.repeat(normal[:, None], 3, axis=1)
    pairs, corner = neighbours(edges_of(surface.faces))
    for i in (0, 1):
        edge_normal[pairs[:, i], corner[:, i]] += normal[pairs[:, 1 - i]]
    return SurfaceDistance(
        surface,
        scipy.spatial.KDTree(centroid),
        reach,
        normal,
        edge_normal,
        vertex_normals(surface),
    )


def _ratio(
    numerator: Float[np.ndarray, " n"], denominator: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    safe = np.abs(denominator) > 0.0
    return np.where(safe, numerator / np.where(safe, denominator, 1.0), 0.0)


def closest_weights(
    x: Float[np.ndarray, "n 3"],
    a: Float[np.ndarray, "n 3"],
    b: Float[np.ndarray, "n 3"],
    c: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    """Barycentric weights of the point of each triangle abc that is nearest to x.

    Weights that belong to the far side of an edge or a corner are exactly zero.
    """
    ab, ac = b - a, c - a
    d1, d2 = (np.einsum("ij,ij->i", e, x - a) for e in (ab, ac))
    d3, d4 = (np.einsum("ij,ij->i", e, x - b) for e in (ab, ac))
    d5, d6 = (np.einsum("ij,ij->i", e, x - c) for e in (ab, ac))
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    total = va + vb + vc
    v, w = _ratio(vb, total), _ratio(vc, total)
    on_ab = _ratio(d1, d1 - d3)
    on_ac = _ratio(d2, d2 - d6)
    on_bc = _ratio(d4 - d3, (d4 - d3) + (d5 - d6))
    zero, one = np.zeros_like(v), np.ones_like(v)
    cases = [
        ((d1 <= 0.0) & (d2 <= 0.0), (one, zero, zero)),
        ((d3 >= 0.0) & (d4 <= d3), (zero, one, zero)),
        ((d6 >= 0.0) & (d5 <= d6), (zero, zero, one)),
        ((vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0), (one - on_ab, on_ab, zero)),
        ((vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0), (one - on_ac, zero, on_ac)),
        ((va <= 0.0) & (d4 >= d3) & (d5 >= d6), (zero, one - on_bc, on_bc)),
    ]
    conditions = [condition for condition, _ in cases]
    inside = (one - v - w, v, w)
    return np.stack(
        [np.select(conditions, [value[i] for _, value in cases], inside[i]) for i in range(3)],
        axis=1,
    )


def _best(
    ready: SurfaceDistance, x: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    n, k = faces.shape
    corners = ready.surface.points[ready.surface.faces[faces.ravel()]]
    repeated = np.repeat(x, k, axis=0)
    weights = closest_weights(repeated, corners[:, 0], corners[:, 1], corners[:, 2])
    offset = repeated - np.einsum("ni,nij->nj", weights, corners)
    squared = np.einsum("ij,ij->i", offset, offset).reshape(n, k)
    best = np.argmin(squared, axis=1)
    rows = np.arange(n)
    return (
        np.sqrt(squared[rows, best]),
        faces[rows, best],
        weights.reshape(n, k, 3)[rows, best],
    )


def _nearest(
    ready: SurfaceDistance, x: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    n_faces = len(ready.surface.faces)
    few, many = (min(k, n_faces) for k in _CANDIDATES)
    far, faces = ready.tree.query(x, k=few)
    far, faces = far.reshape(len(x), few), faces.reshape(len(x), few)
    distance, face, weights = _best(ready, x, faces)
    if few == n_faces:
        return distance, face, weights
    # On a flat patch the candidates fill a disc about the foot; a triangle outside this disc can
    # only be nearer where the disc is narrower than a triangle reaches.
    disc = np.sqrt(np.maximum(far[:, -1] ** 2 - distance**2, 0.0))
    again = np.flatnonzero(disc < np.max(ready.reach[faces], axis=1))
    if len(again):
        _, faces = ready.tree.query(x[again], k=many)
        found = _best(ready, x[again], faces.reshape(len(again), many))
        distance[again], face[again], weights[again] = found
    return distance, face, weights


def _feature_normal(
    ready: SurfaceDistance,
    face: Int[np.ndarray, " n"],
    weights: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    zero: Bool[np.ndarray, "n 3"] = weights == 0.0
    count = np.sum(zero, axis=1)
    normal = ready.face_normal[face]
    on_edge = np.flatnonzero(count == 1)
    opposite = np.argmax(zero[on_edge], axis=1)
    normal[on_edge] = ready.edge_normal[face[on_edge], (opposite + 1) % 3]
    at_corner = np.flatnonzero(count == 2)
    corner = np.argmin(zero[at_corner], axis=1)
    normal[at_corner] = ready.point_normal[ready.surface.faces[face[at_corner], corner]]
    return normal


def nearest(ready: SurfaceDistance, points: Float[np.ndarray, "points 3"]) -> Nearest:
    """Signed distance to a surface and where it is taken.

    Args:
        ready: closed surface; on an open one the sign means nothing, the size does.
        points: positions [cm].
    """
    n = len(points)
    distance, face, weights = np.empty(n), np.empty(n, dtype=np.int64), np.empty((n, 3))
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        x = points[part]
        size, f, w = _nearest(ready, x)
        foot = np.einsum("ni,nij->nj", w, ready.surface.points[ready.surface.faces[f]])
        side = np.einsum("ij,ij->i", x - foot, _feature_normal(ready, f, w))
        distance[part], face[part], weights[part] = np.where(side < 0.0, -size, size), f, w
    return Nearest(distance, face, weights)
