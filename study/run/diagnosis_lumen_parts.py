"""What is known of the lumen of a study, and what of it reaches a record."""

from typing import NamedTuple

from jaxtyping import Array, Float

from diagnosis.least_change import LeastChange
from diagnosis.reach import Reach
from jaxfsi import Lumen

BAND = 2.0
"""Standard deviations of ln of the wanted loss that the band of a change spans either way."""


class StudyLumen(NamedTuple):
    """The lumen of a finished study.

    Attributes:
        study: name of its folder or file.
        lumen: sections from the ostium downstream.
        mu: viscosity of blood [P].
        rho: its density [g/cm³].
        area_upstream: of the aorta [cm²].
        sd: standard deviation of the half-axes as scanned [cm].
        scan: what that is of: `ultrasound`, `CT`, or `the case`.
        course: length of the intramural course from the ostium [cm]; None where nothing tells.
    """

    study: str
    lumen: Lumen
    mu: float
    rho: float
    area_upstream: float
    sd: float
    scan: str
    course: float | None


class LumenReach(NamedTuple):
    """What reaches a record, and the change of the lumen that would.

    Attributes:
        known: the lumen as scanned.
        reach: what boundary parameters reach, and the loss wanted.
        change: the least change with that loss; None where none is needed, or none would help.
        band: its δr with a loss `BAND` standard deviations lower and higher [cm].
        other: the most probable hypothesis where it leaves R0 alone, else empty, and its
            probability.
    """

    known: StudyLumen
    reach: Reach
    change: LeastChange | None
    band: Float[Array, "2 sections"] | None
    other: tuple[str, float]
