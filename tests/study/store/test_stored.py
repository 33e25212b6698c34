"""Damage to stored documents: every key dropped or of another kind, and `show` afterwards."""

import copy
import json
import os
import pathlib
from collections.abc import Iterator
from typing import Any

import pytest

from study.store.layouts import FORMAT, LAYOUT
from study.store.stored_document import load_document

STORED = pathlib.Path(__file__).with_name("stored")

HAND_MADE: dict[str, dict[str, Any]] = {
    "study": {
        "patient": "p",
        "verdict": "It holds.",
        "rows": [
            {
                "condition": "rest",
                "rule": None,
                "measured": 0.9,
                "linear_0d": 0.91,
                "curve_0d": 0.92,
                "fsi": None,
            }
        ],
        "calibrations": [{"alpha": 0.2, "origin": "3D", "rest_ratio": 0.9, "error": 1e-4}],
        "notes": [{"level": "warning", "text": "coarse"}],
        "runs": [{"name": "rest", "history": [1.0]}],
    },
    "cohort": {
        "mode": "0d",
        "patients": [
            {"name": "a", "status": 0, "reason": ""},
            {"name": "b", "status": 2, "reason": "refused"},
        ],
        "groups": [
            {
                "condition": "rest",
                "rule": None,
                "boundary": "calibrated",
                "n": 2,
                "bias": 0.01,
                "sd": None,
                "rmse": 0.02,
            }
        ],
    },
    "sweep": {
        "patient": "p",
        "condition": "dobutamine",
        "rule": "linear",
        "law": "linear",
        "rows": [{"alpha": 0.1, "ffr": 0.9, "ifr": 0.9, "mean_flow_ml_per_min": 70.0}],
    },
}

KINDS = ("mesh", "simulate", "diagnose", *HAND_MADE)

NEW: dict[str, Any] = {
    "word": "a word",
    "null": None,
    "truth": True,
    "list": [[[]]],
    "table": {"x": {"y": 1}},
    "NaN": float("nan"),
    "infinity": float("-inf"),
    "1e300": 1e300,
    "long integer": 10**4000,
    "longer integer": "10**5000",
}

FOREIGN = ("Error", "Traceback", "NoneType", "object", "unsupported", "format code", "codec")
"""What Python says where a document is damaged."""


def _document(kind: str) -> dict[str, Any]:
    if kind in HAND_MADE:
        return {"format": "jaxfsi 1", "kind": kind, **HAND_MADE[kind]}
    return json.loads((STORED / f"{kind}.json").read_text(encoding="utf-8"))


def _places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if at:
        yield at
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for key, part in parts:
        if isinstance(part, dict | list):
            yield from _places(part, (*at, key))
        elif isinstance(value, dict):
            yield (*at, key)


def _changed(document: dict[str, Any], place: tuple[Any, ...], new: str) -> str:
    changed = copy.deepcopy(document)
    part = changed
    for key in place[:-1]:
        part = part[key]
    if new == "drop":
        del part[place[-1]]
    else:
        part[place[-1]] = NEW[new]
    return json.dumps(changed).replace('"10**5000"', "1" + 5000 * "0")


@pytest.mark.parametrize("kind", KINDS)
def test_sound_document_is_shown(kind, command, tmp_path):
    (tmp_path / "result.json").write_text(json.dumps(_document(kind)))
    shown = command("show", tmp_path / "result.json")
    assert (shown.status, shown.stderr) == (0, "")


