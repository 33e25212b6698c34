"""What a case assumes from the body of its patient, where it gives no number of its own."""

import dataclasses
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True)
class Assumed:
    """A number that the case does not give.

    Attributes:
        text: what it is.
        value: the number [CGS].
        low: 5 of 100 lie below [CGS].
        high: 5 of 100 lie above [CGS].
        unit: in which it is shown.
        factor: that unit in CGS.
        source: where it comes from.
        sd: standard deviation of a normal number [CGS]; None for one that is known up to a factor.
        log_sd: standard deviation of the logarithm of the latter [-].
    """

    text: str
    value: float
    low: float
    high: float
    unit: str
    factor: float
    source: str
    sd: float | None = None
    log_sd: float | None = None


@dataclasses.dataclass(frozen=True)
class FromBody:
    """What follows from the body.

    Attributes:
        assumed: numbers that the case does not give, by table and field (`condition.rest.period`).
        surface_area_m2: body surface area [m²]; None without weight and height.
        normal_bed: resistances and compliances of the normal coronary artery by field of
            `CoronaryParameters`; None: those of [coronary].
        notices: what looks wrong in the numbers of the body, in sentences.
    """

    assumed: Mapping[str, Assumed] = dataclasses.field(default_factory=dict)
    surface_area_m2: float | None = None
    normal_bed: Mapping[str, float] | None = None
    notices: tuple[str, ...] = ()
