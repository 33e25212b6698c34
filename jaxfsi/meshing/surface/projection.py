"""Vertices of a surface moved onto the zero set of a function, without spoiling triangles.

Newton's method along the gradient, x ← x − f ∇f / |∇f|², restricted to the plane of an opening
for the vertices on it. Steps of vertices whose triangles would degrade or turn are halved.

Flat triangles with their corners on a curved surface all lie on its inner side: a lumen would lose
the share 6.6/n² of its area where n edges go round it. Hence each vertex moves on by the mean of f
over the triangles round it, so that f is zero there on average and not at the vertex. One step
suffices: it leaves nothing of an error that varies slowly, and more steps would set neighbours
against each other where elements are large.
"""

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy.anatomy import PointFunction
from jaxfsi.faces import unique_rows
from jaxfsi.measures import triangle_areas, triangle_normals
from jaxfsi.meshing.surface.isosurface import Surface

_ITERATIONS = 4
_LONGEST_BALANCING = 0.1  # of the shortest edge at a vertex
_HALVINGS = 4
_WORST_QUALITY = 0.25
# A step that turns a triangle by more than this (cosine) is cut.
_LEAST_COSINE = 0.5


def gradients(
    f: PointFunction, x: Float[np.ndarray, "points 3"], *, step: float
) -> Float[np.ndarray, "points 3"]:
    """∇f by central differences of a given step [cm]."""
    offsets = step * np.concatenate([np.eye(3), -np.eye(3)])
    values = np.asarray(f((x[None] + offsets[:, None]).reshape(-1, 3))).reshape(6, -1)
    return ((values[:3] - values[3:]) / (2.0 * step)).T


def triangle_qualities(
    points: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, " triangles"]:
    """4√3 area / (sum of squared edges): 1 for equilateral triangles, 0 for slivers."""
    corners = points[triangles]
    sides = corners - corners[:, [1, 2, 0]]
    area = triangle_areas(points, triangles)
    return 4.0 * np.sqrt(3.0) * area / np.maximum(np.sum(sides**2, axis=(1, 2)), 1e-300)


def project(
    surface: Surface,
    f: PointFunction,
    *,
    plane_normals: Float[np.ndarray, "points 3"] | None = None,
    step: float = 1e-3,
) -> Surface:
    """Move the vertices of a surface onto f = 0.

    Args:
        surface: what is moved.
        f: approximate distance [cm].
        plane_normals: unit normals of the planes in which vertices have to stay; zero where a
            vertex is free.
        step: of the differences for ∇f [cm].
    """
    points, triangles = surface
    shortest = _shortest_edges(points, triangles)
    for _ in range(_ITERATIONS):
        slope = gradients(f, points, step=step)
        if plane_normals is not None:
            slope -= np.einsum("pk,pk->p", slope, plane_normals)[:, None] * plane_normals
        square = np.maximum(np.einsum("pk,pk->p", slope, slope), 1e-2)
        move = -(np.asarray(f(points)) / square)[:, None] * slope
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, 0.3 * shortest / np.maximum(length, 1e-300))[:, None]
        points = guarded_move(points, triangles, move)
    return Surface(points, triangles)


def balance(
    surface: Surface,
    f: PointFunction,
    *,
    plane_normals: Float[np.ndarray, "points 3"] | None = None,
    step: float = 1e-3,
) -> Surface:
    """Move the vertices of a surface on which f = 0 so that f vanishes on average round each.

    Args:
        surface: vertices on f = 0, see `project`.
        f: approximate distance [cm].
        plane_normals: unit normals of the planes in which vertices have to stay; zero where a
            vertex is free.
        step: of the differences for ∇f [cm].
    """
    points, triangles = surface
    slope = gradients(f, points, step=step)
    if plane_normals is not None:
        slope -= np.einsum("pk,pk->p", slope, plane_normals)[:, None] * plane_normals
    square = np.maximum(np.einsum("pk,pk->p", slope, slope), 1e-2)
    longest = _LONGEST_BALANCING * _shortest_edges(points, triangles)
    way = -_mean_round_vertices(f, points, triangles) / np.sqrt(square)
    way = np.clip(way, -longest, longest) / np.sqrt(square)
    return Surface(guarded_move(points, triangles, way[:, None] * slope), triangles)


def _mean_round_vertices(
    f: PointFunction,
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
) -> Float[np.ndarray, " points"]:
    """Mean of f over the triangles at each vertex, by the midpoints of edges (exact to x²)."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, which = unique_rows(edges)
    value = np.asarray(f(points[edges].mean(axis=1)))[which].reshape(-1, 3).mean(axis=1)
    area = np.linalg.norm(triangle_normals(points, triangles), axis=1)
    corners, count = triangles.ravel(), len(points)
    total = np.bincount(corners, np.repeat(area * value, 3), minlength=count)
    return total / np.maximum(np.bincount(corners, np.repeat(area, 3), minlength=count), 1e-300)


def guarded_move(
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    move: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points 3"]:
    """Move vertices, by less or not at all where a triangle would degrade or turn."""
    old_normals = triangle_normals(points, triangles)
    floor = np.minimum(_WORST_QUALITY, 0.9 * triangle_qualities(points, triangles))
    share = np.ones(len(points))
    for halving in range(_HALVINGS + 1):
        moved = points + share[:, None] * move
        normals = triangle_normals(moved, triangles)
        sizes = np.linalg.norm(normals, axis=1) * np.linalg.norm(old_normals, axis=1)
        turned = np.einsum("tk,tk->t", normals, old_normals) < _LEAST_COSINE * sizes
        bad = turned | (triangle_qualities(moved, triangles) < floor)
        if not bad.any():
            break
        share[triangles[bad].ravel()] *= 0.5 if halving < _HALVINGS - 1 else 0.0
    return points + share[:, None] * move


def _shortest_edges(
    points: Float[np.ndarray, "points 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, " points"]:
    corners = points[triangles]
    length = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).min(axis=1)
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, triangles.ravel(), np.repeat(length, 3))
    return np.where(np.isfinite(shortest), shortest, 0.0)