def _show_damaged(command, kind: str, file: pathlib.Path, way: tuple[str, ...], each: int) -> None:
    """Damage every part, `each` of the ways in turn for one of them, and show it."""
    document, ways = _document(kind), ["drop", *NEW]
    refused = 0
    for k, place in enumerate(_places(document)):
        for new in {"drop", *(ways[(each * k + i) % len(ways)] for i in range(each))}:
            file.write_text(_changed(document, place, new))
            shown = command("show", file, *way)
            assert shown.status in (0, 2), (place, new, shown.stderr)
            absurd = new in ("NaN", "infinity", "1e300", "long integer", "longer integer")
            assert shown.status == 2 or not absurd, (place, new)
            if shown.status == 2:
                refused += 1
                assert "result.json: " in shown.stderr, (place, new, shown.stderr)
                assert not [w for w in FOREIGN if w in shown.stderr], (place, new, shown.stderr)
                assert shown.stderr.count("\n") == 3, (place, new, shown.stderr)
    assert refused > 0


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_document_is_shown_or_refused_in_a_sentence(kind, command, tmp_path):
    _show_damaged(command, kind, tmp_path / "result.json", (), 1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_document_damaged_in_every_way(kind, command, tmp_path):
    for way in ((), ("--json",)):
        _show_damaged(command, kind, tmp_path / "result.json", way, 1 + len(NEW))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (b'{"format": "jaxfsi 1",\n "kind" "run"}', "not valid JSON at line 2, column 9"),
        (b'{"kind": "\xe9"}', "not a UTF-8 text (byte 10 is 0xe9)"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"condition": "' + b"x" * 100_001 + b'"}', "condition is a text of 100001 characters"),
        (b'{"kind": "run", "kind": "mesh"}', "the key 'kind' appears twice"),
        (b'{"a": [0, {"b": NaN}]}', "a[1].b is a number that no result holds"),
        (b'{"a": {"P_mmHg": [1.0, "x"]}}', "a.P_mmHg is to hold numbers"),
        (b'{"runs": [{"ffr": true}]}', "runs[0].ffr is to hold numbers"),
        (b'{"mean_P_distal_mmHg": {"x": 1.0}}', "mean_P_distal_mmHg is to hold numbers"),
        (b'{"runs": [{"alpha": {"x": 1}}]}', "runs[0].alpha is to hold numbers"),
        (b'{"a": {"rest_ratio": 2.5}}', "a.rest_ratio is a number that no result holds"),
        (b'{"mean_P_aorta_mmHg": -7777}', "mean_P_aorta_mmHg is a number that no result holds"),
        (b'{"format": "jaxfsi 1", "kind": "run", "patient": "x"}', "verdict, or a part below it,"),
    ],
)
def test_place_of_the_damage_is_said(text, sentence, command, tmp_path):
    (tmp_path / "result.json").write_bytes(text)
    shown = command("show", tmp_path)
    assert shown.status == 2
    assert sentence in shown.stderr
    assert "try: " in shown.stderr


def test_document_that_is_read_equals_what_was_written(tmp_path):
    for kind in KINDS:
        (tmp_path / "result.json").write_text(json.dumps({**_document(kind), "format": FORMAT}))
        assert load_document(tmp_path) == {**_document(kind), "format": FORMAT}


def test_runs_of_an_older_study_have_an_id_once_read(tmp_path):
    runs = [{"folder": f"runs/{name}", "alpha": 0.2} for name in ("curve-rest", "loop1-rest")]
    document = {"format": "jaxfsi 1", "kind": "study", "runs": runs}
    document |= {"loop": {"alpha": 0.2}, "shown": ["loop1-rest"]}
    (tmp_path / "study.json").write_text(json.dumps(document))
    found = load_document(tmp_path)
    assert found["format"] == FORMAT
    assert [run["id"] for run in found["runs"]] == ["curve-rest", "loop1-rest"]
    assert found["loop"]["run"] == "loop1-rest"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (f"jaxfsi {LAYOUT + 1}", "a newer version of jaxfsi wrote it"),
        ("jaxfsi 0", "no result of jaxfsi"),
        ("jaxfsi ½", "no result of jaxfsi"),
        ("other 1", "no result of jaxfsi"),
        (None, "no result of jaxfsi"),
    ],
)
def test_layout_that_is_not_known_is_refused(name, sentence, command, tmp_path):
    (tmp_path / "study.json").write_text(json.dumps({"format": name, "kind": "study"}))
    shown = command("show", tmp_path)
    assert shown.status == 2
    assert sentence in shown.stderr
    assert "try: " in shown.stderr


@pytest.mark.parametrize("name", ["result.json", "mesh.json", "sweep.json"])
@pytest.mark.parametrize("target", ["/dev/zero", "pipe", "folder", "nowhere"])
def test_what_is_no_regular_file_is_refused_by_its_name(name, target, command, tmp_path):
    (tmp_path / "folder").mkdir()
    if target == "pipe":
        os.mkfifo(tmp_path / name)
    else:
        (tmp_path / name).symlink_to(target)
    shown = command("show", tmp_path)
    says = "cannot be opened" if target == "nowhere" else "no regular file"
    assert shown.status == 2
    assert f"{tmp_path / name}: {says}" in shown.stderr
    assert "try: " in shown.stderr


def test_folder_that_holds_numbers_alone_is_shown_and_has_no_page(command, tmp_path):
    (tmp_path / "sweep.json").write_text(json.dumps(_document("sweep")))
    shown = command("show", tmp_path)
    assert (shown.status, shown.stderr) == (0, "")
    assert "dobutamine" in shown.stdout
    drawn = command("show", tmp_path, folder=tmp_path / "page")
    assert drawn.status == 2
    assert "a result of this kind has no page" in drawn.stderr
    assert not (tmp_path / "page").exists()
