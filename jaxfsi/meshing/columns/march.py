"""Columns through the wall: from each vertex of the lumen to the outer surface.

A column is straight. It points along the mean of the normals of both surfaces at its ends,
smoothed over the lumen, and at the rim of an opening in the plane of the opening, towards which
neighbours turn. It is sound if it ends on the outer surface and the lumen that it left stays the
nearest one; in a septum and in the groove between two vessels it is not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxfsi.anatomy import Anatomy
from jaxfsi.meshing.surface.clipping import ClippedSurface, on_planes
from jaxfsi.meshing.surface.projection import gradients

_STEP = 1e-3  # of the differences for normals [cm]
_TRACES = 12
_ROUNDS = 2
_SMOOTHINGS = 3
# Columns turn into the plane of an opening nearer to it than this, over the thickness.
_TURNING = 1.5
# A column may be longer than the wall is thick by this.
_LONGEST = 2.5
# Distance of a column's end from the outer surface, over the thickness.
_MISS = 0.02
# Cosine between a column and the lumen's normal.
_LEAST_COSINE = 0.6
# Distance from the nearest lumen over the way from the own one.
_LEAST_AWAY = 0.7


class Columns(NamedTuple):
    """One column at each vertex of the lumen.

    Attributes:
        ends: where they meet the outer surface [cm].
        sound: whether they do so without coming near another lumen.
    """

    ends: Float[np.ndarray, "points 3"]
    sound: Bool[np.ndarray, " points"]


def march(lumen: ClippedSurface, anatomy: Anatomy) -> Columns:
    """Columns from all vertices of the lumen.

    Args:
        lumen: its surface between the openings, with normals out of the blood.
        anatomy: lumen and wall as functions.
    """
    points, triangles = lumen.surface
    thickness = np.asarray(anatomy.thickness(points), dtype=float)
    turned = _Planes(lumen, anatomy, thickness)
    normals = _unit(gradients(anatomy.lumen, points, step=_STEP))
    start = _unit(turned(normals))
    limit = 2.0 * _LONGEST * float(thickness.max())
    way = _traced(anatomy, points, start, limit)
    direction = start
    for _ in range(_ROUNDS):
        ends = points + way[:, None] * direction
        outer = _unit(turned(gradients(anatomy.wall, ends, step=_STEP)))
        direction = _unit(start + outer)
        for _ in range(_SMOOTHINGS):
            direction = _unit(turned(_smoothed(direction, triangles)))
        way = _traced(anatomy, points, direction, limit)
    ends = points + way[:, None] * direction
    half = points + 0.5 * way[:, None] * direction
    sound = (
        (np.abs(anatomy.wall(ends)) < _MISS * thickness)
        & (way > 0.0)
        & (way < _LONGEST * thickness)
        & (np.einsum("pk,pk->p", direction, normals) > _LEAST_COSINE)
        & (anatomy.lumen(ends) > _LEAST_AWAY * way)
        & (anatomy.lumen(half) > 0.5 * _LEAST_AWAY * way)
    )
    return Columns(ends, np.asarray(sound))


class _Planes:
    """Turns vectors towards the planes of the openings, and at their rims into them."""

    def __init__(
        self, lumen: ClippedSurface, anatomy: Anatomy, thickness: Float[np.ndarray, " points"]
    ):
        points = lumen.surface.points
        self.terms = []
        rims = on_planes(lumen, anatomy.openings)
        for opening in anatomy.openings:
            offset = points - opening.centre
            ball = np.linalg.norm(offset, axis=1) < opening.radius + _TURNING * thickness
            height = np.abs(offset @ opening.normal)
            share = np.where(ball, np.clip(1.0 - height / (_TURNING * thickness), 0.0, 1.0), 0.0)
            share[rims @ opening.normal > 1.0 - 1e-12] = 1.0
            self.terms.append((share, opening.normal))

    def __call__(self, vectors: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        for share, normal in self.terms:
            vectors = vectors - (share * (vectors @ normal))[:, None] * normal
        return vectors


def _traced(
    anatomy: Anatomy,
    points: Float[np.ndarray, "points 3"],
    direction: Float[np.ndarray, "points 3"],
    limit: float,
) -> Float[np.ndarray, " points"]:
    """Way along directions to the outer surface (sphere tracing, Hart 1996) [cm]."""
    way = np.zeros(len(points))
    for _ in range(_TRACES):
        way = np.clip(way - anatomy.wall(points + way[:, None] * direction), 0.0, limit)
    return way


def _smoothed(
    vectors: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "points 3"]:
    """Sum over the triangles at each vertex."""
    total = np.zeros_like(vectors)
    each = vectors[triangles].sum(axis=1)
    for corner in triangles.T:
        np.add.at(total, corner, each)
    return _unit(total)


def _unit(vectors: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
