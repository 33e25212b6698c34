"""Advice for a key or a value that does not fit: which one was meant, and in which unit.

A key is compared with the valid ones, first by quantity and unit, then by spelling. A value outside
its range is read in the other units of its dimension; where one of them gives a usual value, that
slip is named.
"""

import difflib
import math
from collections.abc import Sequence

from study.case.schema import BEATS_PER_MINUTE, Quantity, convert, other_units, readable

_USUAL_SPREAD = math.log(20.0)
"""How far from a usual value a re-read value may lie for its unit to be suggested."""

_LARGEST_CONVERTED = 1e200
"""Larger numbers are nonsense in any unit, and integers beyond it may not fit a float."""


_CLOSE = 0.6
"""Part of two names that must agree: prestress and support_stiffness share 0.54."""

_HEART_RATES = ("heart_rate", "hr")
"""Keys that hold a rate where a period is expected."""

_IN_PYTHON = {
    ("support", "tissue"): "tissue outside the wall stands in a table of its own, [tissue], with"
    " stiffness_dyn_per_cm3 and damping_dyn_s_per_cm3",
}
"""Where a case file has what Python calls otherwise, by how the names begin."""


def nearest(name: str, candidates: Sequence[str]) -> str | None:
    """The candidate that a misspelt or shortened name resembles most, in any case of letters."""
    lower = {candidate.lower(): candidate for candidate in candidates}
    short = [full for full in lower if len(name) > 2 and full.startswith(name.lower())]
    found = short or difflib.get_close_matches(name.lower(), lower, n=3, cutoff=_CLOSE)
    if not found:
        return None
    alike = [one for one in found if _likeness(one, name) >= _likeness(found[0], name)]
    return lower[next((one for one in alike if one[0] == name[0].lower()), alike[0])]


def _likeness(one: str, name: str) -> float:
    return difflib.SequenceMatcher(None, one, name.lower()).ratio()


def named_in_python(name: str) -> str | None:
    """The cure for a name of the Python interface that input files spell otherwise."""
    cures = (cure for starts, cure in _IN_PYTHON.items() if name.lower().startswith(starts))
    return next(cures, None)


def explain_wrong_unit(
    name: str, value: object, quantities: Sequence[Quantity]
) -> tuple[Quantity, str, str] | None:
    """The quantity that a key means when only its unit (or its spelling) is wrong.

    Args:
        name: the key found.
        value: its value.
        quantities: the quantities of the table.

    Returns:
        The quantity meant, the problem and the cure; None if the key means none of them.
    """
    match = _same_quantity(name, quantities)
    if match is None:
        return None
    quantity, suffix = match
    is_rate = name.lower() in _HEART_RATES and quantity.dimension == "time"
    unit = BEATS_PER_MINUTE if is_rate else _known_unit(suffix, quantity)
    expected = readable(quantity.unit) or "a plain number"
    if unit == quantity.unit and unit:
        problem = "unknown key"
    elif is_rate:
        problem = f"the period is expected in place of the heart rate, in {expected}"
    elif suffix:
        problem = f"the key ends in {readable(suffix)}; the unit expected is {expected}"
    else:
        problem = f"the key carries no unit; the unit expected is {expected}"
    cure = f"write {quantity.key}, in {expected}"
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else None
    if unit is not None and number is not None and abs(number) < _LARGEST_CONVERTED:
        cure = f"write {quantity.key} = {_converted(float(number), unit, quantity)}"
        if unit == BEATS_PER_MINUTE:
            cure += " (period = 60 s / heart rate)"
        elif unit != quantity.unit:
            factor = f"{convert(1.0, unit, quantity):.6g} {readable(quantity.unit)}".strip()
            cure += f" (1 {readable(unit)} = {factor})"
    elif not suffix and number is not None and abs(number) < _LARGEST_CONVERTED:
        cure = f"write {quantity.key} = {number:g} if that is in {expected}"
    return quantity, problem, cure


def range_cure(key: Quantity, value: float) -> str:
    """What to try for a value out of range; names the unit that it seems to be in."""
    unit = readable(key.unit)
    readings = {other: convert(value, other, key) for other in other_units(key)}
    strange = {
        u: _strangeness(reading, key) for u, reading in readings.items() if key.holds(reading)
    }
    guess = min(strange, key=strange.__getitem__, default=None)
    if guess is not None and strange[guess] < _USUAL_SPREAD:
        looks = f"{value:g} looks like {readable(guess)}: {_converted(value, guess, key)} {unit}"
        return f"{unit} expected; {looks}" if unit else looks.strip()
    if key.holds(-value):
        return f"check the sign: {-value:g} would be accepted"
    return key.advice or (f"check the value and its unit ({unit})" if unit else "check the value")


def _strangeness(value: float, key: Quantity) -> float:
    """Distance in log space from a usual value: the default, or the middle of the range."""
    usual = key.usual or math.sqrt(abs(key.low * key.high)) or abs(key.high)
    ratio = abs(value / usual)
    return abs(math.log(ratio)) if ratio else math.inf


def _converted(value: float, unit: str, key: Quantity) -> str:
    return f"{convert(value, unit, key):.4g}"


def _same_quantity(name: str, quantities: Sequence[Quantity]) -> tuple[Quantity, str] | None:
    lower = name.lower()
    stems = [(stem.lower(), q) for q in quantities for stem in (q.name, *q.aliases)]
    for stem, quantity in sorted(stems, key=lambda pair: -len(pair[0])):
        if lower == stem and quantity.unit:
            return quantity, ""
        suffix = name[len(stem) + 1 :]
        if lower.startswith(stem + "_") and suffix:
            if quantity.unit or _known_unit(suffix, quantity) is not None:
                return quantity, suffix
    return None


def _known_unit(suffix: str, quantity: Quantity) -> str | None:
    if not suffix:
        return None
    units = other_units(quantity)
    if suffix in units:
        return suffix
    return {unit.lower(): unit for unit in units}.get(suffix.lower())
