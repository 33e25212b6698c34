"""Shape of wedges: Jacobians at their six corners, and the angles between their five faces.

With e₁, e₂ the edges of the triangle and e₃ the upright edge at a corner::

    scaled Jacobian   min over corners of 2/√3 · det(e₁, e₂, e₃) / (|e₁| |e₂| |e₃|)

which is 1 for an upright wedge on an equilateral triangle. A quadrilateral side is taken as flat,
with the normal of its two diagonals. Source: Stimpson, Ernst, Knupp, Pébay & Thompson 2007, "The
Verdict geometric quality library", SAND2007-1751, section 8.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_FACE_PAIRS = np.array([[0, 2], [0, 3], [0, 4], [1, 2], [1, 3], [1, 4], [2, 3], [3, 4], [4, 2]])


class WedgeQuality(NamedTuple):
    """Shape of each wedge.

    Attributes:
        min_dihedral_deg: smallest angle between two faces [degrees]; 60 at best.
        scaled_jacobian: 1 for an upright wedge on an equilateral triangle, 0 for a flat and
            negative for an inverted corner.
    """

    min_dihedral_deg: Float[np.ndarray, " wedges"]
    scaled_jacobian: Float[np.ndarray, " wedges"]


def wedge_quality(
    points: Float[np.ndarray, "nodes 3"], wedges: Int[np.ndarray, "wedges 6"]
) -> WedgeQuality:
    """Shape of each wedge.

    Args:
        points: node positions [cm].
        wedges: three nodes of the inner face, then the three above them.
    """
    corners = points[wedges]
    return WedgeQuality(_angles(corners), _jacobians(corners))


def _jacobians(corners: Float[np.ndarray, "wedges 6 3"]) -> Float[np.ndarray, " wedges"]:
    least = np.full(len(corners), np.inf)
    for corner in range(6):
        i, face = corner % 3, 3 * (corner // 3)
        first = corners[:, face + (i + 1) % 3] - corners[:, corner]
        second = corners[:, face + (i + 2) % 3] - corners[:, corner]
        upright = corners[:, 3 + i] - corners[:, i]
        volume = np.einsum("wk,wk->w", np.cross(first, second), upright)
        lengths = np.prod([np.linalg.norm(x, axis=1) for x in (first, second, upright)], axis=0)
        least = np.minimum(least, volume / np.maximum(lengths, np.finfo(float).tiny))
    return 2.0 / np.sqrt(3.0) * least


def _angles(corners: Float[np.ndarray, "wedges 6 3"]) -> Float[np.ndarray, " wedges"]:
    """Smallest angle between two faces that meet at an edge [degrees]."""
    a, b, c, A, B, C = (corners[:, i] for i in range(6))
    normals = [np.cross(c - a, b - a), np.cross(B - A, C - A)]
    normals += [np.cross(Q - p, P - q) for p, q, P, Q in ((a, b, A, B), (b, c, B, C), (c, a, C, A))]
    stacked = np.stack(normals, axis=1)
    length = np.linalg.norm(stacked, axis=2, keepdims=True)
    stacked /= np.maximum(length, np.finfo(float).tiny)
    first, second = (stacked[:, side] for side in _FACE_PAIRS.T)
    cosine = -np.einsum("wpk,wpk->wp", first, second)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min(axis=1)
