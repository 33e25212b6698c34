"""A loft through measured cross-sections.

Between two frames the loft follows points of equal eccentric angle θ. With b_k and a_k the half
widths of section k along u and v, its points are::

    (u, v) = r_k(θ) (b_k cos θ, a_k sin θ),   r_k ≈ 1

so that the points of a slit crowd at its narrow ends, where they are needed. u(s, θ) and v(s, θ)
are monotone cubics in s (Fritsch & Carlson 1980, SIAM J. Numer. Anal. 17:238): the loft passes
through every section, and overshoots nowhere between them.
"""

import numpy as np
import scipy.interpolate
from jaxtyping import Bool, Float


def eccentric_sections(
    sections: Float[np.ndarray, "frames points 2"], n_angles: int
) -> Float[np.ndarray, "frames angles 2"]:
    """Points of each section at even eccentric angles.

    Args:
        sections: closed polygons about an inner point [cm], anticlockwise.
        n_angles: number of angles.

    Raises:
        ValueError: a section is not star-shaped about its origin.
    """
    half = np.ptp(sections, axis=1) / 2.0
    scaled = sections / half[:, None]
    angle = np.arctan2(scaled[..., 1], scaled[..., 0])
    turned = np.diff(np.unwrap(np.concatenate([angle, angle[:, :1]], axis=1), axis=1), axis=1)
    bad = ~_star_shaped(turned)
    if np.any(bad):
        raise ValueError(
            f"section {int(np.argmax(bad))} from the ostium folds back on itself as seen from its"
            " centroid. Redraw its contour without the fold, or leave the frame out."
        )
    theta = 2.0 * np.pi * np.arange(n_angles) / n_angles
    radius = np.linalg.norm(scaled, axis=2)
    result = np.empty((len(sections), n_angles, 2))
    for k, (a, r) in enumerate(zip(angle, radius, strict=True)):
        order = np.argsort(a)
        value = np.interp(theta, a[order], r[order], period=2.0 * np.pi)
        result[k, :, 0] = value * np.cos(theta) * half[k, 0]
        result[k, :, 1] = value * np.sin(theta) * half[k, 1]
    return result


def _star_shaped(
    turned: Float[np.ndarray, "frames points"],
) -> Bool[np.ndarray, " frames"]:
    """Whether the angle seen from the origin grows all the way, once round."""
    once = np.abs(np.sum(turned, axis=1) - 2.0 * np.pi) < 1e-6
    return once & np.all(turned > -1e-9, axis=1)


def lofted(
    s_frames: Float[np.ndarray, " frames"],
    sections: Float[np.ndarray, "frames angles 2"],
    s: Float[np.ndarray, " samples"],
) -> Float[np.ndarray, "samples angles 2"]:
    """Sections at any s; the first and the last one go on unchanged beyond the frames.

    Args:
        s_frames: place of each frame [cm], growing.
        sections: corresponding points at the same index [cm].
        s: where sections are wanted [cm].
    """
    law = scipy.interpolate.PchipInterpolator(s_frames, sections, axis=0)
    return law(np.clip(s, s_frames[0], s_frames[-1]))
