"""Whether points lie inside a closed surface."""

import numpy as np


def solid_angles(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Sum of the signed solid angles of triangles at points (van Oosterom and Strackee 1983)."""
    total = np.zeros(len(points))
    for i in range(0, len(points), 200):
        a, b, c = np.moveaxis(corners[None] - points[i : i + 200, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
        top = np.einsum("ptk,ptk->pt", a, np.cross(b, c))
        below = la * lb * lc + sum(
            np.einsum("ptk,ptk->pt", x, y) * length
            for x, y, length in ((a, b, lc), (b, c, la), (c, a, lb))
        )
        total[i : i + 200] = 2.0 * np.sum(np.arctan2(top, below), axis=1)
    return total
