"""Coordinates of the aortic wall, against a torus and a cone, and the aorta of the bundled CT."""

import dataclasses

import numpy as np
import pytest

from jaxfsi.anatomy import (
    AorticAxis,
    SizedLine,
    aortic_gap,
    at_arc_length,
    curve_through,
    fit_aorta,
    ivus_anatomy,
    measured_aorta,
    read_centerline,
    read_sized_line,
    tube_foot,
    wall_coordinates,
)
from jaxfsi.anatomy.sources.aortic_axis import aortic_tube, straight_axis, wall_points
from study import demo_case_path

BUNDLED = demo_case_path().parent
RADIUS = 1.4
BEND = 6.0
"""Radius of the bend of the aorta below [cm]."""


def arc(low: float = -0.6, high: float = 0.6, n: int = 200) -> np.ndarray:
    """Points of an arc in the plane y = 0 that passes the origin along z."""
    angle = np.linspace(low, high, n)
    return BEND * np.stack([1.0 - np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1)


@pytest.fixture(scope="module")
def bent() -> AorticAxis:
    axis = curve_through(arc(), 0.1)
    axis = dataclasses.replace(axis, s=axis.s - 0.6 * BEND)
    return AorticAxis(axis, np.full(len(axis.s), RADIUS))


@pytest.fixture
def points() -> np.ndarray:
    rng = np.random.default_rng(0)
    angle, turn = rng.uniform(-0.5, 0.5, 400), rng.uniform(0.0, 2.0 * np.pi, 400)
    away = rng.uniform(0.3, 2.5, 400)
    ring = BEND - away * np.cos(turn)
    x, z = BEND - ring * np.cos(angle), ring * np.sin(angle)
    return np.stack([x, away * np.sin(turn), z, away, BEND * angle], axis=1)


def test_gap_is_the_distance_from_a_torus(bent, points):
    # positions by cubic Hermite pieces, tangents linear between samples: (0.1/6)²/8 of 2.5 cm
    gap = aortic_gap(bent, points[:, :3])
    np.testing.assert_allclose(gap, points[:, 3] - RADIUS, atol=1e-4)
    rho, phi, z = wall_coordinates(bent, points[:, :3]).T
    np.testing.assert_allclose(z, points[:, 4], atol=1e-3)
    np.testing.assert_allclose(wall_points(bent, rho, phi, z), points[:, :3], atol=1e-8)


def test_gap_is_the_distance_from_a_cone(points):
    straight = straight_axis(RADIUS)
    slope = 0.2
    cone = dataclasses.replace(straight, radius=RADIUS + slope * straight.axis.s)
    near = points[:, :3] * [1.0, 1.0, 0.0]
    rho = np.hypot(near[:, 0], near[:, 1])
    expected = (rho - RADIUS) / np.sqrt(1.0 + slope**2)
    np.testing.assert_allclose(aortic_gap(cone, near), expected, atol=1e-12)


def test_tube_of_an_axis_has_its_gap(bent, points):
    lumen, radius = aortic_tube(bent, -3.0, 3.0)
    inner = points[np.abs(points[:, 4]) < 1.0]
    distance = tube_foot(lumen, inner[:, :3]).distance
    # the linear tangents between samples, as above
    np.testing.assert_allclose(distance, aortic_gap(bent, inner[:, :3]), atol=2e-4)
    np.testing.assert_array_equal(radius, RADIUS)


def test_axis_that_bends_inside_its_lumen_is_refused():
    axis = curve_through(0.2 * arc(-1.2, 1.2), 0.05)
    tight = AorticAxis(axis, np.full(len(axis.s), RADIUS))
    with pytest.raises(ValueError, match=r"bends with a radius of .* Smooth the line, or cut"):
        aortic_tube(tight, 0.5, 2.0)


def turned(points: np.ndarray) -> np.ndarray:
    """Points of aortic coordinates in another system, whose z is still nearly cranial."""
    c, s = np.cos(0.5), np.sin(0.5)
    return points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) + [1.0, -20.0, 175.0]


