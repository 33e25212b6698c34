"""Documents as classes: examples of results are read as what they are, schemas describe all."""

import json
import pathlib

import pytest

from study.report.documents import KINDS, document_schema, schema_path, schema_text, typed
from study.store.json_form import ABSENT, as_json
from study.store.layouts import FORMAT
from study.store.result_files import KINDS as RESULTS
from study.store.stored_document import load_document

EXAMPLES = pathlib.Path(__file__).with_name("examples")
OLDER = pathlib.Path(__file__).parents[2] / "store" / "stored"
STORED = [kind for kind in KINDS if kind != "study"]  # a study is made anew in test_study


def _example(kind: str) -> dict:
    return json.loads((EXAMPLES / f"{kind}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("kind", STORED)
def test_typed_document_holds_every_key_of_a_result(kind):
    document = _example(kind)
    found = typed(load_document(EXAMPLES / f"{kind}.json"))
    assert type(found).__name__ == KINDS[kind][1]
    assert as_json(found) == document


def test_every_command_that_stores_a_result_has_a_schema():
    assert set(KINDS) == set(RESULTS)


@pytest.mark.parametrize("kind", ["diagnose", "mesh", "simulate"])
def test_result_of_the_first_layout_is_read(kind, tmp_path):
    older = json.loads((OLDER / f"{kind}.json").read_text(encoding="utf-8"))
    assert older["format"] == "jaxfsi 1"
    example = _example(kind)
    del example["provenance"]["options"]
    cut = {key: part for key, part in example.items() if key not in older}
    (tmp_path / "result.json").write_text(json.dumps({**older, **cut}))
    found = typed(load_document(tmp_path))
    assert found.provenance.options is ABSENT
    assert as_json(found) == {**older, **cut, "format": FORMAT}


@pytest.mark.parametrize("kind", STORED)
def test_key_that_is_missing_is_named(kind):
    document = _example(kind)
    required = document_schema(kind)["required"]
    assert set(required) <= set(document)
    for key in required:
        damaged = {name: part for name, part in document.items() if name != key}
        with pytest.raises((ValueError, KeyError), match=f"{key}"):
            typed(damaged)


def _agrees(value, schema, definitions) -> bool:
    """Whether a value fits a schema; as much of JSON Schema as the documents use."""
    if "$ref" in schema:
        return _agrees(value, definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions)
    if "anyOf" in schema:
        return any(_agrees(value, choice, definitions) for choice in schema["anyOf"])
    if "enum" in schema:
        return value in schema["enum"]
    match schema.get("type"):
        case "object":
            parts, other = schema.get("properties", {}), schema.get("additionalProperties", {})
            return (
                isinstance(value, dict)
                and set(schema.get("required", ())) <= set(value)
                and all(_agrees(v, parts.get(k, other), definitions) for k, v in value.items())
            )
        case "array":
            whole = isinstance(value, list)
            return whole and all(_agrees(part, schema["items"], definitions) for part in value)
        case "null":
            return value is None
        case "boolean":
            return isinstance(value, bool)
        case "integer":
            return isinstance(value, int) and not isinstance(value, bool)
        case "number":
            return isinstance(value, int | float) and not isinstance(value, bool)
        case "string":
            return isinstance(value, str)
    return set(schema) <= {"description"}


@pytest.mark.parametrize("kind", STORED)
def test_schema_describes_a_result(kind):
    document, schema = _example(kind), document_schema(kind)
    assert _agrees(document, schema, schema["$defs"])
    for key in schema["required"]:
        wrong = {**document, key: {"no": [["such"], "thing"]}}
        assert not _agrees(wrong, schema, schema["$defs"]), key


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_described(kind):
    schema = document_schema(kind)
    tables = {kind: schema, **schema["$defs"]}
    bare = [
        f"{name}.{key}"
        for name, table in tables.items()
        for key, part in table["properties"].items()
        if not part.get("description")
    ]
    assert bare == []


@pytest.mark.parametrize("kind", KINDS)
def test_published_schema_is_that_of_the_class(kind):
    again = "write it again: python -m study.report.documents"
    assert schema_path(kind).read_text(encoding="utf-8") == schema_text(kind), again


@pytest.mark.parametrize("kind", KINDS)
def test_command_prints_the_schema(kind, command, tmp_path):
    assert json.loads(command("show", "--schema", kind).stdout) == document_schema(kind)
    written = command("show", "--schema", kind, folder=tmp_path)
    assert json.loads((tmp_path / f"{kind}.schema.json").read_text()) == document_schema(kind)
    again = command("show", "--schema", kind, folder=tmp_path)
    assert (written.status, again.status) == (0, 2)
    assert "exists already" in again.stderr


@pytest.mark.parametrize(("asked", "says"), [("plans", "try plan, or"), ("x", "; choose from")])
def test_kind_that_is_none_is_refused_with_those_there_are(asked, says, command):
    refused = command("show", "--schema", asked)
    assert refused.status == 2
    assert f"there is no kind of result '{asked}'" in refused.stderr
    assert says in refused.stderr
    assert ", ".join(KINDS) in refused.stderr
