"""Keys of an input file: how a field of a model declares its key, with unit, range and meaning.

A key is declared once, as metadata of the field that holds its value::

    E: Annotated[float, Quantity("stiffness", "dyn_per_cm2", 2.0e5, 3.0e8, text="...")] = 1.5e7

From there the reader, the template, the JSON Schema and the reference page have it (`keys_of`).
Every key that carries a unit ends in it, as `period_s` does, and its value is turned into CGS once.
"""

import dataclasses
import functools
import math
import numbers
import pathlib
from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic_core import core_schema

from lumped.units import L_PER_MIN, ML_PER_MIN, MM, MMHG, MMHG_S_PER_ML

Number = Any
"""A float, or an array of JAX where a result is differentiated by it; cases do without JAX."""

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
    "viscosity": {"poise": 1.0, "Pa_s": 10.0, "mPa_s": 0.01, "cP": 0.01, "g_per_cm_s": 1.0},
    "length": {"mm": MM, "cm": 1.0, "m": 100.0, "um": 1.0e-4},
    "body surface": {"m2": 1.0, "cm2": 1.0e-4},
    "body mass": {"kg": 1.0, "g": 1.0e-3, "lb": 0.45359237},
    "angle": {"deg": _DEGREE, "rad": 1.0},
    "support": {
        "dyn_per_cm3": 1.0, "N_per_m3": 0.1, "kPa_per_mm": 1.0e5, "mmHg_per_mm": MMHG / MM,
    },
    "support damping": {
        "dyn_s_per_cm3": 1.0, "N_s_per_m3": 0.1, "kPa_s_per_mm": 1.0e5,
        "mmHg_s_per_mm": MMHG / MM,
    },
    "ratio": {"": 1.0, "percent": 0.01},
    "number": {"": 1.0, "years": 1.0},
}  # fmt: skip
"""Units of each dimension and their factors to CGS; angles go to radians, a body's mass to kg."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Common:
    """What every key declares, besides what its field says: its name there, type and default.

    Attributes:
        text: what the key means, in the words of templates and of the reference.
        name: the key without its unit; by default that of the field.
        field: name of the field that holds the value.
        default: value of the field where the key is absent; None where there is none.
        required: whether the key must be there; by default, where the field has no default.
        example: what the template shows where there is no default, in the unit of the key.
        older: earlier spellings of the key, which are still read.
    """

    text: str = ""
    name: str = ""
    field: str = ""
    default: Any = None
    required: bool | None = None
    example: Any = None
    older: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Quantity(_Common):
    """A key that holds a number; its field holds it in CGS.

    Attributes:
        dimension: one of `UNITS`.
        unit: the unit that the key ends in; empty for a plain number.
        low: smallest plausible value [unit].
        high: largest plausible value [unit].
        exclusive: whether `low` and `high` themselves are refused.
        whole: whether only whole numbers are accepted.
        aliases: other names that users give to the quantity, recognised to name the right key.
        advice: a sentence that explains the range.
        also: further units that the key may end in.
        label: the key where it does not end in the unit; empty for `name_unit`.
    """

    dimension: str
    unit: str
    low: float
    high: float
    _: dataclasses.KW_ONLY
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

    @property
    def usual(self) -> float | int | None:
        """The default [unit]."""
        if self.default is None or self.whole:
            return self.default
        return self.default / UNITS[self.dimension][self.unit]

    def holds(self, value: float) -> bool:
        """Whether a value [unit] lies in the range."""
        if self.exclusive:
            return self.low < value < self.high
        return self.low <= value <= self.high

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        """A field takes any number and any array (JAX differentiates by it), and changes neither.

        The range is that of a plausible patient: files are held to it, computed values are not.
        """
        optional = type(None) in get_args(source)

        def checked(value: Any) -> Any:
            if value is None and optional:
                return value
            plain = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if not plain and not hasattr(value, "dtype"):
                raise ValueError("a number is expected here")
            return value

        return core_schema.no_info_plain_validator_function(checked)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Word(_Common):
    """A key that holds a name: one of `options`, or anything that `pattern` matches.

    Attributes:
        options: the names; by default those of the field's `Literal`.
        pattern: what a name must match where there are no options.
        described: the pattern in words.
    """

    options: tuple[str, ...] = ()
    pattern: str = ".+"
    described: str = "a text"

    @property
    def key(self) -> str:
        """The key in the file."""
        return self.name

    @property
    def allowed(self) -> str:
        """What is accepted, in words."""
        return " | ".join(f'"{option}"' for option in self.options) or self.described


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flag(_Common):
    """A key that holds true or false."""

    allowed: str = ""

    @property
    def key(self) -> str:
        """The key in the file."""
        return self.name


@dataclasses.dataclass(frozen=True, kw_only=True)
class Location(_Common):
    """A key that holds the path of a file (or folder), relative to the file that names it."""

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


Key = Quantity | Word | Flag | Location
Value = float | int | str | bool | pathlib.Path | None


@functools.cache
def keys_of(model: type) -> tuple[Key, ...]:
    """Keys that the fields of a model declare, in their order."""
    hints = get_type_hints(model, include_extras=True)
    found = []
    for field in dataclasses.fields(model):
        hint = hints[field.name]
        declared = getattr(hint, "__metadata__", ())
        for key in declared:
            if isinstance(key, Key):
                found.append(_bound(key, field, hint))
    return tuple(found)


def _bound(key: Key, field: dataclasses.Field, hint: Any) -> Key:
    """A key with what its field says of it: name, default, options."""
    missing = field.default is dataclasses.MISSING
    known: dict[str, Any] = {
        "field": field.name,
        "name": key.name or field.name,
        "default": None if missing else field.default,
        "required": missing if key.required is None else key.required,
    }
    if isinstance(key, Word) and not key.options:
        known["options"] = tuple(_literals(hint))
    return dataclasses.replace(key, **known)


def _literals(hint: Any) -> Iterator[str]:
    """The names of each `Literal` in a type."""
    if get_origin(hint) is Literal:
        yield from get_args(hint)
        return
    for part in get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint):
        yield from _literals(part)


def spellings(key: Key) -> tuple[Key, ...]:
    """The key in each unit that it may end in, its own first."""
    if not isinstance(key, Quantity):
        return (key,)
    return (key, *(_in_unit(key, unit) for unit in key.also))


def _in_unit(key: Quantity, unit: str) -> Quantity:
    low, high = (_stated_in(unit, bound, key) for bound in (key.low, key.high))
    return dataclasses.replace(key, unit=unit, low=low, high=high)


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
