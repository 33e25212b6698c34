import numpy as np
import pytest
import scipy.spatial

from jaxfsi.anatomy import (
    Curve,
    curve_through,
    elliptic_contours,
    polar_contours,
    smooth_minimum,
    surface_points,
    tube,
    tube_foot,
)
from tests.jaxfsi.anatomy.sampling import grid_values


def _straight(length: float = 2.0, spacing: float = 0.05) -> Curve:
    return curve_through(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]), spacing)


def _points(low: list[float], high: list[float], n: int = 3000) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, (n, 3))


def _planar(curve: Curve, points: np.ndarray) -> np.ndarray:
    offset = points - curve.points[0]
    return np.stack([offset @ curve.normal[0], offset @ curve.binormal[0]], axis=1)


def _volume_error(n_angles: int, half_u: float, half_v: float) -> float:
    curve = _straight()
    ones = np.ones_like(curve.s)
    vessel = tube(curve, elliptic_contours(half_u * ones, half_v * ones, n_angles))
    theta = np.linspace(0.0, 2.0 * np.pi, 4001)[:-1]
    surface, _ = surface_points(vessel, np.full(4000, 1.0), theta)
    x, y = _planar(curve, surface).T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return abs(area / (np.pi * half_u * half_v) - 1.0)


def test_distance_to_a_round_vessel_is_exact() -> None:
    curve = _straight()
    vessel = tube(curve, elliptic_contours(*(2 * [np.full_like(curve.s, 0.2)]), 32))
    points = _points([-0.5, -0.5, 0.4], [0.5, 0.5, 1.6])
    expected = np.linalg.norm(points[:, :2], axis=1) - 0.2
    # A periodic cubic spline through n points of a circle misses it by R (2π/n)⁴/384 = 8e-7.
    np.testing.assert_allclose(tube_foot(vessel, points).distance, expected, atol=2e-6)


@pytest.mark.parametrize("ellipticity", [1.5, 3.0, 5.0])
def test_distance_to_an_elliptic_vessel_matches_a_dense_search(ellipticity: float) -> None:
    curve = _straight()
    ones = np.ones_like(curve.s)
    vessel = tube(curve, elliptic_contours(0.25 * ones, 0.25 / ellipticity * ones, 48))
    points = _points([-0.45, -0.45, 0.6], [0.45, 0.45, 1.4])
    phi = np.linspace(0.0, 2.0 * np.pi, 40_001)
    ellipse = 0.25 * np.stack([np.cos(phi), np.sin(phi) / ellipticity], axis=1)
    flat = _planar(curve, points)
    expected = scipy.spatial.KDTree(ellipse).query(flat)[0]
    inside = (flat[:, 0] / 0.25) ** 2 + (flat[:, 1] * ellipticity / 0.25) ** 2 < 1.0
    expected[inside] *= -1.0
    # Dense search: the foot is off by up to 2e-5, the distance by 4e-10/(2 d) or 2e-5 at d = 0.
    np.testing.assert_allclose(tube_foot(vessel, points).distance, expected, atol=2e-5)


def test_section_area_converges_with_the_number_of_points() -> None:
    errors = [_volume_error(n, 0.3, 0.1) for n in (8, 16, 32)]
    # Periodic cubic spline of a trigonometric function: order 4.
    assert np.all(np.diff(np.log2(errors)) < -3.8)


def test_distance_to_a_tapering_vessel_counts_its_slope() -> None:
    curve = _straight(2.0)
    radius = 0.2 + 0.1 * curve.s
    vessel = tube(curve, elliptic_contours(radius, radius, 40))
    points = _points([-0.5, -0.5, 0.8], [0.5, 0.5, 1.2])
    expected = (np.linalg.norm(points[:, :2], axis=1) - 0.2 - 0.1 * points[:, 2]) / np.hypot(1, 0.1)
    found = tube_foot(vessel, points).distance
    near = expected > -0.2  # the axis is equally far from all sides
    np.testing.assert_allclose(found[near], expected[near], atol=2e-6)


def test_distance_to_a_bent_vessel_is_that_of_a_torus() -> None:
    phi = np.linspace(0.0, 2.0, 81)
    arc = np.stack([np.cos(phi), np.sin(phi), 0.0 * phi], axis=1)
    curve = curve_through(arc, 0.04)
    vessel = tube(curve, elliptic_contours(*(2 * [np.full_like(curve.s, 0.2)]), 32))
    points = _points([0.0, 0.4, -0.4], [1.3, 0.9, 0.4])
    expected = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.2
    # Both splines are of fourth order; the axis' end conditions leave 1e-5 in the middle.
    np.testing.assert_allclose(tube_foot(vessel, points).distance, expected, atol=2e-5)


