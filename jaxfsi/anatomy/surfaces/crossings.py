"""Self-intersections of a triangulated surface.

Two triangles cross where an edge of one passes through the inside of the other: its ends lie on
both sides of the plane, and the signed volumes with the three edges have one sign. Candidates share
a cell of a regular grid into which the boxes of all triangles are entered.
"""

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy.surfaces.triangles import Triangles

_TOLERANCE = 1e-9  # of the cube of the cell size
_CHUNK = 1_000_000


def _expanded(
    count: Int[np.ndarray, " items"],
) -> tuple[Int[np.ndarray, " total"], Int[np.ndarray, " total"]]:
    """Item i repeated count[i] times, and the running number within each item."""
    item = np.repeat(np.arange(len(count)), count)
    start = np.repeat(np.cumsum(count) - count, count)
    return item, np.arange(len(item)) - start


def _entries(
    corners: Float[np.ndarray, "faces 3 3"], cell: float
) -> tuple[Int[np.ndarray, " entries"], Int[np.ndarray, " entries"]]:
    """Triangle and cell number of every cell that the box of a triangle touches."""
    low = np.floor(corners.min(axis=1) / cell).astype(np.int64)
    high = np.floor(corners.max(axis=1) / cell).astype(np.int64)
    low -= (origin := low.min(axis=0))
    high -= origin
    span = high - low + 1
    face, running = _expanded(np.prod(span, axis=1))
    place = low[face]
    for axis in range(3):
        place[:, axis] += running % span[face, axis]
        running = running // span[face, axis]
    size = high.max(axis=0) + 1
    return face, (place[:, 0] * size[1] + place[:, 1]) * size[2] + place[:, 2]


def _candidates(corners: Float[np.ndarray, "faces 3 3"], cell: float) -> Int[np.ndarray, "pairs 2"]:
    face, place = _entries(corners, cell)
    order = np.argsort(place, kind="stable")
    face, place = face[order], place[order]
    _, start, count = np.unique(place, return_index=True, return_counts=True)
    later = np.repeat(start + count, count) - np.arange(len(face)) - 1
    first, running = _expanded(later)
    pairs = np.stack([face[first], face[first + 1 + running]], axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    overlap = np.all(
        (low[pairs[:, 0]] <= high[pairs[:, 1]]) & (low[pairs[:, 1]] <= high[pairs[:, 0]]), axis=1
    )
    return np.unique(np.sort(pairs[overlap], axis=1), axis=0)


def _volume(
    a: Float[np.ndarray, "n 3"],
    b: Float[np.ndarray, "n 3"],
    c: Float[np.ndarray, "n 3"],
    d: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, " n"]:
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)


def crossing_faces(surface: Triangles, cell: float) -> Int[np.ndarray, "pairs 2"]:
    """Pairs of triangles that pass through each other.

    Args:
        surface: any surface.
        cell: about the longest edge [cm].
    """
    corners = surface.points[surface.faces]
    pairs = _candidates(corners, cell)
    limit = _TOLERANCE * cell**3
    crossing = [np.zeros((0, 2), dtype=np.int64)]
    for start in range(0, len(pairs), _CHUNK):
        part = pairs[start : start + _CHUNK]
        hit = np.zeros(len(part), dtype=bool)
        for one, other in ((part[:, 0], part[:, 1]), (part[:, 1], part[:, 0])):
            a, b, c = (corners[other, i] for i in range(3))
            height = np.stack([_volume(a, b, c, corners[one, i]) for i in range(3)], axis=1)
            for i in range(3):
                p, q = corners[one, i], corners[one, (i + 1) % 3]
                through = height[:, i] * height[:, (i + 1) % 3] < -(limit**2)
                sides = np.stack(
                    [_volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)], axis=1
                )
                hit |= through & (np.all(sides > limit, axis=1) | np.all(sides < -limit, axis=1))
        crossing.append(part[hit])
    return np.concatenate(crossing)
