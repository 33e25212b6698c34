"""Zero sets of functions that are linear on the tetrahedra of a lattice.

The zero set meets an edge of opposite signs in one point and a tetrahedron in a triangle (one
node against three) or a quadrilateral (two against two), which is split in two triangles. On a
conforming lattice the result is a manifold, open only where the lattice ends. The function itself
then moves each point along its edge (one step of regula falsi), which topology does not notice.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy.anatomy import PointFunction

# Points stay this share of an edge away from its ends: no triangle without area.
_MARGIN = 0.02
_ONE_AGAINST_THREE = {1 << i: (i, *(j for j in range(4) if j != i)) for i in range(4)}
_TWO_AGAINST_TWO = {3: (0, 1, 2, 3), 5: (0, 2, 1, 3), 9: (0, 3, 1, 2)}


class Surface(NamedTuple):
    """A triangulated surface.

    Attributes:
        points: vertices [cm].
        triangles: vertices of each triangle; normals point towards growing values.
    """

    points: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]


def extract_surface(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    values: Float[np.ndarray, " nodes"],
    f: PointFunction,
) -> Surface:
    """The zero set of a function sampled on a lattice, with normals towards positive values.

    Args:
        points: nodes of the lattice [cm].
        tets: its tetrahedra.
        values: of the function at the nodes, none of them zero.
        f: the function.
    """
    signs = (values[tets] > 0.0) @ (1 << np.arange(4))
    # A pattern and its complement cut the same edges.
    pattern = np.where(signs & 8, 15 - signs, signs)
    pattern = np.where(pattern == 7, 8, pattern)
    pieces = []
    for code, (a, b, c, d) in _ONE_AGAINST_THREE.items():
        rows = tets[pattern == code]
        pieces.append(_cut(rows, [(a, b), (a, c), (a, d)]))
    for code, (a, b, c, d) in _TWO_AGAINST_TWO.items():
        code = 15 - code if code & 8 else code
        rows = tets[pattern == code]
        pieces.append(_cut(rows, [(a, c), (a, d), (b, d)]))
        pieces.append(_cut(rows, [(a, c), (b, d), (b, c)]))
    edges = np.sort(np.concatenate(pieces), axis=-1)
    keys, back = np.unique(edges @ np.array([len(points), 1]), return_inverse=True)
    low, high = np.divmod(keys, len(points))
    vertices = _zeros(points[low], points[high], values[low], values[high], f)
    triangles = back.reshape(-1, 3)
    return Surface(vertices, _towards_positive(vertices, triangles, edges, points, values))


def _zeros(
    a: Float[np.ndarray, "edges 3"],
    b: Float[np.ndarray, "edges 3"],
    f_a: Float[np.ndarray, " edges"],
    f_b: Float[np.ndarray, " edges"],
    f: PointFunction,
) -> Float[np.ndarray, "edges 3"]:
    """Zeros of f on edges at whose ends it has opposite signs."""
    share = f_a / (f_a - f_b)
    value = np.asarray(f(a + share[:, None] * (b - a)))
    beyond = value * f_a > 0.0
    start, end = np.where(beyond, share, 0.0), np.where(beyond, 1.0, share)
    f_start, f_end = np.where(beyond, value, f_a), np.where(beyond, f_b, value)
    share = start + (end - start) * f_start / (f_start - f_end)
    return a + np.clip(share, _MARGIN, 1.0 - _MARGIN)[:, None] * (b - a)


def _cut(
    rows: Int[np.ndarray, "tets 4"], edges: list[tuple[int, int]]
) -> Int[np.ndarray, "tets 3 2"]:
    return rows[:, np.array(edges)]


def _towards_positive(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    edges: Int[np.ndarray, "triangles 3 2"],
    points: Float[np.ndarray, "nodes 3"],
    values: Float[np.ndarray, " nodes"],
) -> Int[np.ndarray, "triangles 3"]:
    """Turn triangles so that their normals point to the positive ends of the cut edges."""
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    rise = points[edges[..., 1]] - points[edges[..., 0]]
    rise *= np.sign(values[edges[..., 1]] - values[edges[..., 0]])[..., None]
    wrong = np.einsum("tk,tk->t", normal, rise.sum(axis=1)) < 0.0
    return np.where(wrong[:, None], triangles[:, ::-1], triangles)