def test_star_shaped_and_elliptic_contours_agree() -> None:
    curve = _straight()
    theta = 2.0 * np.pi * np.arange(160) / 160
    radius = 0.2 * 0.1 / np.hypot(0.1 * np.cos(theta), 0.2 * np.sin(theta))
    star = tube(curve, polar_contours(np.broadcast_to(radius, (len(curve.s), 160))))
    ones = np.ones_like(curve.s)
    ellipse = tube(curve, elliptic_contours(0.2 * ones, 0.1 * ones, 64))
    points = _points([-0.4, -0.4, 0.6], [0.4, 0.4, 1.4])
    # The spline of the radius at even angles is the coarser: 2e-6 at the narrow ends.
    np.testing.assert_allclose(
        tube_foot(star, points).distance, tube_foot(ellipse, points).distance, atol=1e-5
    )


def test_foot_names_place_and_normal() -> None:
    curve = _straight()
    ones = np.ones_like(curve.s)
    vessel = tube(curve, elliptic_contours(0.2 * ones, 0.1 * ones, 40))
    s, angle = np.array([0.7, 1.2]), np.array([1.0, 4.0])
    surface, normal = surface_points(vessel, s, angle)
    foot = tube_foot(vessel, surface + 0.05 * normal)
    np.testing.assert_allclose(foot.distance, 0.05, atol=1e-8)
    # The place is found to a thousandth of a cell (1/1000 · 2π/40 and 1/1000 · 0.05).
    np.testing.assert_allclose(foot.s, s, atol=5e-5)
    np.testing.assert_allclose(foot.angle, angle, atol=2e-4)


def test_ends_are_flat_and_closed() -> None:
    curve = _straight()
    vessel = tube(curve, elliptic_contours(*(2 * [np.full_like(curve.s, 0.2)]), 32))
    points = np.array([[0.0, 0.0, -0.1], [0.05, 0.0, 0.02], [0.0, 0.1, 2.3], [0.0, 0.0, 1.95]])
    np.testing.assert_allclose(
        tube_foot(vessel, points).distance, [0.1, -0.02, 0.3, -0.05], atol=1e-9
    )


def test_volume_of_a_closed_vessel() -> None:
    curve = _straight()
    ones = np.ones_like(curve.s)
    vessel = tube(curve, elliptic_contours(0.3 * ones, 0.15 * ones, 40))
    box = np.array([[-0.5, -0.5, -0.2], [0.5, 0.5, 2.2]])
    errors = []
    for spacing in (0.05, 0.025):
        values = grid_values(lambda x: tube_foot(vessel, x).distance, box, spacing)
        share = np.clip(0.5 - values / spacing, 0.0, 1.0)
        errors.append(abs(share.sum() * spacing**3 / (np.pi * 0.3 * 0.15 * 2.0) - 1.0))
    # Share of a cell below a plane at distance f, clip(½ − f/h): second order in h/b = 1/3, 1/6.
    assert errors[0] < 0.02
    assert errors[1] < 0.005


def test_reach_bounds_the_distance_of_far_points() -> None:
    curve = _straight()
    vessel = tube(curve, elliptic_contours(*(2 * [np.full_like(curve.s, 0.2)]), 32))
    points = _points([-2.0, -2.0, -1.0], [2.0, 2.0, 3.0])
    exact = tube_foot(vessel, points).distance
    short = tube_foot(vessel, points, reach=0.5).distance
    near = exact < 0.5
    np.testing.assert_array_equal(short[near], exact[near])
    assert np.all(short[~near] >= 0.5)


def test_smooth_minimum_touches_only_where_values_are_close() -> None:
    a = np.linspace(-1.0, 1.0, 201)
    b = np.zeros(201)
    smooth = smooth_minimum(a, b, 0.4)
    apart = np.abs(a) >= 0.4
    np.testing.assert_array_equal(smooth[apart], np.minimum(a, b)[apart])
    assert np.min(smooth - np.minimum(a, b)) == pytest.approx(-0.1)
    # Continuous slope: differences of slopes are at most step/k.
    assert np.max(np.abs(np.diff(smooth, 2))) <= 0.01**2 / (2 * 0.4) * 1.001
    np.testing.assert_array_equal(smooth_minimum(a, b, 0.0), np.minimum(a, b))


def test_two_parallel_surfaces_stay_apart_when_the_blend_is_below_twice_the_gap() -> None:
    a = np.linspace(-0.02, 0.08, 101)
    b = 0.06 - a  # two lumens 0.06 apart
    assert np.max(smooth_minimum(a, b, 0.1)) > 0.0
    assert np.max(smooth_minimum(a, b, 0.13)) < 0.0
    surface = smooth_minimum(np.zeros(1), np.array([0.06]), 0.06)
    assert surface[0] == 0.0


def test_wrong_contours_are_refused() -> None:
    curve = _straight()
    ones = np.ones_like(curve.s)
    with pytest.raises(ValueError, match="Resample one of them"):
        tube(curve, elliptic_contours(ones[:-1], ones[:-1], 16))
    with pytest.raises(ValueError, match="runs clockwise"):
        tube(curve, elliptic_contours(ones, -ones, 16))