@pytest.mark.parametrize("order", [1, -1])
def test_coronary_is_placed_beside_the_aortas_own_line_in_either_direction(bent, order):
    phi = np.linspace(0.2, 1.6, 60)
    beside = wall_points(bent, np.full(60, RADIUS + 0.15), phi, -0.5 * phi)
    line = SizedLine(turned(arc())[::order], np.full(200, RADIUS))
    fit = measured_aorta(turned(beside), line, offset=0.15, ostium_end="first")
    assert fit.residual < 0.01  # the smoothing of both lines, σ²/2R of 0.3 cm and 0.15 cm
    gap = aortic_gap(fit.aorta, fit.course)
    np.testing.assert_allclose(gap, 0.15, atol=0.02)
    position, tangent, normal, _ = at_arc_length(fit.aorta.axis, np.zeros(1))
    np.testing.assert_allclose(position[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(tangent[0], [0.0, 0.0, 1.0], atol=1e-5)
    np.testing.assert_allclose(normal[0], [1.0, 0.0, 0.0], atol=1e-5)
    assert abs(fit.course[0, 1]) < 1e-6
    assert fit.course[0, 0] > RADIUS
    # the coronary runs down from the ostium
    assert wall_coordinates(fit.aorta, fit.course)[-1, 2] < -0.4
    low, high = fit.aorta.known
    assert high - low == pytest.approx(1.2 * BEND, abs=0.15)


def test_bundled_aorta_has_axis_and_radius_of_its_ct():
    ct = read_sized_line(BUNDLED / "aorta_centerline.csv")
    anatomy = ivus_anatomy(
        BUNDLED / "rest_diastole_contours.csv",
        BUNDLED / "centerline.csv",
        frame_table=BUNDLED / "rest_frames.csv",
        reference=BUNDLED / "rest_diastole_reference.csv",
        aorta_centerline=BUNDLED / "aorta_centerline.csv",
    )
    rotation = np.array(anatomy.meta["aortic_axes_in_ct"])
    points = (ct.points - anatomy.meta["aortic_origin_in_ct"]) @ rotation.T
    line = anatomy.centerlines["aorta"].points
    inside = (points[:, 2] > line[0, 2] + 0.2) & (points[:, 2] < line[-1, 2] - 0.2)
    assert np.count_nonzero(inside) > 100
    off = np.linalg.norm(points[inside, None] - line, axis=2).min(axis=1)
    assert off.max() < 0.05  # smoothing over 3 mm, and 0.25 mm to the nearest point of the axis
    aorta = anatomy.vessels[0]
    axis = aorta.tube.axis.points
    nearest = np.linalg.norm(points[inside, None] - axis, axis=2).argmin(axis=1)
    radius = aorta.half_width[nearest]
    # the peak of 15.4 mm, smoothed over 3 mm
    np.testing.assert_allclose(radius, ct.radius[inside], atol=0.04)
    # the largest sphere about these points in the model's aorta, a radius away from its flat ends
    middle = np.abs(points[inside, 2]) < 1.0
    held = -tube_foot(aorta.tube, points[inside][middle]).distance
    np.testing.assert_allclose(held, ct.radius[inside][middle], atol=0.04)
    assert anatomy.meta["aorta_radius"] == pytest.approx(1.419, abs=0.005)
    assert anatomy.meta["aorta_measured"] is True


def test_bundled_artery_runs_along_the_wall_of_the_measured_aorta():
    line = read_centerline(BUNDLED / "centerline.csv")
    fit = measured_aorta(line, read_sized_line(BUNDLED / "aorta_centerline.csv"), offset=0.16)
    assert fit.from_first
    # 0.9 mm: the largest sphere leaves room between itself and an oval lumen
    assert fit.residual < 0.12
    # without the aorta's line the axis is taken as cranial, 37 degrees from that of CT
    straight = fit_aorta(line, RADIUS, offset=0.16)
    angle = np.degrees(np.arccos(fit.rotation[2] @ straight.rotation[2]))
    assert 30.0 < angle < 45.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: p + np.array([10.0, 0.0, 0.0]), r"does not run beside this aorta.*Check"),
        (lambda p: p * [-1.0, -1.0, 1.0], r"does not run beside this aorta.*Check"),
        (lambda p: p[p[:, 2] < 173.5], r"ends before it is level with the ostium.*Give"),
    ],
    ids=["elsewhere", "mirrored", "ends below"],
)
def test_line_of_another_aorta_is_refused(change, words):
    line = read_centerline(BUNDLED / "centerline.csv")
    ct = read_sized_line(BUNDLED / "aorta_centerline.csv")
    points = change(ct.points)
    with pytest.raises(ValueError, match=words):
        measured_aorta(line, SizedLine(points, ct.radius[: len(points)]), offset=0.16)
