"""Measured lumens compared at equal distance from the ostium, with the error of a frame."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibration.lumen_record import frame_distance, lumen_change, lumen_profile
from jaxfsi.lumen import Lumen


def _lumen(a, b, s):
    """Ellipses with half-axes a ≥ b [cm] at distances s [cm]."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    points = np.stack([np.outer(a, np.cos(angle)), np.outer(b, np.sin(angle))], axis=2)
    return Lumen(jnp.asarray(points), jnp.asarray(s))


S = np.linspace(0.0, 2.0, 11)


def test_a_uniform_narrowing_is_read_off_whatever_the_frames():
    before = _lumen(0.2 + 0.05 * S, 0.1 + 0.02 * S, S)
    finer = np.linspace(0.0, 2.0, 41)
    after = _lumen(0.2 + 0.05 * finer, 0.8 * (0.1 + 0.02 * finer), finer)
    at = np.linspace(0.0, 1.0, 5)
    change = lumen_change(lumen_profile(after, at), lumen_profile(before, at))
    # Interpolation in the logarithm between frames 2 mm apart errs by 1e-3.
    assert np.exp(change.log_area) == pytest.approx(0.8, rel=2e-3)
    assert np.exp(change.log_minor) == pytest.approx(0.8, rel=2e-3)


def test_a_frame_counts_where_the_lumen_changes_along_its_length():
    grows = np.exp(2.0 * S)
    lumen = _lumen(0.3 * np.ones_like(S), 0.02 * grows, S)
    profile = lumen_profile(lumen, np.array([1.0]), contour_error=0.05)
    # log A = 2 s + const: a frame of 0.2 cm either way is 0.4.
    assert profile.sd_area[0] == pytest.approx(np.hypot(0.05, 0.4), rel=1e-6)
    assert frame_distance(lumen) == pytest.approx(0.2)
    even = lumen_profile(_lumen(np.full(11, 0.3), np.full(11, 0.1), S), np.array([1.0]))
    assert even.sd_area[0] == pytest.approx(0.05)


def test_errors_of_both_states_add_in_the_ratio():
    profile = lumen_profile(_lumen(np.full(11, 0.3), np.full(11, 0.1), S), S[:4])
    change = lumen_change(profile, profile)
    assert np.asarray(change.sd_area) == pytest.approx(np.sqrt(2.0) * 0.05)
    assert np.asarray(change.log_area) == pytest.approx(0.0, abs=1e-12)


def test_contours_that_end_before_are_refused():
    lumen = _lumen(np.full(11, 0.3), np.full(11, 0.1), S)
    with pytest.raises(ValueError, match="shorter course"):
        lumen_profile(lumen, np.array([2.5]))
    with pytest.raises(ValueError, match="contour error"):
        lumen_profile(lumen, S, contour_error=0.0)
