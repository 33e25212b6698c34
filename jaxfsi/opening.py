"""Where blood enters or leaves the domain: a plane cut through a vessel."""

from collections.abc import Iterable
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


_FIRST = ("aorta_inlet", "inlet", "aorta_outlet")


def canonical_order(names: Iterable[str]) -> list[str]:
    """Names of openings, inlets and aorta first, the others by name.

    What is computed with openings sums over them, and meshers work through them one by one: only
    where each input brings them in one order do equal inputs give equal results to the last bit.
    """
    return sorted(names, key=_rank)


def canonically_ordered(openings: Iterable[Opening]) -> tuple[Opening, ...]:
    """Openings in the order of their names, see `canonical_order`."""
    return tuple(sorted(openings, key=lambda opening: _rank(opening.name)))


def _rank(name: str) -> tuple[int, str]:
    return (_FIRST.index(name) if name in _FIRST else len(_FIRST), name)
