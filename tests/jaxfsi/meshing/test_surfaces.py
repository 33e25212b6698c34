"""Projection of surfaces, and places where they cut themselves."""

import numpy as np
import pytest

from jaxfsi.anatomy.surfaces.crossings import crossing_faces
from jaxfsi.measures import triangle_normals
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import (
    balance,
    gradients,
    guarded_move,
    project,
    triangle_qualities,
)


def grid(n: int = 12, size: float = 1.0) -> Surface:
    """Square sheet in the xy plane, normals up."""
    u = np.linspace(-size, size, n)
    x, y = np.meshgrid(u, u, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij")
    a = (i * n + j).ravel()
    return Surface(
        points,
        np.concatenate([np.stack([a, a + n, a + n + 1], 1), np.stack([a, a + n + 1, a + 1], 1)]),
    )


def dome(x: np.ndarray) -> np.ndarray:
    return np.linalg.norm(x + np.array([0.0, 0.0, 6.0]), axis=1) - 6.1


def test_gradient_is_exact_for_a_quadratic():
    x = np.random.default_rng(0).normal(size=(20, 3))
    slope = gradients(lambda y: (y**2) @ np.array([1.0, 2.0, 3.0]), x, step=1e-3)
    # Central differences are exact for quadratics; round-off 1e-16/1e-3 remains.
    np.testing.assert_allclose(slope, 2.0 * x * np.array([1.0, 2.0, 3.0]), atol=1e-10)


def test_projection_reaches_the_surface_and_keeps_triangles():
    sheet = grid()
    moved = project(sheet, dome)
    # Newton on a distance converges to round-off; the guard never acts on so smooth a shift.
    np.testing.assert_allclose(dome(moved.points), 0.0, atol=1e-9)
    assert triangle_qualities(*moved).min() > 0.8 * triangle_qualities(*sheet).min()


def test_projection_holds_vertices_in_their_planes():
    sheet = grid()
    normals = np.zeros_like(sheet.points)
    edge = np.isclose(sheet.points[:, 0], 1.0)
    normals[edge] = [1.0, 0.0, 0.0]
    moved = project(sheet, dome, plane_normals=normals)
    np.testing.assert_allclose(moved.points[edge, 0], 1.0, atol=1e-14)
    np.testing.assert_allclose(dome(moved.points[edge]), 0.0, atol=1e-8)


@pytest.mark.parametrize("rings", [12, 16])
def test_balanced_tube_encloses_the_volume_of_the_cylinder(rings):
    def cylinder(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x[:, :2], axis=1) - 1.0

    theta, z = np.linspace(0.0, 2.0 * np.pi, rings + 1)[:-1], np.linspace(-1.0, 1.0, 5)
    t, h = (x.ravel() for x in np.meshgrid(theta, z, indexing="ij"))
    points = np.stack([np.cos(t), np.sin(t), h], axis=1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rings), np.arange(4), indexing="ij"))
    a, b = 5 * i + j, 5 * ((i + 1) % rings) + j
    triangles = np.concatenate([np.stack([a, b, b + 1], 1), np.stack([a, b + 1, a + 1], 1)])
    planes = np.where(np.abs(points[:, 2:]) == 1.0, [[0.0, 0.0, 1.0]], 0.0)
    moved = balance(Surface(points, triangles), cylinder, plane_normals=planes)
    np.testing.assert_allclose(np.abs(moved.points[planes[:, 2] > 0.0, 2]), 1.0, atol=1e-14)

    def area(x: np.ndarray) -> float:
        middle = x[x[:, 2] == 0.0]
        return 0.5 * rings * np.sin(2.0 * np.pi / rings) * float(np.sum(middle[0, :2] ** 2))

    # Inscribed polygons lose 6.6/n². Moved by the mean of f they miss by terms of fourth order,
    # 0.1 (2π/n)⁴: the chord's gap varies within an edge and so acts with its square.
    assert 1.0 - area(points) / np.pi > 0.9 * 6.6 / rings**2
    assert abs(area(moved.points) / np.pi - 1.0) < 0.1 * (2.0 * np.pi / rings) ** 4


def test_moves_that_would_turn_triangles_are_cut():
    sheet = grid()
    move = np.zeros_like(sheet.points)
    move[5 * 12 + 5] = [1.0, 0.0, 0.0]  # five cells to the side
    moved = guarded_move(sheet.points, sheet.triangles, move)
    assert np.all(triangle_normals(moved, sheet.triangles)[:, 2] > 0.0)
    small = guarded_move(sheet.points, sheet.triangles, 0.01 * move)
    np.testing.assert_allclose(small, sheet.points + 0.01 * move, atol=0.0)


def test_equilateral_triangle_has_quality_one():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])
    quality = triangle_qualities(points, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(quality, 1.0, rtol=1e-14)  # round-off


@pytest.mark.parametrize(("height", "crosses"), [(0.05, True), (0.6, False)])
def test_sheets_that_cut_each_other_are_found(height, crosses):
    flat = grid()
    tilted = flat.points @ np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    points = np.concatenate([flat.points, tilted + np.array([0.013, 0.021, height])])
    triangles = np.concatenate([flat.triangles, flat.triangles + len(flat.points)])
    found = np.unique(crossing_faces(points, triangles)[:, 1])
    assert bool(len(found)) == crosses
    if crosses:
        # The sheets meet at x = −height/0.3; triangles there are 0.18 wide.
        x = points[triangles[found]].mean(axis=1)[:, 0]
        assert np.abs(x + height / 0.3 - 0.013).max() < 0.2


def test_sheet_alone_does_not_cut_itself():
    assert len(crossing_faces(*project(grid(), dome))) == 0
