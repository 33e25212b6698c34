"""Slivers of a surface made better by turning their longest edges."""

import numpy as np
from jaxtyping import Int

from jaxfsi.faces import triangle_edges
from jaxfsi.measures import triangle_normals
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import triangle_qualities

_SWEEPS = 6
# Cosine between the normal of a new triangle and that of the two old ones.
_LEAST_COSINE = 0.7


def flipped(surface: Surface, *, first: int, least_quality: float) -> Surface:
    """Turn edges between two triangles, worst triangles first, where the worse of the two gains.

    A sliver with a wide angle lies along its longest edge; the other diagonal of the two triangles
    there cuts that angle. The surface must not bend between them.

    Args:
        surface: no edge has more than two triangles.
        first: triangles before this one stay as they are.
        least_quality: triangles of less are slivers, see `triangle_qualities`.
    """
    points, triangles = surface.points, surface.triangles.copy()
    count = len(points)
    edges = triangle_edges(triangles).reshape(-1, 2).astype(np.int64)
    rows = np.repeat(np.arange(len(triangles)), 3)
    owner = dict(zip((edges @ (count, 1)).tolist(), rows.tolist(), strict=True))
    for _ in range(_SWEEPS):
        quality = triangle_qualities(points, triangles[first:])
        slivers = first + np.flatnonzero(quality < least_quality)
        turned = False
        for row in slivers[np.argsort(quality[slivers - first])]:
            a, b, c = _longest_first(points, triangles[row])
            other = owner.get(b * count + a, -1)
            if other < first:
                continue
            d = int(np.setdiff1d(triangles[other], [a, b])[0])
            if c * count + d in owner or d * count + c in owner:
                continue
            old, new = triangles[[row, other]], np.array([[a, d, c], [d, b, c]])
            if not _better(points, old, new):
                continue
            triangles[[row, other]] = new
            del owner[a * count + b], owner[b * count + a]
            for which, triangle in zip((int(row), other), new.tolist(), strict=True):
                for k in range(3):
                    owner[triangle[k] * count + triangle[k - 2]] = which
            turned = True
        if not turned:
            break
    return Surface(points, triangles)


def _longest_first(points: np.ndarray, triangle: Int[np.ndarray, "3"]) -> list[int]:
    """The vertices of a triangle, those of its longest edge first."""
    sides = points[triangle] - points[np.roll(triangle, -1)]
    return np.roll(triangle, -int(np.argmax(np.sum(sides**2, axis=1)))).tolist()


def _better(points: np.ndarray, old: Int[np.ndarray, "2 3"], new: Int[np.ndarray, "2 3"]) -> bool:
    """Whether two triangles are better than the two that they replace, and lie as these do."""
    if triangle_qualities(points, new).min() <= triangle_qualities(points, old).min():
        return False
    outwards = triangle_normals(points, old).sum(axis=0)
    normals = triangle_normals(points, new)
    size = np.linalg.norm(normals, axis=1) * np.linalg.norm(outwards)
    return bool(np.all(normals @ outwards > _LEAST_COSINE * size))
