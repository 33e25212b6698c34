"""Reading the tables of a TOML file: every key checked, every fault collected.

Nothing is raised here. A reading leaves faults and free texts in its `Context`, so that all faults
of a file can be reported together.
"""

import dataclasses
import math
import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from study.case.advice import explain_wrong_unit, named_in_python, nearest, range_cure
from study.case.faults import Fault, shown, shown_key
from study.case.schema import (
    FREE_TEXT,
    Flag,
    Key,
    Location,
    Quantity,
    Value,
    readable,
    spellings,
    to_cgs,
)

ROUNDING = 0.005
"""Relative difference up to which two statements of one value are the same, rounded."""

_NUMBER_IN_QUOTES = re.compile(r"\s*[-+]?[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?\s*")


@dataclasses.dataclass(frozen=True)
class Context:
    """What a reading collects: the faults, and the free texts by key and table.

    Attributes:
        file: the file that is read.
        faults: the faults found so far.
        texts: `texts["source"]["condition.rest"]` is what that table says of its source.
        homes: for each key of the format, the heading of the table that it belongs to.
    """

    file: pathlib.Path
    faults: list[Fault]
    texts: dict[str, dict[str, str]]
    homes: Mapping[str, str]

    def add(self, key: str, value: object, problem: str, cure: str, allowed: str = "") -> None:
        """Add a fault of this file."""
        self.faults.append(Fault(self.file, key, value, problem, allowed, cure))


def read_table(
    table: object, heading: str, keys: Sequence[Key], context: Context, *, written: str = ""
) -> dict[str, Value]:
    """Read the keys of one table; faults go to the context.

    Args:
        table: the parsed table; anything but a table is a fault.
        heading: its dotted name, `condition.rest`.
        keys: the keys that it takes, besides the free texts.
        context: where faults and free texts are collected.
        written: how the file names the table, for the cures; by default `below [heading]`.

    Returns:
        Value by field, numbers in CGS; the default for a key that is absent, None for one at fault.
    """
    values: dict[str, Value] = {key.field: key.default for key in keys}
    written = written or f"below [{heading}]"
    if not isinstance(table, dict):
        context.add(
            heading,
            table,
            "a table is expected here",
            f"write [{heading}] on a line of its own and the keys below it",
        )
        return values
    known = {key.key: key for one in keys for key in spellings(one)}
    known |= {name: key for key in keys for name in key.older}
    first: dict[str, str] = {}
    meant: set[str] = set()
    for name, value in table.items():
        if name in known:
            key = known[name]
            found = _read_value(key, value, f"{heading}.{name}", context)
            other = first.setdefault(key.field, name)
            if other != name and contradict(found, values[key.field]):
                problem = f"contradicts {other} = {shown(table[other])}"
                context.add(f"{heading}.{name}", value, problem, "remove one of the two")
            values[key.field] = found if other == name else values[key.field]
        elif name in FREE_TEXT:
            _read_free_text(name, value, heading, context)
        else:
            meant.add(_refuse_unknown(name, value, heading, keys, table, context))
    for key in keys:
        if key.required and key.field not in first and key.key not in meant:
            value = "..." if isinstance(key, Quantity) else '"..."'
            cure = f"add {key.key} = {value} {written}"
            context.add(f"{heading}.{key.key}", None, "required, but missing", cure, key.allowed)
    return values


def contradict(one: object, other: object) -> bool:
    """Whether two statements of one value differ by more than rounding; None says nothing."""
    if one is None or other is None:
        return False
    if isinstance(one, float) and isinstance(other, float):
        return not math.isclose(one, other, rel_tol=ROUNDING)
    return one != other


def _read_value(key: Key, value: object, place: str, context: Context) -> Value:
    if isinstance(key, Quantity):
        return _read_number(key, value, place, context)
    if isinstance(key, Flag):
        if not isinstance(value, bool):
            context.add(place, value, "true or false is expected", "write true")
            return None
        return value
    if not isinstance(value, str):
        cure = f'put it in quotes: {key.key} = "..."'
        context.add(place, value, "a text is expected here", cure, key.allowed)
        return None
    if isinstance(key, Location):
        return _read_location(key, value, place, context)
    if key.options and value not in key.options:
        close = nearest(value, key.options)
        cure = f'write "{close}"' if close else "write one of the allowed values"
        context.add(place, value, "not one of the allowed values", cure, key.allowed)
        return None
    if not re.fullmatch(key.pattern, value):
        context.add(place, value, "not a valid name", f"write {key.described}", key.allowed)
        return None
    return value


