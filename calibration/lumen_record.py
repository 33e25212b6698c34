"""Measured change of a lumen from one state to another, along the distance from its ostium.

Pullbacks of different states have different numbers of frames and are not registered to each
other. They are compared at equal distance from the ostium, where areas and minor axes are
interpolated between frames, linear in their logarithm. Their variance is that of the contour and
that of a shift by one frame either way::

    y(s) = log A,    sd² = contour² + ½ [ (y(s + h) − y(s))² + (y(s − h) − y(s))² ]

with h the distance of frames. Both states have their own; the variances add in the ratio.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.lumen import Lumen

CONTOUR_ERROR = 0.05
"""Relative standard deviation of an area and of a minor axis that is drawn by hand [-]."""


class LumenProfile(NamedTuple):
    """Lumen along the distance from the ostium, as logarithms.

    Attributes:
        log_area: of the area in cm².
        log_minor: of the minor axis in cm.
        sd_area: standard deviation of the former.
        sd_minor: of the latter.
    """

    log_area: Float[np.ndarray, " places"]
    log_minor: Float[np.ndarray, " places"]
    sd_area: Float[np.ndarray, " places"]
    sd_minor: Float[np.ndarray, " places"]


class LumenChange(NamedTuple):
    """Lumen of a state over that of another.

    Attributes:
        log_area: logarithm of the ratio of areas.
        log_minor: of the ratio of minor axes.
        sd_area: standard deviation of the former.
        sd_minor: of the latter.
    """

    log_area: Float[Array, "*states places"]
    log_minor: Float[Array, "*states places"]
    sd_area: Float[Array, "*states places"]
    sd_minor: Float[Array, "*states places"]


def frame_distance(lumen: Lumen) -> float:
    """Median distance of neighbouring frames [cm]."""
    return float(np.median(np.diff(np.asarray(lumen.s))))


def lumen_profile(
    lumen: Lumen, s: Float[np.ndarray, " places"], *, contour_error: float = CONTOUR_ERROR
) -> LumenProfile:
    """A measured lumen at given distances from its ostium.

    Args:
        lumen: contours of one state.
        s: distances from the ostium [cm].
        contour_error: relative standard deviation of a contour's area and minor axis [-].

    Raises:
        ValueError: the contours do not reach as far, or the error is not positive.
    """
    if not contour_error > 0.0:
        raise ValueError(f"a contour error of {contour_error:g} is not above zero; 0.05 is usual.")
    along = np.asarray(lumen.s)
    if np.min(s) < along[0] - 1e-9 or np.max(s) > along[-1] + 1e-9:
        raise ValueError(
            f"the contours lie from {along[0]:.3g} to {along[-1]:.3g} cm from the ostium; they are"
            f" wanted from {np.min(s):.3g} to {np.max(s):.3g} cm. Compare a shorter course."
        )
    shift = frame_distance(lumen)

    def at(values):
        logarithm = np.log(np.asarray(values))
        y = np.interp(s, along, logarithm)
        off = [np.interp(s + h, along, logarithm) - y for h in (-shift, shift)]
        return y, np.sqrt(contour_error**2 + np.mean(np.square(off), axis=0))

    (area, sd_area), (minor, sd_minor) = at(lumen.area), at(lumen.calipers.minor)
    return LumenProfile(area, minor, sd_area, sd_minor)


def lumen_change(state: LumenProfile, image: LumenProfile) -> LumenChange:
    """Lumen of a state over that of the image, with the errors of both."""
    return LumenChange(
        jnp.asarray(state.log_area - image.log_area),
        jnp.asarray(state.log_minor - image.log_minor),
        jnp.asarray(np.hypot(state.sd_area, image.sd_area)),
        jnp.asarray(np.hypot(state.sd_minor, image.sd_minor)),
    )
