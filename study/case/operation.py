"""An operation on the anomalous artery, as a what-if asks for it."""

import dataclasses
from typing import Literal

OperationKind = Literal["unroof", "reimplant", "stent"]

WORDS = {
    "unroof": "Unroofing: the intramural course opened into the aorta",
    "reimplant": "Reimplantation: the intramural course cut off, a round ostium in the sinus",
    "stent": "Stent: the intramural course round",
}
"""Each operation in words."""


@dataclasses.dataclass(frozen=True)
class Operation:
    """An operation that a case has undergone.

    Attributes:
        kind: which one.
        diameter: of a stent [cm]; None: that of the artery beyond its intramural course.
    """

    kind: OperationKind
    diameter: float | None = None
