"""Layers of wedges in the columns between two surfaces, and their sides."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.faces import boundary_of
from jaxfsi.meshing.structured.prisms import tets_of_wedges


class Stack(NamedTuple):
    """Wedges over the points of two surfaces followed by their own.

    Attributes:
        levels: points between the surfaces [cm].
        wedges: three points inside, then those above them.
        column: points of each column, from the inner surface outwards.
    """

    levels: Float[np.ndarray, "levels 3"]
    wedges: Int[np.ndarray, "wedges 6"]
    column: Int[np.ndarray, "columns levels"]


def no_stack() -> Stack:
    """A stack without columns."""
    empty = np.zeros((0, 6), dtype=np.int64)
    return Stack(np.zeros((0, 3)), empty, empty[:, :2])


def stack(
    feet: Int[np.ndarray, " columns"],
    ends: Int[np.ndarray, " columns"],
    triangles: Int[np.ndarray, "triangles 3"],
    points: Float[np.ndarray, "points 3"],
    *,
    layers: int,
) -> Stack:
    """Evenly spaced layers of wedges.

    Args:
        feet: point of each column on the inner surface.
        ends: point of each column on the outer surface.
        triangles: of the inner surface, as indices into ``feet``, normals outwards.
        points: of both surfaces [cm].
        layers: number of wedges in each column.
    """
    share = np.arange(1, layers)[:, None, None] / layers
    levels = (1.0 - share) * points[feet] + share * points[ends]
    between = len(points) + np.arange((layers - 1) * len(feet)).reshape(layers - 1, len(feet))
    column = np.concatenate([feet[None], between, ends[None]]).T
    wedges = [
        np.concatenate([column[triangles, k], column[triangles, k + 1]], axis=1)
        for k in range(layers)
    ]
    return Stack(levels.reshape(-1, 3), np.concatenate(wedges), column)


def stack_sides(
    stack_: Stack, points: Float[np.ndarray, "points 3"]
) -> Int[np.ndarray, "triangles 3"]:
    """Triangles of the upright sides of a stack, normals outwards."""
    if len(stack_.wedges) == 0:
        return np.zeros((0, 3), dtype=np.int64)
    column = np.full(len(points), -1, dtype=np.int64)
    column[stack_.column] = np.arange(len(stack_.column))[:, None]
    faces = boundary_of(tets_of_wedges(stack_.wedges, points))
    at = np.sort(column[faces], axis=1)
    return faces[(at[:, 0] == at[:, 1]) | (at[:, 1] == at[:, 2])]


def sides_over(
    stack_: Stack, sides: Int[np.ndarray, "triangles 3"], loop: Int[np.ndarray, " loop"]
) -> Int[np.ndarray, "triangles 3"]:
    """Those of the sides that stand over a border of the inner surface."""
    over = stack_.column[np.isin(stack_.column[:, 0], loop)].ravel()
    return sides[np.isin(sides, over).all(axis=1)]
