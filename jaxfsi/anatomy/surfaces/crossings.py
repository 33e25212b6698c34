"""Self-intersections of a triangulated surface.

Two triangles cross where an edge of one passes through the other: its ends lie on both sides of the
plane, and the signed volumes with the three edges have one sign. Candidates share a cell of a
regular grid into which the boxes of all triangles are entered.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

_FLAT = 1e-14  # height of an edge along a plane, over its length and the triangle's size
_CHUNK = 1_000_000
_MOST_CELLS = 32  # along an edge


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


def _pass_through(
    corners: Float[np.ndarray, "faces 3 3"],
    faces: Int[np.ndarray, "faces 3"],
    pairs: Int[np.ndarray, "pairs 2"],
    limit: float,
) -> Bool[np.ndarray, " pairs"]:
    """Pairs of which an edge of the first triangle, no corner shared, passes through the second."""
    one, other = pairs.T
    a, b, c = (corners[other, i] for i in range(3))
    height = np.stack([_volume(a, b, c, corners[one, i]) for i in range(3)], axis=1)
    free = np.all(faces[one][:, :, None] != faces[other][:, None, :], axis=2)
    hit = np.zeros(len(pairs), dtype=bool)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        p, q = corners[one, i], corners[one, j]
        slope = np.abs(height[:, i] - height[:, j])
        through = (height[:, i] * height[:, j] <= -(limit**2)) & free[:, i] & free[:, j]
        through &= slope > _FLAT * np.linalg.norm(q - p, axis=1) ** 3
        sides = np.stack([_volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)], axis=1)
        hit |= through & (np.all(sides >= limit, axis=1) | np.all(sides <= -limit, axis=1))
    return hit


def crossing_faces(
    points: Float[np.ndarray, "points 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    tolerance: float = 0.0,
) -> Int[np.ndarray, "pairs 2"]:
    """Triangles an edge of which passes through another one, in pairs with that one.

    Args:
        points: vertices [cm].
        faces: corners of each triangle.
        tolerance: volume, over the cube of the longest edge, that an edge must reach beyond the
            plane and the sides of a triangle; with 0 an edge that touches one counts too.
    """
    corners = points[faces]
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    longest = float(np.max(edges, initial=0.0))
    near = _candidates(corners, max(float(np.mean(edges)), longest / _MOST_CELLS))
    limit = tolerance * longest**3
    crossing = [np.zeros((0, 2), dtype=np.int64)]
    for start in range(0, len(near), _CHUNK):
        for pairs in (near[start : start + _CHUNK], near[start : start + _CHUNK, ::-1]):
            crossing.append(pairs[_pass_through(corners, faces, pairs, limit)])
    return np.concatenate(crossing)
