# ruff: noqa: E501  tables of damage read best in long rows
"""Damage to one value of a table: which one, and what must become of it."""

import math
import random
from collections.abc import Callable
from typing import Any

from tests.fuzz.bounds import BOUNDS, WHOLE, is_impossible
from tests.fuzz.toml_text import Raw
from tests.fuzz.trial import Expected

FREE = frozenset({"source", "notes"})
PATHS = frozenset({
    "contours", "frame_table", "reference_point", "centerline", "aorta_centerline",
    "normal_centerline", "surface", "path", "fluid", "solid", "waveform", "file",
})  # fmt: skip
NAMES = frozenset({"id", "name"})

Change = tuple[Any, Expected]
Operator = Callable[[random.Random, str, Any], Change | None]
"""Gives the damaged value of a key and what must become of it; None: does not fit the key."""


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(key: str, value: float) -> Change:
    refused = (
        not math.isfinite(value)
        or is_impossible(key, value)
        or (key.rsplit(".")[-1] in WHOLE and value != int(value))
    )
    return value, "refused" if refused else "either"


def factor(rng: random.Random, key: str, value: Any) -> Change | None:
    """Another unit: tens, seconds for minutes, dyn/cm² for mmHg."""
    if not is_number(value) or not value:
        return None
    times = rng.choice([10.0, 60.0, 100.0, 1000.0, 1333.22, 7.50062])
    changed = value * times if rng.random() < 0.5 else value / times
    if key.rsplit(".")[-1] in WHOLE:
        changed = max(1, round(changed))
    return _number(key, changed)


def sign(_: random.Random, key: str, value: Any) -> Change | None:
    return _number(key, -value) if is_number(value) and value else None


def no_number(rng: random.Random, key: str, value: Any) -> Change | None:
    if not is_number(value):
        return None
    return rng.choice([math.nan, math.inf, -math.inf, Raw("+nan"), Raw("-nan")]), "refused"


def extreme(rng: random.Random, key: str, value: Any) -> Change | None:
    """Finite, and far beyond anything."""
    if not is_number(value):
        return None
    text = rng.choice(["1e300", "-1e300", "1e-300", "5e-324", "1.7976931348623157e308"])
    _, expected = _number(key, float(text))
    return Raw(text), expected


def zero(rng: random.Random, key: str, value: Any) -> Change | None:
    if not is_number(value):
        return None
    text = rng.choice(["0", "0.0", "-0.0", "-0"])
    return Raw(text), _number(key, 0.0)[1]


def huge_integer(rng: random.Random, key: str, value: Any) -> Change | None:
    if not is_number(value):
        return None
    digits = rng.choice([19, 25, 400, 5000])
    return Raw(rng.choice(["", "-"]) + "9" * digits), "refused" if _bounded(key) else "either"


def _bounded(key: str) -> bool:
    return key.rsplit(".")[-1] in BOUNDS


def another_type(rng: random.Random, key: str, value: Any) -> Change | None:
    """A value of a type that the key does not take."""
    name = key.rsplit(".")[-1]
    odd: list[Any] = [True, False, [], [value], {}, {"value": value}, [[1, [2]], "x"],
                      Raw("2024-01-01"), Raw("07:32:00"), [{"a": 1}, {"b": 2}]]  # fmt: skip
    if is_number(value):
        odd += ["", "0.8", "long", str(value), "NaN"]
    else:
        odd += [3, 0.5, -1]
    changed = rng.choice(odd)
    if name == "thickness_per_radius" and isinstance(changed, dict):
        return None
    if name in FREE and isinstance(changed, str):
        return None
    return changed, "refused"


def text(rng: random.Random, key: str, value: Any) -> Change | None:
    """Another text where one is expected."""
    if not isinstance(value, str):
        return None
    name = key.rsplit(".")[-1]
    if name in PATHS:
        return None
    odd = ["", " ", "x" * 5000, "ünïcödé ☤", "a\nb", "\x1b[31mred", "\x00", "../../etc", "/etc/passwd",
           value + " ", value.upper() + "X", "nul", "..", ".", "a/b", "'; --", "%s%n", "{0}",
           "\u202eevil", "<script>alert(1)</script>", "\ud7ff", "𝒳"]  # fmt: skip
    changed = rng.choice(odd)
    if name in FREE:
        return changed, "either"
    if name in NAMES:
        bad = not changed.strip() or "/" in changed or changed in (".", "..") or len(changed) > 300
        bad = bad or any(ord(c) < 32 for c in changed)
        return changed, "refused" if bad else "either"
    return changed, "refused" if changed != value else "same"


def notation(rng: random.Random, key: str, value: Any) -> Change | None:
    """The same number in another spelling."""
    if not is_number(value) or key.rsplit(".")[-1] in WHOLE:
        return None
    spellings = [f"{value:.17e}", f"+{value!r}" if value > 0 else repr(value)]
    if float(value) == int(value) and abs(value) < 1e15:
        spellings += [str(int(value)), f"{int(value)}.000"]
    else:
        spellings += [f"{value!r}"]
    chosen = rng.choice(spellings)
    return Raw(chosen), "same" if float(chosen) == float(value) else "either"


VALUE_OPERATORS: dict[str, Operator] = {
    "factor": factor,
    "sign": sign,
    "no number": no_number,
    "extreme": extreme,
    "zero": zero,
    "huge integer": huge_integer,
    "another type": another_type,
    "text": text,
    "notation": notation,
}
