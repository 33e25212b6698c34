"""Where blood enters or leaves the domain: a plane cut through a vessel."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Opening(NamedTuple):
    """A plane cut through a vessel, where blood enters or leaves.

    Attributes:
        name: label of the blood face.
        centre: a point of the plane inside the lumen [cm].
        normal: unit normal, out of the domain.
        radius: of the ball about the centre within which the plane cuts [cm]; it holds the wall
            of this vessel and no other part of the anatomy.
    """

    name: str
    centre: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]
    radius: float
