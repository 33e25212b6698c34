"""Areas, centroids and insides of polygons against figures of regular and of star-shaped ones."""

import numpy as np
import pytest

from jaxfsi.polygons import inside_polygon, polygon_areas, polygon_centroids

FAR = np.array([3e5, -2e5])


def _regular(n, radius=1.0, centre=(0.0, 0.0)):
    t = 2.0 * np.pi * np.arange(n) / n
    return radius * np.stack([np.cos(t), np.sin(t)], axis=1) + np.asarray(centre)


@pytest.mark.parametrize("n", [3, 4, 7, 200])
def test_area_of_regular_polygons(n):
    shapes = np.stack([_regular(n), _regular(n, 2.0, FAR), _regular(n)[::-1]])
    unit = n / 2.0 * np.sin(2.0 * np.pi / n)
    # far out, coordinates of 3e5 keep 5e-11 of a radius
    np.testing.assert_allclose(polygon_areas(shapes), unit * np.array([1.0, 4.0, -1.0]), rtol=1e-9)
    np.testing.assert_allclose(polygon_centroids(shapes), [[0, 0], FAR, [0, 0]], atol=1e-9)


def test_centroid_of_a_right_angle():
    """Two rectangles of areas 3 and 1, with centroids (1.5, 0.5) and (0.5, 1.5)."""
    L = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]], float)
    np.testing.assert_allclose(polygon_areas(L[None]), [4.0])
    np.testing.assert_allclose(polygon_centroids(L[None]), [[1.25, 0.75]])


def test_points_of_a_star_lie_inside_where_its_radius_says():
    rng = np.random.default_rng(2)
    n = 24
    t = 2.0 * np.pi * np.arange(n) / n
    radius = np.where(np.arange(n) % 2 == 0, 1.0, 0.4)
    star = radius[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1)
    points = rng.uniform(-1.2, 1.2, (2000, 2))
    angle = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)
    k = (angle // (2.0 * np.pi / n)).astype(int) % n
    a, b = star[k], star[(k + 1) % n]
    # of the triangle (origin, a, b) those on the origin's side of ab
    side = (b - a)[:, 0] * (points - a)[:, 1] - (b - a)[:, 1] * (points - a)[:, 0]
    for polygon in (star, star[::-1]):
        np.testing.assert_array_equal(inside_polygon(points, polygon), side > 0.0)


def test_level_sides_and_corners_are_crossed_once():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    points = np.array([[0.5, 0.0], [-0.5, 0.0], [-0.5, 1.0], [0.5, 0.5], [1.5, 0.5]])
    np.testing.assert_array_equal(inside_polygon(points, square), [True, False, False, True, False])
