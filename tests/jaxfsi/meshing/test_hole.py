"""Triangles over holes between ends of columns, and angles that leave no room for tetrahedra."""

import numpy as np
import pytest

from jaxfsi.faces import triangle_edges, unique_rows
from jaxfsi.measures import triangle_areas
from jaxfsi.meshing.columns.corners import at_sharp_corners
from jaxfsi.meshing.columns.hole import joined, least_triangulation

NO_EDGES = np.zeros((0, 2), dtype=np.int64)


def ring(radius: float, n: int, *, turn: float = 0.0) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(n) / n + turn
    return radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)


def upwards(points: np.ndarray) -> np.ndarray:
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def area_within(radius: float, n: int) -> float:
    return 0.5 * n * radius**2 * np.sin(2.0 * np.pi / n)


def test_polygon_is_covered_once_and_faces_outwards():
    points = np.array([[0, 0], [2, 0], [2, 1], [1, 0.4], [0, 1], [-1, 0.5]], dtype=float)
    points = np.concatenate([points, np.zeros((6, 1))], axis=1)
    found = least_triangulation(np.arange(6), points, upwards(points), lambda x: x[:, 2], NO_EDGES)
    assert len(found) == 4
    sides = points[found][:, 1:] - points[found][:, :1]
    assert np.all(np.cross(sides[:, 0], sides[:, 1])[:, 2] > 0.0)
    x, y = points[:, 0], points[:, 1]
    shoelace = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert triangle_areas(points, found).sum() == pytest.approx(shoelace)


def test_diagonal_is_the_short_one_unless_an_edge_is_there_already():
    points = np.array([[0, 0, 0], [1, 0, 0], [1.2, 1, 0], [0, 1, 0]], dtype=float)

    def diagonal(taken: np.ndarray) -> set[int]:
        arguments = np.arange(4), points, upwards(points), lambda x: x[:, 2], taken
        edges = np.sort(triangle_edges(least_triangulation(*arguments)).reshape(-1, 2), axis=1)
        used, count = np.unique(edges, axis=0, return_counts=True)
        return set(used[count == 2][0].tolist())

    assert diagonal(NO_EDGES) == {1, 3}
    assert diagonal(np.array([[3, 1]])) == {0, 2}


def test_edges_follow_the_surface_rather_than_cut_through_it():
    # A square bent about its diagonal from the second to the last vertex, which is the longer one.
    points = np.array([[0, 0, 0], [1, 0, 0.3], [1, 1, 0], [0, 1, 0.3]], dtype=float)
    points[[1, 3], :2] += [[0.05, -0.05], [-0.05, 0.05]]
    found = least_triangulation(
        np.arange(4), points, upwards(points), lambda x: x[:, 2] - 0.3, NO_EDGES
    )
    assert len(found) == 2
    assert all({1, 3} <= set(row) for row in found.tolist())


def test_two_borders_make_an_annulus():
    outer, inner = ring(1.0, 24), ring(0.7, 18, turn=0.1)
    points = np.concatenate([outer, inner])
    polygon = joined(points, [np.arange(24), (24 + np.arange(18))[::-1]])
    assert len(polygon) == 24 + 18 + 2
    found = least_triangulation(polygon, points, upwards(points), lambda x: x[:, 2], NO_EDGES)
    edges, which = unique_rows(np.sort(triangle_edges(found).reshape(-1, 2), axis=1))
    count = np.bincount(which)
    assert np.sum(count == 1) == 24 + 18
    assert count.max() == 2
    assert len(points) - len(edges) + len(found) == 0  # Euler number of an annulus
    expected = area_within(1.0, 24) - area_within(0.7, 18)
    assert triangle_areas(points, found).sum() == pytest.approx(expected)


@pytest.mark.parametrize(("inside", "sharp"), [(20.0, True), (40.0, False), (340.0, False)])
def test_corners_are_sharp_by_the_angle_inside(inside, sharp):
    angle = np.radians(inside)
    # Two triangles at the x axis; what is to be filled lies between them, above the first.
    tip = [0.5, np.cos(angle), np.sin(angle)]
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], tip], dtype=float)
    triangles = np.array([[1, 0, 2], [0, 1, 3]])
    found = at_sharp_corners(points, triangles, least_deg=30.0)
    assert found.tolist() == ([0, 1, 2, 3] if sharp else [])
