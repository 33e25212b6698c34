"""Values of a distance-like function on a grid, exact near its zero set."""

import numpy as np

from jaxfsi.anatomy import PointFunction

SIZE = 4  # points along a cube
STEEPEST = 1.15  # gradient of the functions, 1 but for blending


def grid_values(function: PointFunction, box: np.ndarray, spacing: float) -> np.ndarray:
    """Values at box[0] + spacing · (i, j, k), over the whole box.

    A cube of points whose centre lies too far from zero for a zero in the cube has its centre's
    value throughout.
    """
    shape = np.ceil((box[1] - box[0]) / spacing).astype(int) + 1
    blocks = -(-shape // SIZE)
    low = SIZE * np.indices(blocks).reshape(3, -1).T
    half = (SIZE - 1) / 2.0
    centre = function(box[0] + spacing * (low + half))
    values = np.repeat(centre[:, None], SIZE**3, axis=1)
    near = np.abs(centre) <= STEEPEST * np.sqrt(3.0) * half * spacing + spacing
    points = low[near, None] + np.indices(3 * (SIZE,)).reshape(3, -1).T
    values[near] = function(box[0] + spacing * points.reshape(-1, 3)).reshape(-1, SIZE**3)
    whole = values.reshape(*blocks, *3 * (SIZE,)).transpose(0, 3, 1, 4, 2, 5)
    return whole.reshape(SIZE * blocks)[: shape[0], : shape[1], : shape[2]]
