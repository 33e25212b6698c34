"""JSON Schema of a case file and of a record, made from what their keys declare.

Editors that know TOML check a file against it while it is written; what needs more than one key (a
diastolic pressure below the systolic one, a file that exists) the reader alone checks. The version
is raised when a file that was valid is no longer. The schemas lie in ``study/data/schema``::

    python -m study.case.json_schema        write them again
"""

import dataclasses
import json
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

from study.case.anatomy import STATE
from study.case.condition import CONDITION_NAME, MOST_CONDITIONS
from study.case.ostium import Uncertain
from study.case.parameters import STRESS_FACTORS, ThicknessBounds
from study.case.schema import FREE_TEXT, Flag, Key, Quantity, Word, keys_of, readable, spellings
from study.case.sections import CASE, CONDITION_SLOT, RECORD, FileTable
from study.case.template import default_of

VERSION = 1

FOLDER = pathlib.Path(__file__).parents[1] / "data" / "schema"

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_TITLES = {"case": "A patient case of jaxfsi", "record": "A measured record of jaxfsi"}
KINDS = tuple(_TITLES)
"""Kinds of files that have a schema."""

_FROM_NAME = "drug"
"""A key that is required, unless the name of its condition says it."""

_FROM_BODY = ("P_systolic", "P_diastolic", "period")
"""Keys of a case's condition that [body] may tell instead."""

Schema = dict[str, Any]


def json_schema(kind: str) -> Schema:
    """The schema of a ``case`` or a ``record``."""
    sections = {"case": CASE, "record": RECORD}[kind]
    kinds = [section for section in sections if section.kind]
    tables: Schema = {}
    for section in sections:
        if section.heading == CONDITION_SLOT:
            tables["condition"] = _conditions(section)
        elif not section.kind:
            tables[section.heading] = _table(
                section.keys, section.text, _INNER.get(section.heading)
            )
    if kinds:
        tables["anatomy"] = {"oneOf": [_anatomy(section) for section in kinds]}
    return {
        "$schema": _DIALECT,
        "$id": f"urn:jaxfsi:{kind}:{VERSION}",
        "title": _TITLES[kind],
        **_object({**tables, **_FREE_TEXTS}),
        "required": ["patient"] if kind == "case" else ["patient", "condition"],
    }


def schema_text(kind: str) -> str:
    """The schema as it is published."""
    return json.dumps(json_schema(kind), indent=1, ensure_ascii=False) + "\n"


def schema_path(kind: str) -> pathlib.Path:
    """Where the schema lies in the package."""
    return FOLDER / f"{kind}-{VERSION}.json"


def _object(properties: Schema, **more: Any) -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": properties, **more}


_FREE_TEXTS: Schema = {name: {"type": "string"} for name in FREE_TEXT}


def _table(keys: Iterable[Key], text: str, inner: Mapping[str, Schema] | None = None) -> Schema:
    """A table with its keys in every unit, and the tables inside it."""
    every = tuple(keys)
    properties = {one.key: _value(one) for key in every for one in spellings(key)}
    needed = [key.key for key in every if key.required and key.name != _FROM_NAME]
    found = _object({**properties, **(inner or {}), **_FREE_TEXTS}, description=_flat(text))
    return {**found, **({"required": needed} if needed else {})}


def _value(key: Key) -> Schema:
    """What a key takes."""
    found: Schema
    match key:
        case Quantity():
            found = {"type": "integer" if key.whole else "number"}
            least, most = "minimum", "maximum"
            if key.exclusive:
                least, most = "exclusiveMinimum", "exclusiveMaximum"
            found |= {least: key.low, most: key.high}
            if key.unit:
                found["x-unit"] = readable(key.unit)
        case Flag():
            found = {"type": "boolean"}
        case Word(options=options) if options:
            found = {"enum": list(options)}
        case Word(pattern=pattern):
            found = {"type": "string", "pattern": f"^{pattern}$"}
        case _:
            found = {"type": "string", "minLength": 1}
    if isinstance(key, Quantity) and key.name in _TABLES_INSTEAD:
        value = Quantity("number", "", key.low, key.high, name="value", required=True)
        own = (value,) if key.name == "R0" else ()
        found = {"anyOf": [found, _table((*own, *_TABLES_INSTEAD[key.name]), "")]}
    if default_of(key) is not None:
        found["default"] = default_of(key)
    return {**found, "description": key.text} if key.text else found


_TABLES_INSTEAD = {"thickness_per_radius": keys_of(ThicknessBounds), "R0": keys_of(Uncertain)}
"""Keys that take a table as well as a number."""


def _conditions(section: FileTable) -> Schema:
    """Tables by the name of the condition; what [body] may tell instead is not required."""
    told = _FROM_BODY if section in CASE else ()
    keys = tuple(
        dataclasses.replace(key, required=key.required and key.name not in told)
        for key in section.keys
    )
    return {
        "type": "object",
        "properties": _FREE_TEXTS,
        "propertyNames": {"pattern": f"^{CONDITION_NAME}$"},
        "additionalProperties": _table(keys, section.text),
        "maxProperties": MOST_CONDITIONS,
    }


def _anatomy(section: FileTable) -> Schema:
    inner = {"kind": {"const": section.kind}, **_INNER.get(section.kind, {})}
    found = _table(section.keys, section.text, inner)
    return {**found, "required": ["kind", *found.get("required", ())]}


def _flat(text: str) -> str:
    return " ".join(text.split())


_POINT: Schema = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_CUT = _object(
    {"centre": _POINT, "normal": _POINT, "radius": {"type": "number", "exclusiveMinimum": 0.0}},
    required=["centre", "normal", "radius"],
)
_INNER: dict[str, dict[str, Schema]] = {
    "ivus": {"states": {"type": "object", "additionalProperties": _table(STATE, "")}},
    "surface": {
        "openings": {"type": "object", "additionalProperties": _POINT},
        "cuts": {"type": "object", "additionalProperties": _CUT},
    },
    "mesh": {"labels": {"type": "object", "additionalProperties": {"type": "string"}}},
    "stress": {"factors": _table(STRESS_FACTORS, "")},
}
"""Tables inside a table, by its name or kind."""


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in _TITLES:
        schema_path(name).write_text(schema_text(name), encoding="utf-8")
