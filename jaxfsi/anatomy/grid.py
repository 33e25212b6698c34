"""Values of an implicit function on a regular grid, evaluated only near its zero set.

A function f with |∇f| ≤ 1 + slack keeps its sign over a cube of half-diagonal r about x where
|f(x)| > (1 + slack) r. Cubes of 8, 4 and 2 cells are tested in turn and split where they may hold
a zero; the points of the last ones are evaluated one by one, all others take the value of their
cube's centre.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_LEVELS = (8, 4, 2)
_SLACK = 0.15  # distances are exact but for blending and thickness that varies along a vessel


class Grid(NamedTuple):
    """A function on a regular grid of points.

    Attributes:
        origin: position of the first point [cm].
        spacing: distance between neighbours [cm].
        values: of the function at origin + spacing·(i, j, k).
    """

    origin: Float[np.ndarray, " 3"]
    spacing: float
    values: Float[np.ndarray, "nx ny nz"]

    def position(self, index: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """Position of (fractional) grid indices [cm]."""
        return self.origin + self.spacing * index


_OCTANTS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)


def _cells(low: Int[np.ndarray, "cubes 3"], size: int) -> Int[np.ndarray, "points 3"]:
    steps = np.arange(size)
    inside = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return (low[:, None] + inside).reshape(-1, 3)


def sample_near_zero(
    function: Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]],
    bounds: Float[np.ndarray, "2 3"],
    spacing: float,
    *,
    band: float,
) -> Grid:
    """Sample a distance-like function on a grid over a box.

    Values are those of the function wherever it lies within ±``band`` (and in the rest of the
    2×2×2 blocks of such points); elsewhere they have the right sign and are farther from zero than
    the band, but are constant over blocks.

    Args:
        function: of position [cm], in cm, with a gradient of about 1 or less.
        bounds: corners of the box [cm]; the grid starts at the lower one.
        spacing: of the grid [cm].
        band: half-width of the zone in which values must be exact [cm].

    Raises:
        ValueError: the box is empty, or the spacing or band not positive.
    """
    extent = bounds[1] - bounds[0]
    if not (np.all(extent > 0.0) and spacing > 0.0 and band > 0.0):
        raise ValueError(
            f"a box of {extent} cm cannot be sampled at spacing {spacing:g} cm with band"
            f" {band:g} cm. Give a box with lower < upper corner and positive lengths."
        )
    coarsest = _LEVELS[0]
    shape = np.ceil(extent / spacing).astype(int) + 1
    n_cubes = -(-shape // coarsest)
    values = np.empty(n_cubes * coarsest)
    low = coarsest * np.stack(
        np.meshgrid(*(np.arange(n) for n in n_cubes), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    for size in _LEVELS:
        half = (size - 1) / 2.0
        centre = function(bounds[0] + spacing * (low + half))
        near = np.abs(centre) <= (1.0 + _SLACK) * np.sqrt(3.0) * half * spacing + band
        _fill(values, low[~near], size, centre[~near])
        low = low[near]
        if size > _LEVELS[-1]:
            low = (low[:, None] + size // 2 * _OCTANTS).reshape(-1, 3)
    points = _cells(low, _LEVELS[-1])
    values[tuple(points.T)] = function(bounds[0] + spacing * points)
    return Grid(bounds[0].copy(), spacing, values[: shape[0], : shape[1], : shape[2]])


def _fill(
    values: Float[np.ndarray, "nx ny nz"],
    low: Int[np.ndarray, "cubes 3"],
    size: int,
    constant: Float[np.ndarray, " cubes"],
) -> None:
    nx, ny, nz = (n // size for n in values.shape)
    blocks = values.reshape(nx, size, ny, size, nz, size)
    i, j, k = (low // size).T
    blocks[i, :, j, :, k, :] = constant[:, None, None, None]
