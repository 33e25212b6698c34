"""Colours of the page of a vessel and of its pictures, told apart by colour-blind eyes as well."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.colors import to_rgb

BELOW = ("#54070f", "#c62b25")
"""Of a ratio from the low end to the limit."""

ABOVE = ("#f2a154", "#f7d596", "#e6ead6", "#86bad9", "#2166ac")
"""Of a ratio from the limit to 1."""

PRESSURE = ("#313695", "#74add1", "#e0f3f8", "#fee090", "#f46d43", "#a50026")
MOVED = ("#f6f1e7", "#f4b56f", "#d8576b", "#7b2382", "#1b0c41")
WIDER = ("#a6361c", "#e8a07f", "#f3efe9", "#7fb2d5", "#1d5f9e")

_LEAST_LOW, _STEP = 0.75, 20.0


def low_end(least: float, limit: float) -> float:
    """Low end of the scale of a ratio, below the limit and the least value."""
    least = min(_LEAST_LOW, limit - 1.0 / _STEP, least)
    return math.floor(_STEP * least + 1e-9) / _STEP


def ratio_colours(
    ratios: Float[np.ndarray, " values"], low: float, limit: float
) -> Float[np.ndarray, "values 3"]:
    """Colour of each ratio, red up to the limit.

    Args:
        ratios: values [-].
        low: low end of the scale [-].
        limit: the limit [-].
    """
    below = between(BELOW, (ratios - low) / (limit - low))
    above = between(ABOVE, (ratios - limit) / (1.0 - limit))
    return np.where((ratios <= limit)[:, None], below, above)


def between(
    colours: Sequence[str], share: Float[np.ndarray, " values"]
) -> Float[np.ndarray, "values 3"]:
    """Colours at places of a scale, 0 at its start and 1 at its end."""
    stops = np.array([to_rgb(colour) for colour in colours])
    at = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(share, at, stops[:, i]) for i in range(3)], axis=1)
