"""Pressure losses of the anomalous artery at its origin, as a table of a record states them."""

from typing import Annotated

from pydantic.dataclasses import dataclass

from study.case.parameters import QuadraticLoss, Resistance
from study.case.schema import Number, Quantity, keys_of

_R0_SD_LOG = 0.15


@dataclass(frozen=True)
class OstiumLosses:
    """The artery at its origin, dP = R0 Q + K Q abs(Q) + L dQ/dt.

    Without R0 the record says 5.0e3 within a factor of 2.7 (95 %); jaxfsi diagnose --case takes R0
    from a case, or the whole curve from a finished study. The sd of the logarithm of R0, 0.01 to 3,
    is 0.15 where it is not given.
    """

    R0: Resistance = None
    K: QuadraticLoss = None
    L: Annotated[
        Number | None,
        Quantity(
            "inertance", "dyn_s2_per_cm5", 0.0, 1.33322e5, also=("mmHg_s2_per_ml",),
            text="inertance", example=40.0,
        ),
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Uncertain:
    """A resistance as a table."""

    sd_log: Annotated[
        Number | None, Quantity("number", "", 0.01, 3.0, text="sd of the logarithm", example=0.15)
    ] = None


LOSS_KEYS = keys_of(OstiumLosses)
"""What a record may know of the ostium: its resistance, and the rest of a ramp's curve."""

R0, K, _ = LOSS_KEYS
assert isinstance(R0, Quantity)


def sd_log_of(stated: float | None) -> float:
    """Standard deviation of the logarithm of R0; as of a patient's own anatomy where none is."""
    return _R0_SD_LOG if stated is None else stated
