"""Units in which consoles export."""

from collections.abc import Mapping

from lumped.units import MMHG

PRESSURE_UNITS: Mapping[str, float] = {"mmHg": 1.0, "kPa": 1e4 / MMHG}
"""Units of pressure, in mmHg."""

TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "min": 60.0}
"""Units of time, in s."""
