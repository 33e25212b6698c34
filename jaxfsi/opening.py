"""Openings: planes cut through a vessel, where blood enters or leaves, and what their names say.

A mesh holds the aorta with its coronaries (``aorta_inlet``, ``aorta_outlet``, outlets), or a
segment: a vessel without the aorta (``inlet``, outlets). Which opening is which is told by its
name, never by its place in a list.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.mesh import OUTER_WALL, Mesh

INLET, OUTLET = "aorta_inlet", "aorta_outlet"
SEGMENT_INLET = "inlet"
ANOMALOUS = "anomalous"
"""Name of the axis of the anomalous artery; begins the names of its outlets."""

_AORTA = "aorta"


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


_FIRST = (INLET, SEGMENT_INLET, OUTLET)


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


def is_anomalous(name: str) -> bool:
    """Whether an opening is an outlet of the anomalous artery."""
    return name.startswith(ANOMALOUS)


def is_opening(name: str) -> bool:
    """Whether a port is an opening: the outside of the wall is a port of the model alone."""
    return name != OUTER_WALL


def is_segment(names: Iterable[str]) -> bool:
    """Whether these openings are those of a vessel without the aorta."""
    names = set(names)
    return SEGMENT_INLET in names and not any(name.startswith(_AORTA) for name in names)


def inlet_name(names: Iterable[str]) -> str:
    """The opening where the aortic pressure is given.

    Raises:
        ValueError: none of them is.
    """
    names = tuple(names)
    for name in (INLET, SEGMENT_INLET):
        if name in names:
            return name
    raise ValueError(
        f"none of {', '.join(names) or 'no openings'} is named {INLET} or {SEGMENT_INLET}. Name the"
        " opening where blood comes in so."
    )


def distal_name(names: Iterable[str]) -> str | None:
    """The outlet whose pressure a ratio is taken of, the first by name where there are several.

    That of the anomalous artery; of a segment without one, its outlet.
    """
    ordered = canonical_order(names)
    found = [name for name in ordered if is_anomalous(name)]
    if not found and is_segment(ordered):
        found = [name for name in ordered if name != SEGMENT_INLET]
    return found[0] if found else None


def opening_area(mesh: Mesh, name: str) -> float:
    """Area of an opening of a mesh [cm²]."""
    # on the host: it is asked for while models are traced
    corner = mesh.points[mesh.labelled(name)]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return float(np.linalg.norm(normal, axis=1).sum() / 2.0)
