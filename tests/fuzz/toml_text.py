"""A TOML text from tables: only what case files and records need, in several spellings."""

import math
import re
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")

Tables = dict[str, Any]


class Raw(str):
    """A value that stands in the file as it is."""


def key_text(key: str) -> str:
    """A key, in quotes where it needs them."""
    return key if _BARE.fullmatch(key) else _string(key)


def value_text(value: Any) -> str:
    """A value on one line."""
    match value:
        case Raw():
            return str(value)
        case bool():
            return str(value).lower()
        case str():
            return _string(value)
        case float() if math.isnan(value):
            return "nan"
        case float() if math.isinf(value):
            return "inf" if value > 0 else "-inf"
        case list():
            return "[" + ", ".join(value_text(part) for part in value) + "]"
        case dict():
            inside = ", ".join(
                f"{key_text(k)} = {value_text(v)}" for k, v in value.items() if k != "_inline"
            )
            return "{ " + inside + " }"
        case _:
            return repr(value)


def _string(text: str) -> str:
    escaped = "".join(
        f"\\u{ord(c):04x}" if ord(c) < 32 or ord(c) == 127 else "\\" + c if c in '"\\' else c
        for c in text
    )
    return f'"{escaped}"'


def dumps(tables: Tables, *, inline: bool = False, dotted: bool = False) -> str:
    """The text of some tables.

    Args:
        tables: by name; lists of dictionaries become arrays of tables.
        inline: tables stand on one line each.
        dotted: keys are written with all their tables, without headings.
    """
    if inline:
        return "".join(f"{key_text(k)} = {value_text(v)}\n" for k, v in tables.items())
    if dotted:
        return "".join(_dotted("", tables))
    return _section("", tables)


def _dotted(at: str, tables: Tables) -> list[str]:
    lines = []
    for key, value in tables.items():
        name = f"{at}.{key_text(key)}" if at else key_text(key)
        if isinstance(value, dict) and value and not value.get("_inline"):
            lines += _dotted(name, value)
        else:
            lines.append(f"{name} = {value_text(value)}\n")
    return lines


def _section(at: str, tables: Tables) -> str:
    own, below = [], []
    for key, value in tables.items():
        name = f"{at}.{key_text(key)}" if at else key_text(key)
        if isinstance(value, dict) and not value.get("_inline"):
            below.append(f"[{name}]\n{_section(name, value)}")
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            below += [f"[[{name}]]\n{_section(name, part)}" for part in value]
        else:
            own.append(f"{key_text(key)} = {value_text(value)}\n")
    return "".join(own) + "".join(below)
