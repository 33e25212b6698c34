"""Dataclasses as JSON: what is written is described by the schema, and read back as it was."""

import dataclasses
import json
from typing import Literal, NamedTuple

import pytest

from study.store.json_form import ABSENT, Absent, as_json, from_json, schema, under


class Pair(NamedTuple):
    """Two numbers."""

    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Inner:
    """A part.

    Attributes:
        x_mm: places
            along a line.
        kind: which.
    """

    x_mm: list[float | None]
    kind: Literal["a", "b"]


@dataclasses.dataclass(frozen=True)
class Outer:
    """A document."""

    count: int
    inner: dict[str, Inner]
    pairs: list[Pair]
    text: str | None
    more: float | Absent = ABSENT
    odd: float = dataclasses.field(default=1.0, metadata=under("0.1_mm"))


WHOLE = Outer(3, {"first": Inner([1.0, None], "a")}, [Pair(0.5, 2.0)], None, more=4.0)


@pytest.mark.parametrize("value", [WHOLE, dataclasses.replace(WHOLE, more=ABSENT, text="x")])
def test_what_is_written_is_read_back(value):
    assert from_json(Outer, json.loads(json.dumps(as_json(value)))) == value


def test_absent_is_left_out_and_a_key_may_be_no_name():
    written = as_json(dataclasses.replace(WHOLE, more=ABSENT))
    assert list(written) == ["count", "inner", "pairs", "text", "0.1_mm"]
    assert written["pairs"] == [{"low": 0.5, "high": 2.0}]


def test_schema_says_types_words_and_what_is_required():
    found = schema(Outer, "test")
    assert found["required"] == ["count", "inner", "pairs", "text", "0.1_mm"]
    assert found["properties"]["text"] == {"anyOf": [{"type": "string"}, {"type": "null"}]}
    inner = found["$defs"]["Inner"]["properties"]
    assert inner["x_mm"]["description"] == "places along a line."
    assert inner["kind"]["enum"] == ["a", "b"]
    assert found["properties"]["more"] == {"type": "number"}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"count": 1.5}, "count is float, not int"),
        ({"count": True}, "count is bool, not int"),
        ({"inner": {"a": {"kind": "a"}}}, "inner.a.x_mm is missing"),
        ({"inner": {"a": {"x_mm": [0.0, "x"], "kind": "a"}}}, "inner.a.x_mm[1] is str"),
        ({"inner": {"a": {"x_mm": [], "kind": "c"}}}, "inner.a.kind is str"),
        ({"pairs": {}}, "pairs is dict, not list"),
    ],
)
def test_damage_is_named_with_its_place(change, sentence):
    with pytest.raises(ValueError, match=r".") as refused:
        from_json(Outer, {**as_json(WHOLE), **change})
    assert sentence in str(refused.value)
