"""Damaged stored results: `show`, and the commands that go on from what lies in a folder."""

import json
import random
from collections.abc import Iterator
from typing import Any

from tests.fuzz.octets import BYTE_OPERATORS
from tests.fuzz.oracle import DERIVATIVE
from tests.fuzz.tables import Place, get, leaves, put, shown
from tests.fuzz.trial import Content, Expected, Files, Trial

KIND = "stored"
SENTINEL, ODD_NUMBER = "SENTINEL☠", -7777.25
QUANTITIES = ("ffr", "rest_ratio", "alpha", "R0", "mean_P_aorta_mmHg", "mean_P_distal_mmHg")
OPERATORS = (
    "word for a number", "odd number", "nan", "1e300", "null", "list", "table", "boolean", "drop",
    "drop table", "rename", "empty table", "empty list", "huge integer", "number for a word",
    "kind", "format", "another kind", "deep", "key twice", "top is a list", "long text", "control",
)  # fmt: skip


def trials(count: int, seed: int, good: dict[str, bytes]) -> Iterator[Trial]:
    """Damaged documents for `show`, each document and operator in turn.

    Args:
        count: how many.
        seed: of the damage.
        good: stored documents by name.
    """
    rng = random.Random(f"{KIND} {seed}")
    octets = [name for name in BYTE_OPERATORS if name != "marked"]
    plan = [(name, operator) for name in good for operator in (*OPERATORS, *octets)]
    rng.shuffle(plan)
    done = 0
    while done < count:
        for name, operator in plan:
            if done == count:
                return
            trial = one(random.Random(rng.random()), name, operator, good)
            if trial is not None:
                done += 1
                yield trial


def one(rng: random.Random, name: str, operator: str, good: dict[str, bytes]) -> Trial | None:
    """One damaged document."""
    data = good[name]
    key, expected = operator, "either"
    content: Content
    if operator in BYTE_OPERATORS:
        content, expected = BYTE_OPERATORS[operator](rng, data)
        if operator == "truncated" and isinstance(content, bytes):
            expected = "refused" if len(content.strip()) < len(data.strip()) else "either"
        if operator == "latin-1":
            expected = "refused"
    else:
        found = structured(rng, json.loads(data), operator, good)
        if found is None:
            return None
        text, key, expected = found
        content = text.encode("utf-8", "surrogatepass")
    files: Files = {f"res/{name}": content}
    way = rng.choice(["file", "folder", "page", "json"])
    place = "{}/res" if way == "folder" else f"{{}}/res/{name}"
    argv = ["show", place]
    if way == "page":
        argv += ["--out", "{}/out"]
    if way == "json":
        argv += ["--json"]
    wanted: Expected = "either" if expected == "same" else expected  # pyright: ignore
    return Trial(KIND, operator, f"{name}: {key} ({way})", wanted, files, tuple(argv), blame=name)


def structured(
    rng: random.Random, document: dict[str, Any], operator: str, good: dict[str, bytes]
) -> tuple[str, str, Expected] | None:
    """Text of the document, what was damaged, what must become of it."""
    places = [place for place in leaves(document) if place[-1:] != ("_inline",)]
    top: dict[str, tuple[str, str, Expected]] = {
        "kind": (
            _text({**document, "kind": rng.choice(["runn", 3, None, [], "", "RUN"])}),
            "kind",
            "refused",
        ),
        "format": (
            _text({**document, "format": rng.choice(["jaxfsi 999", 1, None, "x"])}),
            "format",
            "refused",
        ),
        "deep": ('{"format": "jaxfsi 1", "kind": "run", "a": ' + "[" * 200_000, "all", "refused"),
        "top is a list": (_text([document]), "all", "refused"),
    }
    if operator in top:
        return top[operator]
    if operator == "another kind":
        other = json.loads(good[rng.choice(sorted(good))])
        kind = other.get("kind")
        expected: Expected = "either" if kind == document.get("kind") else "refused"
        return _text({**document, "kind": kind}), f"kind {kind}", expected
    if operator == "key twice":
        text = _text(document)
        return text.replace('"kind"', '"kind": "mesh", "kind"', 1), "kind", "either"
    if operator in ("drop table", "empty table", "empty list"):
        return _whole_part(rng, document, operator)
    return _leaf(rng, document, operator, places)


def _whole_part(
    rng: random.Random, document: dict[str, Any], operator: str
) -> tuple[str, str, Expected] | None:
    parts = [key for key, value in document.items() if isinstance(value, dict | list) and value]
    if not parts:
        return None
    name = rng.choice(parts)
    if operator == "drop table":
        return _text({k: v for k, v in document.items() if k != name}), name, "either"
    value: Any = {} if operator == "empty table" else []
    return _text({**document, name: value}), name, "either"


_VALUES: dict[str, Any] = {
    "word for a number": SENTINEL,
    "odd number": ODD_NUMBER,
    "nan": float("nan"),
    "1e300": 1e300,
    "null": None,
    "list": [SENTINEL, [1]],
    "table": {SENTINEL: 1},
    "boolean": True,
    "huge integer": int("9" * 400),
}


def _leaf(
    rng: random.Random, document: dict[str, Any], operator: str, places: list[Place]
) -> tuple[str, str, Expected] | None:
    numbers = [p for p in places if isinstance(get(document, p), float)]
    words = [p for p in places if isinstance(get(document, p), str) and len(p) > 0]
    named = [p for p in numbers if p[-1] in QUANTITIES and not DERIVATIVE.search(shown(p))]
    if operator in ("number for a word", "long text", "control"):
        place = rng.choice(words)
        value: Any = {
            "number for a word": 5,
            "long text": "x" * 3_000_000,
            "control": "\x1b[2J\x07\x00",
        }[operator]
        return _text(put(document, place, value)), shown(place), "either"
    place = rng.choice(named if named and rng.random() < 0.6 else numbers or places)
    if operator == "drop":
        holder = get(document, place[:-1])
        if not isinstance(holder, dict):
            return None
        changed = put(document, place, None)
        del get(changed, place[:-1])[place[-1]]
        return _text(changed), shown(place), "either"
    if operator == "rename":
        holder = get(document, place[:-1])
        if not isinstance(holder, dict):
            return None
        changed = put(document, place, None)
        part = get(changed, place[:-1])
        part[str(place[-1]) + "_q"] = get(document, place)
        del part[place[-1]]
        return _text(changed), shown(place), "either"
    refused = operator == "nan" or (operator in _VALUES and place in named)
    if operator == "null" or (operator == "boolean" and place not in named):
        refused = False
    return (
        _text(put(document, place, _VALUES[operator])),
        shown(place),
        "refused" if refused else "either",
    )


def _text(document: Any) -> str:
    return json.dumps(document, indent=1, ensure_ascii=False)
