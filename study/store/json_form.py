"""Frozen dataclasses as JSON: written, described by a JSON Schema, and read back.

A field stands in a table under its name, or under that given with `under`. One whose value is
`ABSENT` is left out. Types are None, bool, int, float, str, Any, Literal, unions, list, tuple and
dict (with texts for keys) of them, other dataclasses, and named tuples, which are tables as well.
"""

import dataclasses
import enum
import functools
import pathlib
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, Literal, TypeVar, Union

_Kind = TypeVar("_Kind")

SCHEMA = "https://json-schema.org/draft/2020-12/schema"


class Absent(enum.Enum):
    """Of a key that may be left out; its only value says that it is."""

    ABSENT = "absent"


ABSENT = Absent.ABSENT


def under(key: str) -> dict[str, str]:
    """Metadata of a field that stands under another name than its own."""
    return {"key": key}


class _Part(typing.NamedTuple):
    """A part of a table.

    Attributes:
        attribute: its name in the class.
        key: its name in JSON.
        kind: its type.
        optional: whether it may be left out.
    """

    attribute: str
    key: str
    kind: Any
    optional: bool


@functools.cache
def _parts(kind: type) -> tuple[_Part, ...]:
    hints = typing.get_type_hints(kind)
    if dataclasses.is_dataclass(kind):
        names = {f.name: f.metadata.get("key", f.name) for f in dataclasses.fields(kind)}
    else:
        names = {name: name for name in kind._fields}  # pyright: ignore[reportAttributeAccessIssue]
    found = []
    for name, written in names.items():
        choices = [c for c in _choices(hints[name]) if c is not Absent]
        optional = len(choices) < len(_choices(hints[name]))
        of = Union[tuple(choices)] if optional else hints[name]  # noqa: UP007
        found.append(_Part(name, written, of, optional))
    return tuple(found)


def _choices(kind: Any) -> tuple[Any, ...]:
    union = typing.get_origin(kind) in (Union, types.UnionType)
    return typing.get_args(kind) if union else (kind,)


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and (
        dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))
    )


def as_json(value: Any) -> Any:
    """A value as JSON holds it: tables, lists, numbers, texts.

    Raises:
        TypeError: a part is of a type that JSON does not have.
    """
    if _is_table(type(value)):
        parts = ((part, getattr(value, part.attribute)) for part in _parts(type(value)))
        return {part.key: as_json(own) for part, own in parts if own is not ABSENT}
    match value:
        case None | bool() | int() | float() | str():
            return value
        case Mapping():
            return {str(name): as_json(own) for name, own in value.items()}
        case list() | tuple():
            return [as_json(own) for own in value]
        case pathlib.PurePath():
            return str(value)
        case _ if hasattr(value, "tolist"):  # numbers and arrays of NumPy
            return value.tolist()
        case _:
            raise TypeError(f"{type(value).__name__} cannot stand in JSON. Give plain values.")


def schema(kind: type, title: str) -> dict[str, Any]:
    """The JSON Schema of a dataclass.

    Args:
        kind: the dataclass.
        title: of the schema.
    """
    definitions: dict[str, Any] = {}
    _described(kind, definitions)
    own = definitions.pop(kind.__name__)
    return {"$schema": SCHEMA, "title": title, **own, "$defs": dict(sorted(definitions.items()))}


def _described(kind: Any, definitions: dict[str, Any]) -> dict[str, Any]:
    plain = {bool: "boolean", int: "integer", float: "number", str: "string", type(None): "null"}
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return {}
    if kind in plain:
        return {"type": plain[kind]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if len(_choices(kind)) > 1:
        return {"anyOf": [_described(choice, definitions) for choice in _choices(kind)]}
    if origin in (list, tuple):
        return {"type": "array", "items": _described(arguments[0], definitions)}
    if origin is not None and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _described(arguments[1], definitions)}
    if not _is_table(kind):
        raise TypeError(f"{kind} has no JSON Schema.")
    if kind.__name__ not in definitions:
        definitions[kind.__name__] = {}  # a table that holds itself ends here
        parts = _parts(kind)
        definitions[kind.__name__] = {
            "description": (kind.__doc__ or "").split("\n")[0],
            "type": "object",
            "properties": {
                part.key: _with_words(_described(part.kind, definitions), _words(kind, part))
                for part in parts
            },
            "required": [part.key for part in parts if not part.optional],
        }
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _with_words(found: dict[str, Any], words: str) -> dict[str, Any]:
    return {"description": words, **found} if words else found


def _words(kind: type, part: _Part) -> str:
    """What the class says of a part below `Attributes`."""
    return next((words for name, words in _attributes(kind) if name == part.attribute), "")


def _attributes(kind: type) -> Iterator[tuple[str, str]]:
    for base in kind.__mro__:
        _, found, text = (base.__doc__ or "").partition("Attributes:\n")
        entry: list[str] = []
        for line in [*text.split("\n"), "        end: "] if found else ():
            inside = line.removeprefix("        ")
            if line.startswith("        ") and not inside.startswith(" "):
                if entry:
                    name, _, words = " ".join(entry).partition(": ")
                    yield name, words
                entry = [inside]
            elif line.strip() and entry:
                entry.append(line.strip())


def from_json(kind: type[_Kind], value: Any, place: str = "") -> _Kind:
    """A value of a type from what JSON holds; keys that are not known are left out.

    Args:
        kind: the type.
        value: as JSON holds it.
        place: of the value in its document, for the message.

    Raises:
        ValueError: a part is missing or of another type; which, and where.
    """
    return _read(kind, value, place)


def _read(kind: Any, value: Any, place: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return value
    choices = _choices(kind)
    if len(choices) > 1:
        problems = []
        for choice in choices:
            try:
                return _read(choice, value, place)
            except ValueError as error:
                problems.append(error)
        raise max(problems, key=lambda error: len(str(error)))
    if origin is Literal and value in arguments:
        return value
    if kind in (type(None), bool, int, float, str) and _fits(kind, value):
        return float(value) if kind is float else value
    if origin in (list, tuple) and isinstance(value, list):
        return origin(_read(arguments[0], own, f"{place}[{k}]") for k, own in enumerate(value))
    if origin is dict and isinstance(value, Mapping):
        named = value.items()
        return {name: _read(arguments[1], own, _below(place, name)) for name, own in named}
    if _is_table(kind) and isinstance(value, Mapping):
        found = {}
        for part in _parts(kind):
            if part.key in value:
                found[part.attribute] = _read(part.kind, value[part.key], _below(place, part.key))
            elif not part.optional:
                raise ValueError(f"{_below(place, part.key)} is missing")
        return kind(**found)
    words = "a table" if _is_table(kind) else getattr(kind, "__name__", str(kind))
    raise ValueError(f"{place or 'the document'} is {type(value).__name__}, not {words}")


def _fits(kind: type, value: Any) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, kind)


def _below(place: str, name: object) -> str:
    return f"{place}.{name}" if place else str(name)
