"""Stored documents as strict JSON whose parts know their place, to name a damaged one."""

import json
import math
import re
from collections.abc import Iterator
from typing import Any

from jaxfsi.text_files import bad_byte

LARGEST_NUMBER = 1e30
"""Magnitude beyond which a number is damage: no quantity of a result comes near it."""

_UNITS = tuple(
    f"_{unit}"
    for unit in (
        "mmHg", "mm", "mm2", "cm", "cm2", "mm_per_s", "cm_per_s", "ml_per_min", "s", "deg", "ml",
        "dyn_s_per_cm5", "dyn_per_cm2",
    )
)  # fmt: skip
"""Ends of the keys below which numbers stand, and nothing else."""

_RANGES = {
    "ffr": (0.0, 1.5),
    "rest_ratio": (0.0, 1.5),
    "alpha": (0.0, 1e9),
    "R0": (0.0, 1e9),
}
"""What the quantities of these names lie between, where they are not derivatives by them."""

_DERIVATIVES = re.compile(r"_by_|sensitivit|derivative|gradient|at_fixed_alpha|recalibrated")

_PRESSURE, _LARGEST_PRESSURE = re.compile(r"(^|_)P_\w*mmHg$"), 2000.0
"""Keys of pressures, and the magnitude beyond which they are damage."""

DEEPEST = 40
"""Levels of tables and lists beyond which a document is damaged."""

LONGEST_TEXT = 100_000
"""Characters of one text: beyond those of any result, a figure would be at work for minutes."""


class Damage(ValueError):
    """What is wrong with a document, in a sentence."""


class Trail:
    """Where a document was read last.

    Attributes:
        last: place of the part, `runs[2].ratio`; empty before anything was read.
    """

    def __init__(self) -> None:
        """Nothing was read yet."""
        self.last = ""


class Table(dict[str, Any]):
    """A table of a document; it leaves the place of each key that is asked for."""

    def __init__(self, values: dict[str, Any], place: str, trail: Trail):
        """Attributes have underscores: templates take any other name for a key."""
        dict.__init__(self, values)
        self._place = place
        self._trail = trail

    def __getitem__(self, key: str) -> Any:
        """The part; its place is left, there or not."""
        self._trail.last = _below(self._place, key)
        return dict.__getitem__(self, key)

    def get(self, key: str, default: Any = None) -> Any:
        """The part; its place is left where it is there."""
        return self[key] if key in self else default


class Row(list[Any]):
    """A list of a document; it leaves the place of each part that is asked for."""

    def __init__(self, values: list[Any], place: str, trail: Trail):
        """A list of plain values needs no such care."""
        list.__init__(self, values)
        self._place = place
        self._trail = trail

    def __getitem__(self, at: Any) -> Any:
        """The part; its place is left, there or not."""
        self._trail.last = f"{self._place}[{at}]" if isinstance(at, int) else self._place
        return list.__getitem__(self, at)

    def __iter__(self) -> Iterator[Any]:
        """The parts in order; the place of each is left."""
        for k, value in enumerate(list.__iter__(self)):
            self._trail.last = f"{self._place}[{k}]"
            yield value


def parse(data: bytes, trail: Trail) -> Any:
    """What a JSON file holds, its tables and lists as `Table` and `Row`.

    Args:
        data: the bytes of the file.
        trail: where the place of what was read last is kept.

    Raises:
        Damage: it is no JSON of numbers that a result can hold.
    """
    try:
        found = json.loads(data.decode("utf-8-sig"), object_pairs_hook=_once)
    except UnicodeDecodeError as error:
        raise Damage(f"not a UTF-8 text ({bad_byte(error)})") from None
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise Damage(f"not valid JSON at {place}") from None
    except RecursionError:
        raise Damage("lists or tables are nested too deeply") from None
    except Damage:
        raise
    except ValueError:  # an integer with more digits than Python converts
        raise Damage("a number has a great many digits") from None
    return _parts(found, "", 0, trail)


def last_read(document: dict[str, Any]) -> str:
    """Place of the part that was read last, empty where that is not known."""
    return document._trail.last if isinstance(document, Table) else ""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in table if names.count(name) > 1)
        raise Damage(f"the key {twice[:60]!r} appears twice in one table")
    return table


def _parts(value: Any, place: str, depth: int, trail: Trail) -> Any:
    if depth > DEEPEST:
        raise Damage("lists or tables are nested too deeply")
    if isinstance(value, dict):
        for key, part in value.items():
            _check(key, part, _below(place, key), depth)
        parts = {k: _parts(v, _below(place, k), depth + 1, trail) for k, v in value.items()}
        return Table(parts, place, trail)
    if isinstance(value, list):
        parts = [_parts(v, f"{place}[{k}]", depth + 1, trail) for k, v in enumerate(value)]
        nested = any(isinstance(part, dict | list) for part in parts)
        return Row(parts, place, trail) if nested else parts
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        raise Damage(f"{place or 'the document'} is a text of {len(value)} characters")
    if isinstance(value, int | float) and not _sound(value):
        raise Damage(f"{place or 'the document'} is a number that no result holds")
    return value


def _check(key: str, value: Any, place: str, depth: int) -> None:
    """Refuse what a quantity of this name cannot be."""
    if key.endswith(_UNITS) and not _numeric(value, depth):
        raise Damage(f"{place} is to hold numbers")
    low, high = _RANGES.get(key, (-math.inf, math.inf))
    pressure = _PRESSURE.search(key) is not None
    if pressure:
        low, high = -_LARGEST_PRESSURE, _LARGEST_PRESSURE
    elif key not in _RANGES or _DERIVATIVES.search(place):
        return
    for number in value if isinstance(value, list) else [value]:
        waves = pressure and not key.startswith("mean_")  # by name
        if number is None or (waves and isinstance(number, dict | list)):
            continue
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise Damage(f"{place} is to hold numbers")
        if not low < number < high:
            raise Damage(f"{place} is a number that no result holds")


def _numeric(value: Any, depth: int) -> bool:
    if isinstance(value, dict | list) and depth <= DEEPEST:
        parts = value.values() if isinstance(value, dict) else value
        return all(_numeric(part, depth + 1) for part in parts)
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _sound(number: int | float) -> bool:
    return abs(number) <= LARGEST_NUMBER  # not so for NaN


def _below(place: str, key: object) -> str:
    name = str(key)
    name = name if name.isprintable() and len(name) <= 60 else repr(name[:60])
    return f"{place}.{name}" if place else name
