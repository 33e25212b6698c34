# ruff: noqa: E501  tables of damage read best in long rows
"""Damage to the tables of a file: keys and tables that are missing, renamed, moved or doubled."""

import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

from tests.fuzz.toml_text import Tables, dumps
from tests.fuzz.trial import Expected
from tests.fuzz.values import FREE, VALUE_OPERATORS

Place = tuple[Any, ...]
"""Keys and positions that lead to a value."""


def leaves(tables: Any, at: Place = ()) -> Iterator[Place]:
    """Places of all values; a list of tables is entered, any other list is a value."""
    if isinstance(tables, dict):
        for key, value in tables.items():
            if key != "_inline":
                yield from leaves(value, (*at, key))
    elif isinstance(tables, list) and tables and isinstance(tables[0], dict):
        for k, value in enumerate(tables):
            yield from leaves(value, (*at, k))
    else:
        yield at


def get(tables: Any, place: Place) -> Any:
    for key in place:
        tables = tables[key]
    return tables


def put(tables: Tables, place: Place, value: Any) -> Tables:
    """The tables with another value at a place."""
    changed = copy.deepcopy(tables)
    get(changed, place[:-1])[place[-1]] = value
    return changed


def shown(place: Place) -> str:
    """A place as dotted keys, positions left out."""
    return ".".join(str(key) for key in place if not isinstance(key, int))


Damage = tuple[str, str, Expected]
"""Text of the file, the key that was damaged, what must become of it."""
Operator = Callable[[random.Random, Tables, frozenset[str]], Damage | None]


def _value(name: str) -> Operator:
    operator = VALUE_OPERATORS[name]

    def damage(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage | None:
        places = list(leaves(tables))
        rng.shuffle(places)
        for place in places:
            found = operator(rng, shown(place), get(tables, place))
            if found is not None:
                value, expected = found
                return dumps(put(tables, place, value)), shown(place), expected
        return None

    return damage


def drop(rng: random.Random, tables: Tables, required: frozenset[str]) -> Damage:
    """A key is missing."""
    place = rng.choice(list(leaves(tables)))
    changed = copy.deepcopy(tables)
    del get(changed, place[:-1])[place[-1]]
    return dumps(changed), shown(place), "refused" if shown(place) in required else "either"


def drop_table(rng: random.Random, tables: Tables, required: frozenset[str]) -> Damage:
    """A table is missing."""
    name = rng.choice([key for key, value in tables.items() if isinstance(value, dict | list)])
    changed = {key: value for key, value in tables.items() if key != name}
    # what an optional table must hold does not make the table itself required
    deep = 3 if name == "condition" else 2
    needed = any(
        key.split(".")[0] == name and key.count(".") < deep for key in required - {"anatomy.kind"}
    )
    return dumps(changed), name, "refused" if needed else "either"


def rename(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """A key is spelt otherwise: never the name of another key."""
    place = rng.choice([p for p in leaves(tables) if len(p) > 1 or p[-1] == "id"])
    key = str(place[-1])
    k = rng.randrange(len(key))
    other = rng.choice([
        key[:k] + key[k + 1 :] + "q", key[: k + 1] + key[k:], key.upper() + "_", "x" + key, key + " ",
        key.replace("mmHg", "kPa") + "_", key + "_kg", "", "ключ", key[:k] + "\t" + key[k:],
        "a" * 3000, "__proto__", key.replace("_", "-") + "-",
    ])  # fmt: skip
    changed = copy.deepcopy(tables)
    table = get(changed, place[:-1])
    if other in table or place[-2:-1] in (("openings",), ("labels",), ("factors",)):
        other = key + "_q"
    table[other] = table.pop(place[-1])
    named_freely = len(place) > 1 and place[-2] in ("openings", "cuts", "labels")
    return dumps(changed), shown(place), "either" if named_freely else "refused"


def rename_table(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """A table is spelt otherwise."""
    name = rng.choice([key for key, value in tables.items() if isinstance(value, dict | list)])
    other = rng.choice(
        [name + "s", name.upper(), name[:-1], "x" + name, f"{name}.{name}", "\u200b" + name]
    )
    changed = {(other if key == name else key): value for key, value in tables.items()}
    return dumps(changed), name, "refused"


def move(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage | None:
    """A key stands in another table, where it is not known."""
    place = rng.choice([p for p in leaves(tables) if len(p) > 1])
    key, value = place[-1], get(tables, place)
    homes = [
        name for name, table in tables.items()
        if isinstance(table, dict) and key not in table and name not in ("condition", *place)
    ]  # fmt: skip
    if not homes or key in FREE:
        return None
    changed = copy.deepcopy(tables)
    del get(changed, place[:-1])[key]
    home = rng.choice(homes)
    changed[home][key] = value
    # both the wall and the blood have a density
    known = key == "density_g_per_cm3"
    return dumps(changed), shown(place), "either" if known else "refused"


def twice(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """A key or a table stands there twice."""
    text = dumps(tables)
    lines = text.splitlines()
    k = rng.choice([k for k, line in enumerate(lines) if " = " in line and line[0] != "["])
    if rng.random() < 0.7:
        return (
            "\n".join([*lines[:k], lines[k], *lines[k:]]) + "\n",
            lines[k].split(" = ")[0],
            "refused",
        )
    heads = [line for line in lines if line.startswith("[") and not line.startswith("[[")]
    head = rng.choice(heads)
    return text + head + "\n", head, "refused"


def unknown(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """A key or table that nobody knows."""
    changed = copy.deepcopy(tables)
    homes = [name for name, table in tables.items() if isinstance(table, dict)]
    value = rng.choice([1, "x", True, [1, 2], {"a": 1}, 1e300])
    name = rng.choice(["zzz", "P", "R0", "ffr_percent", "heart_rate_bpm", "weight_kg", "", "a b"])
    if rng.random() < 0.5:
        changed[name] = value
        return dumps(changed), name, "refused"
    home = rng.choice([h for h in homes if h not in ("condition",)])
    changed[home][name] = value
    return dumps(changed), f"{home}.{name}", "refused"


def another_order(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """The same tables and keys in another order."""

    def shuffled(part: Any) -> Any:
        if not isinstance(part, dict):
            return part
        keys = list(part)
        rng.shuffle(keys)
        return {key: shuffled(part[key]) for key in keys}

    changed = shuffled(tables)
    # what stands above all tables must stay there
    return dumps(changed), "all", "same"


def spelling(rng: random.Random, tables: Tables, _: frozenset[str]) -> Damage:
    """The same tables in another way of TOML to write them."""
    text = dumps(tables)
    way = rng.choice(["inline", "dotted", "comments", "blanks", "crlf"])
    if way == "inline":
        return dumps(tables, inline=True), way, "same"
    if way == "dotted":
        return dumps(tables, dotted=True), way, "same"
    if way == "comments":
        return (
            "".join(f"# é {k}\n{line}  # = [x]\n" for k, line in enumerate(text.splitlines())),
            way,
            "same",
        )
    if way == "crlf":
        return text.replace("\n", "\r\n"), way, "same"
    return "\n\n" + "".join(f"\t {line}\t \n\n" for line in text.splitlines()), way, "same"


TABLE_OPERATORS: dict[str, Operator] = {
    **{name: _value(name) for name in VALUE_OPERATORS},
    "drop": drop,
    "drop table": drop_table,
    "rename": rename,
    "rename table": rename_table,
    "move": move,
    "twice": twice,
    "unknown": unknown,
    "another order": another_order,
    "spelling": spelling,
}
