"""Which opening of a mesh is what, by name: never by its place in a list.

A mesh holds the aorta with its coronaries (``aorta_inlet``, ``aorta_outlet``, outlets), or a
segment: a vessel without the aorta (``inlet``, outlets).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jaxfsi.opening import canonical_order
from jaxfsi.simulation import Record
from jaxfsi.simulation.record import port_pressure
from lumped import MMHG

INLET, OUTLET = "aorta_inlet", "aorta_outlet"
SEGMENT_INLET = "inlet"
ANOMALOUS = "anomalous"
_AORTA = "aorta"


class Inlet(NamedTuple):
    """The aortic pressure over a run.

    Attributes:
        t: times [s].
        P_mmHg: pressure at these times [mmHg].
    """

    t: np.ndarray
    P_mmHg: np.ndarray


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
    found = [name for name in ordered if name.startswith(ANOMALOUS)]
    if not found and is_segment(ordered):
        found = [name for name in ordered if name != SEGMENT_INLET]
    return found[0] if found else None


def inlet_of(record: Record, names: Sequence[str]) -> Inlet:
    """The aortic pressure of a run.

    Args:
        record: of the run.
        names: of the ports of its model, in their order.
    """
    return Inlet(record.t, port_pressure(record, names, inlet_name(names)) / MMHG)