def _read_number(key: Quantity, value: object, place: str, context: Context) -> float | int | None:
    unit = readable(key.unit)
    if isinstance(value, bool) or not isinstance(value, int | float):
        cure = f"give a number, in {unit}" if unit else "give a number"
        if isinstance(value, str) and _NUMBER_IN_QUOTES.fullmatch(value):
            cure = f"remove the quotes: {key.key} = {value.strip()}"
        context.add(place, value, "a number is expected here", cure, key.allowed)
        return None
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        cure = "give a finite number, or remove the key if the value is not known"
        context.add(place, value, "not a finite number", cure, key.allowed)
        return None
    if key.whole and not number.is_integer():
        cure = f"round it: {key.key} = {max(round(number), math.ceil(key.low))}"
        context.add(place, value, "a whole number is expected here", cure, key.allowed)
        return None
    if not key.holds(number):
        problem = "below the allowed range" if number <= key.low else "above the allowed range"
        context.add(place, value, problem, range_cure(key, number), key.allowed)
        return None
    return int(number) if key.whole else to_cgs(number, key)


def _read_location(key: Location, value: str, place: str, context: Context) -> pathlib.Path | None:
    path = context.file.parent / value
    kind = "file or folder" if key.folder else "file"
    cure = f"give the path of an existing {kind}, relative to {context.file.parent}"
    if "\\" in value:
        cure += ", with forward slashes"
    try:
        exists, is_file, is_folder = path.exists(), path.is_file(), path.is_dir()
        size = path.stat().st_size if is_file else 1
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no path of a file"
        context.add(place, value, f"the path cannot be used: {reason}", cure, key.allowed)
        return None
    if is_file and value.endswith(("/", "/.")):
        context.add(place, value, "the path names a folder, and this is a file", cure, key.allowed)
        return None
    if (is_file and size > 0) or (is_folder and key.folder):
        return path
    problem = "no such file"
    if exists:
        problem = "the file is empty" if is_file else "not a regular file"
    context.add(place, value, problem, cure, key.allowed)
    return None


def _read_free_text(name: str, value: object, heading: str, context: Context) -> None:
    if isinstance(value, str):
        context.texts[name][heading] = value
    else:
        place = f"{heading}.{name}" if heading else name
        context.add(place, value, "a text is expected here", f'write {name} = "..."', "a text")


def read_free_texts(table: Mapping[str, object], heading: str, context: Context) -> None:
    """Read the free texts of a table that has no other keys of its own."""
    for name in FREE_TEXT:
        if name in table:
            _read_free_text(name, table[name], heading, context)


def _refuse_unknown(
    name: str,
    value: object,
    heading: str,
    keys: Sequence[Key],
    table: Mapping[str, object],
    context: Context,
) -> str:
    """Add the fault of an unknown key; returns the key that was probably meant, or nothing."""
    place = f"{heading}.{shown_key(name)}"
    names = [key.key for one in keys for key in spellings(one)]
    valid = "keys " + ", ".join([*names, *FREE_TEXT])
    wrong_unit = explain_wrong_unit(name, value, [k for k in keys if isinstance(k, Quantity)])
    if cure := named_in_python(name):
        context.add(place, value, "unknown key", cure, valid)
        return ""
    if name in context.homes:
        home = context.homes[name]
        cure = f"move it below {home}, or remove it"
        context.add(place, value, "the key belongs elsewhere", cure, valid)
        return ""
    if wrong_unit is not None:
        quantity, problem, cure = wrong_unit
        meant = quantity.key
        allowed = quantity.allowed
    else:
        meant = nearest(name, [*names, *FREE_TEXT]) or ""
        problem, allowed = "unknown key", valid
        cure = f"the nearest valid key is {meant}" if meant else "remove it, or use a valid key"
    if meant and meant in table:
        cure = f"remove it: {meant} = {shown(table[meant])} is given as well"
    context.add(place, value, problem, cure, allowed)
    return meant


def check_order(
    values: Mapping[str, Any],
    lower: str,
    upper: str,
    heading: str,
    keys: Sequence[Key],
    table: Mapping[str, Any],
    context: Context,
    *,
    apart: bool = False,
) -> None:
    """Refuse a lower value above (with `apart`, or at) its upper one."""
    low, high = values.get(lower), values.get(upper)
    if low is None or high is None or low < high or (low == high and not apart):
        return
    key = {key.field: key.key for key in keys}
    problem = f"not below {key[upper]} = {table[key[upper]]:g}"
    cure = "check both values; swap them if they were exchanged"
    context.add(f"{heading}.{key[lower]}", table[key[lower]], problem, cure, f"below {key[upper]}")
