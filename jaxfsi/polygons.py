"""Closed polygons of the plane, in NumPy: area, centroid, what lies inside.

`jaxfsi.lumen` has areas and perimeters that can be differentiated.
"""

import numpy as np
from jaxtyping import Bool, Float


def _edges(
    polygons: Float[np.ndarray, "polygons points 2"],
) -> tuple[Float[np.ndarray, "polygons points 2"], Float[np.ndarray, "polygons points"]]:
    """Sums of the ends of each edge, and their cross product, about the first point."""
    points = polygons - polygons[:, :1]  # the sums do not cancel when a polygon lies far out
    following = np.roll(points, -1, axis=1)
    cross = points[..., 0] * following[..., 1] - points[..., 1] * following[..., 0]
    return points + following, cross


def polygon_areas(
    polygons: Float[np.ndarray, "polygons points 2"],
) -> Float[np.ndarray, " polygons"]:
    """Signed area of each polygon, positive where it runs anticlockwise (shoelace formula)."""
    return np.sum(_edges(polygons)[1], axis=1) / 2.0


def polygon_centroids(
    polygons: Float[np.ndarray, "polygons points 2"],
) -> Float[np.ndarray, "polygons 2"]:
    """Centroid of the area of each polygon."""
    ends, cross = _edges(polygons)
    weighted = np.sum(ends * cross[..., None], axis=1)
    return polygons[:, 0] + weighted / (3.0 * np.sum(cross, axis=1))[:, None]


def inside_polygon(
    points: Float[np.ndarray, "points 2"], polygon: Float[np.ndarray, "corners 2"]
) -> Bool[np.ndarray, " points"]:
    """Which points lie in a polygon: a ray from them crosses its sides an odd number of times."""
    p, q = polygon, np.roll(polygon, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (p[:, 1] > y) != (q[:, 1] > y)
    slope = np.where(spans, (q[:, 0] - p[:, 0]) / np.where(spans, q[:, 1] - p[:, 1], 1.0), 0.0)
    return np.sum(spans & (x < p[:, 0] + slope * (y - p[:, 1])), axis=1) % 2 == 1
