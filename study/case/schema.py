"""Keys of an input file: their units, ranges and defaults.

Every key that carries a unit ends in it, as `period_s` does, and its value is turned into CGS once.
"""

import dataclasses
import math
import pathlib

from lumped.units import L_PER_MIN, ML_PER_MIN, MM, MMHG, MMHG_S_PER_ML

FREE_TEXT = ("notes", "source")
"""Keys that every table takes: remarks, and where its values come from."""

_DEGREE = math.pi / 180.0
BEATS_PER_MINUTE = "bpm"
"""A heart rate given in place of a period; its conversion is no factor."""

UNITS: dict[str, dict[str, float]] = {
    "pressure": {
        "mmHg": MMHG, "kPa": 1.0e4, "Pa": 10.0, "dyn_per_cm2": 1.0, "cmH2O": 980.665, "torr": MMHG,
    },
    "stiffness": {
        "dyn_per_cm2": 1.0, "MPa": 1.0e7, "kPa": 1.0e4, "Pa": 10.0, "N_per_mm2": 1.0e7,
        "mmHg": MMHG,
    },
    "time": {"s": 1.0, "ms": 1.0e-3, "min": 60.0},
    "flow": {
        "l_per_min": L_PER_MIN, "ml_per_min": ML_PER_MIN, "ml_per_s": 1.0, "cm3_per_s": 1.0,
        "l_per_s": 1.0e3,
    },
    "volume": {"ml": 1.0, "l": 1.0e3, "cm3": 1.0, "mm3": 1.0e-3},
    "resistance": {
        "dyn_s_per_cm5": 1.0, "mmHg_s_per_ml": MMHG_S_PER_ML, "mmHg_min_per_ml": MMHG / ML_PER_MIN,
        "mmHg_min_per_l": MMHG / L_PER_MIN, "wood": MMHG / L_PER_MIN, "Pa_s_per_m3": 1.0e-5,
    },
    "quadratic loss": {"dyn_s2_per_cm8": 1.0, "mmHg_s2_per_ml2": MMHG},
    "inertance": {"dyn_s2_per_cm5": 1.0, "mmHg_s2_per_ml": MMHG},
    "compliance": {"cm5_per_dyn": 1.0, "ml_per_mmHg": 1.0 / MMHG, "m3_per_Pa": 1.0e5},
    "density": {"g_per_cm3": 1.0, "g_per_ml": 1.0, "kg_per_m3": 1.0e-3},
    "viscosity": {"poise": 1.0, "Pa_s": 10.0, "mPa_s": 0.01, "cP": 0.01},
    "length": {"mm": MM, "cm": 1.0, "m": 100.0, "um": 1.0e-4},
    "body surface": {"m2": 1.0, "cm2": 1.0e-4},
    "angle": {"deg": _DEGREE, "rad": 1.0},
    "ratio": {"": 1.0, "percent": 0.01},
    "number": {"": 1.0},
}  # fmt: skip
"""Units of each dimension and their factors to CGS; angles go to radians."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A key that holds a number.

    Attributes:
        name: the quantity, as it is called in the code.
        dimension: one of `UNITS`.
        unit: the unit that the key ends in; empty for a plain number.
        low: smallest plausible value [unit].
        high: largest plausible value [unit].
        default: value where the key is absent [unit]; None where there is none.
        required: whether the key must be there.
        exclusive: whether `low` and `high` themselves are refused.
        whole: whether only whole numbers are accepted.
        aliases: other names that users give to the quantity, recognised to name the right key.
        advice: a sentence that explains the range.
        also: further units that the key may end in.
        label: the key where it does not end in the unit; empty for `name_unit`.
    """

    name: str
    dimension: str
    unit: str
    low: float
    high: float
    default: float | None = None
    required: bool = False
    exclusive: bool = False
    whole: bool = False
    aliases: tuple[str, ...] = ()
    advice: str = ""
    also: tuple[str, ...] = ()
    label: str = ""

    @property
    def key(self) -> str:
        """The key in the file, `name_unit`."""
        return self.label or (f"{self.name}_{self.unit}" if self.unit else self.name)

    @property
    def allowed(self) -> str:
        """The range in words."""
        unit = f" {readable(self.unit)}" if self.unit else ""
        ends = ", both excluded" if self.exclusive else ""
        kind = "a whole number, " if self.whole else ""
        return f"{kind}{self.low:g} to {self.high:g}{unit}{ends}"

    def holds(self, value: float) -> bool:
        """Whether a value [unit] lies in the range."""
        if self.exclusive:
            return self.low < value < self.high
        return self.low <= value <= self.high


@dataclasses.dataclass(frozen=True)
class Word:
    """A key that holds a name: one of `options`, or anything that `pattern` matches."""

    name: str
    options: tuple[str, ...] = ()
    pattern: str = ".+"
    default: str | None = None
    required: bool = False
    described: str = "a text"

    @property
    def key(self) -> str:
        """The key in the file."""
        return self.name

    @property
    def allowed(self) -> str:
        """What is accepted, in words."""
        return " | ".join(f'"{option}"' for option in self.options) or self.described


@dataclasses.dataclass(frozen=True)
class Location:
    """A key that holds the path of a file (or folder), relative to the file that names it."""

    name: str
    required: bool = False
    folder: bool = False
    described: str = "path of a file"

    @property
    def key(self) -> str:
        """The key in the file."""
        return self.name

    @property
    def allowed(self) -> str:
        """What is accepted, in words."""
        return self.described


Key = Quantity | Word | Location
Value = float | str | pathlib.Path | None


def spellings(key: Key) -> tuple[Key, ...]:
    """The key in each unit that it may end in, its own first."""
    if not isinstance(key, Quantity):
        return (key,)
    return (key, *(_in_unit(key, unit) for unit in key.also))


def _in_unit(key: Quantity, unit: str) -> Quantity:
    low, high = (_stated_in(unit, bound, key) for bound in (key.low, key.high))
    default = None if key.default is None else _stated_in(unit, key.default, key)
    return dataclasses.replace(key, unit=unit, low=low, high=high, default=default)


def _stated_in(unit: str, value: float, quantity: Quantity) -> float:
    """A value in the unit of the quantity, in another unit of its dimension."""
    factors = UNITS[quantity.dimension]
    return value * factors[quantity.unit] / factors[unit]


def readable(unit: str) -> str:
    """A unit as it is written in a sentence: `dyn_s_per_cm5` becomes `dyn s/cm5`."""
    return unit.replace("_per_", "/").replace("_", " ")


def to_cgs(value: float, quantity: Quantity) -> float:
    """A value in the unit of the quantity, in CGS."""
    return value * UNITS[quantity.dimension][quantity.unit]


def other_units(quantity: Quantity) -> list[str]:
    """Units in which the quantity may have been given by mistake, its own included."""
    rate = [BEATS_PER_MINUTE] if quantity.dimension == "time" else []
    return [*UNITS[quantity.dimension], *rate]


def convert(value: float, unit: str, quantity: Quantity) -> float:
    """A value in another unit of the same dimension, in the unit of the quantity."""
    if unit == BEATS_PER_MINUTE:
        return 60.0 / value if value else math.inf
    factors = UNITS[quantity.dimension]
    return value * factors[unit] / factors[quantity.unit]
