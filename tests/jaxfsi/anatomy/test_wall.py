import numpy as np
import pytest

from jaxfsi.anatomy import (
    VesselTube,
    curve_through,
    elliptic_contours,
    lumen_distance,
    requested_thickness,
    thickness_from_radius,
    tube,
    wall_distance,
)


def _vessel(name: str, x: float, radius: float, thickness: float) -> VesselTube:
    curve = curve_through(np.array([[x, 0.0, 0.0], [x, 0.0, 3.0]]), 0.05)
    ones = np.ones_like(curve.s)
    lumen = tube(curve, elliptic_contours(radius * ones, radius * ones, 40))
    return VesselTube(name, lumen, radius * ones, thickness * ones, 0.01 * ones)


def _across(x: list[float], y: float = 0.0) -> np.ndarray:
    return np.stack([x, np.full(len(x), y), np.full(len(x), 1.5)], axis=1)


def test_thickness_follows_the_radius_within_limits() -> None:
    radius = np.linspace(0.05, 2.0, 400)
    found = thickness_from_radius(radius, factor=0.125, minimum=0.05, maximum=0.15)
    clipped = np.clip(0.125 * radius, 0.05, 0.15)
    # Rounding with k = a quarter of the span moves the corners by k/4.
    assert np.max(np.abs(found - clipped)) <= 0.1 / 16.0 + 1e-12
    assert np.all(np.diff(found) >= 0.0)
    assert found[0] == 0.05
    assert found[-1] == 0.15
    slope = np.diff(found) / np.diff(radius)
    assert np.max(np.abs(np.diff(slope))) < 0.125 / 15.0  # no kink


def test_equal_limits_give_one_thickness() -> None:
    found = thickness_from_radius(np.array([0.1, 1.0]), factor=0.1, minimum=0.06, maximum=0.06)
    np.testing.assert_allclose(found, 0.06, atol=1e-15)


@pytest.mark.parametrize("limits", [(0.2, 0.1), (0.0, 0.1), (-0.1, 0.1)])
def test_impossible_limits_are_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="Give 0 < minimum <= maximum"):
        thickness_from_radius(np.ones(1), factor=0.1, minimum=limits[0], maximum=limits[1])


def test_a_single_vessel_is_offset_by_its_thickness() -> None:
    vessel = _vessel("aorta", 0.0, 1.0, 0.15)
    np.testing.assert_allclose(
        wall_distance([vessel], _across([1.0, 1.15, 1.3])), [-0.15, 0.0, 0.15], atol=1e-6
    )


def test_two_lumens_share_one_solid() -> None:
    aorta, coronary = _vessel("aorta", 0.0, 1.0, 0.15), _vessel("branch", 1.25, 0.2, 0.05)
    septum = _across(np.linspace(1.001, 1.049, 20).tolist())
    assert np.all(lumen_distance([aorta, coronary], septum) > 0.0)
    assert np.all(wall_distance([aorta, coronary], septum) < 0.0)


def test_a_thick_wall_is_not_notched_beside_a_thin_one() -> None:
    # The branch touches the aortic wall from outside; each lumen keeps its own thickness
    # to the accuracy of the tabulated circle.
    aorta, branch = _vessel("aorta", 0.0, 1.0, 0.15), _vessel("branch", 1.32, 0.2, 0.05)
    angle = np.linspace(0.0, np.pi, 200)
    on_aorta = np.stack([np.cos(angle), np.sin(angle), np.full(200, 1.5)], axis=1)
    assert np.max(wall_distance([aorta, branch], on_aorta)) <= -0.15 + 1e-5
    on_branch = np.array([1.32, 0.0, 1.5]) + 0.2 * (on_aorta - np.array([0.0, 0.0, 1.5]))
    assert np.max(wall_distance([aorta, branch], on_branch)) <= -0.05 + 1e-5
    # Far from the other vessel the thickness is neither more.
    assert wall_distance([aorta, branch], _across([-1.15]))[0] == pytest.approx(0.0, abs=1e-6)
    assert wall_distance([aorta, branch], _across([1.57]))[0] == pytest.approx(0.0, abs=1e-6)


def test_requested_thickness_passes_from_vessel_to_vessel() -> None:
    vessels = [_vessel("aorta", 0.0, 1.0, 0.15), _vessel("branch", 1.4, 0.2, 0.05)]
    found = requested_thickness(vessels, _across([-1.0, 1.1, 1.6]))
    assert found[0] == pytest.approx(0.15)
    # Halfway between the lumens: the geometric mean.
    assert found[1] == pytest.approx(np.sqrt(0.15 * 0.05), rel=1e-3)
    assert found[2] == pytest.approx(0.05, rel=1e-3)
