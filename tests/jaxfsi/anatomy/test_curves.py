import numpy as np
import pytest

from jaxfsi.anatomy import (
    at_arc_length,
    bezier_points,
    curve_through,
    extended,
)


def _arc(radius: float, angle: float, n: int) -> np.ndarray:
    phi = np.linspace(0.0, angle, n)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), 0.0 * phi], axis=1)


def _helix(n: int) -> np.ndarray:
    phi = np.linspace(0.0, 2.0, n)
    return np.stack([np.cos(phi), np.sin(phi), 0.5 * phi], axis=1)


def test_arc_length_of_a_circle_converges_with_fourth_order() -> None:
    errors = [abs(curve_through(_arc(2.0, 1.5, n), 0.01).s[-1] - 3.0) for n in (6, 11, 21)]
    # Cubic splines: order 4 or more over two halvings.
    assert np.log2(errors[0] / errors[2]) > 8.0


def test_samples_are_evenly_spaced() -> None:
    controls = _arc(1.0, 2.0, 40)[[0, 1, 2, 5, 9, 16, 20, 31, 39]]
    curve = curve_through(controls, 0.02)
    steps = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    # A chord is shorter than its arc by (h κ)²/24 = 2e-5 at h κ = 0.02, κ up to 1.1.
    np.testing.assert_allclose(steps, curve.spacing, rtol=1e-4)


def test_frames_are_right_handed_and_orthonormal() -> None:
    curve = curve_through(_helix(40), 0.02)
    frame = np.stack([curve.normal, curve.binormal, curve.tangent], axis=1)
    np.testing.assert_allclose(
        frame @ frame.transpose(0, 2, 1), np.broadcast_to(np.eye(3), frame.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-12)


def test_rotation_minimising_frame_turns_against_the_torsion_of_a_helix() -> None:
    curve = curve_through(_helix(81), 0.01)
    # Principal normal of the helix points to its axis; the frame turns by −τ s against it.
    to_axis = -curve.points * np.array([1.0, 1.0, 0.0])
    angle = np.unwrap(
        np.arctan2(np.sum(to_axis * curve.binormal, axis=1), np.sum(to_axis * curve.normal, axis=1))
    )
    torsion = 0.5 / (1.0 + 0.5**2)
    turned = angle[-1] - angle[0]
    # The spline's third derivative at its ends is first order in the spacing of the controls.
    assert turned == pytest.approx(torsion * curve.s[-1], rel=2e-3)


def test_normals_may_be_prescribed() -> None:
    controls = _arc(1.0, 2.0, 41)
    curve = curve_through(controls, 0.02, normals=controls[:21])
    radial = curve.points / np.linalg.norm(curve.points, axis=1, keepdims=True)
    # Linear interpolation between controls 0.05 apart: 0.05²/8 = 3e-4.
    np.testing.assert_allclose(curve.normal, radial, atol=1e-3)


def test_curves_go_on_straight_beyond_their_ends() -> None:
    curve = curve_through(_arc(1.0, 1.0, 20), 0.05)
    (beyond,), (tangent,), *_ = at_arc_length(curve, curve.s[-1:] + 0.3)
    np.testing.assert_allclose(beyond, curve.points[-1] + 0.3 * curve.tangent[-1], atol=1e-12)
    np.testing.assert_allclose(tangent, curve.tangent[-1], atol=1e-12)
    longer = extended(curve, 0.2, 0.3)
    assert longer.s[0] <= -0.2
    assert longer.s[-1] >= curve.s[-1] + 0.3
    start = at_arc_length(longer, np.array([0.0]))[0][0]
    np.testing.assert_allclose(start, curve.points[0], atol=1e-14)


def test_bezier_curve_is_the_bernstein_sum() -> None:
    controls = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [1.0, 2.0, 0.0], [3.0, 2.0, 1.0]])
    t = np.linspace(0.0, 1.0, 7)[:, None]
    weights = np.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], 1)
    np.testing.assert_allclose(bezier_points(controls, 7), weights @ controls, atol=1e-15)


def test_repeated_points_are_refused() -> None:
    with pytest.raises(ValueError, match="Remove repeated points"):
        curve_through(np.zeros((3, 3)), 0.1)
