"""What kept numbers are valid under: every module decided on, and what does not count."""

import pathlib
import subprocess

import pytest

import study.store.numerics as numerics
from study.report.older_parts import older_parts
from study.run.study_parts import Code, Computed, ComputedPart
from study.store.numerics_manifest import Manifest, content_digest, read_manifest, write_manifest

SOURCE = b'''"""A law."""

from typing import Any

import numpy as np

STEP = 1.0e-3
"""Step [s]."""


def law(x: float, /) -> Any:
    """Its value."""
    if x < 0.0:
        raise ValueError(f"{x} is negative. Give more.")
    return np.sin(STEP * x)  # damped
'''


def test_every_module_is_sorted_and_every_change_decided():
    assert not numerics.unsorted(), (
        "put these modules into a part of study/store/numerics.py, or into WITHOUT_NUMBERS:"
        f" {', '.join(numerics.unsorted())}"
    )
    now = {part: numerics.part_digests(part) for part in numerics.PARTS}
    changed = numerics.undecided(read_manifest(), now)
    assert not changed, numerics.advice(changed)


def test_every_part_is_used_and_has_its_libraries_and_every_pattern_a_module():
    assert {part for parts in numerics.USES.values() for part in parts} == numerics.PARTS.keys()
    assert numerics.PARTS.keys() == numerics._LIBRARIES.keys()
    for part, patterns in {**numerics.PARTS, "none": numerics.WITHOUT_NUMBERS}.items():
        for pattern in patterns:
            assert any(numerics._fits(n, [pattern]) for n in numerics.modules()), (part, pattern)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("A law.", "Another word."),
        ("# damped", "# not damped, see elsewhere"),
        ("x: float, /) -> Any", "x: int, /) -> float"),
        ("from typing import Any", "from collections.abc import Sequence\nfrom typing import Any"),
        ("import numpy as np\n\nSTEP", "import numpy as np\n\n\n\nSTEP"),
        ("1.0e-3", "0.001"),
        ("Give more.", "Give another number."),
        ('"""Step [s]."""', ""),
    ],
)
def test_words_and_layout_are_no_numerical_content(old, new):
    changed = SOURCE.decode().replace(old, new)
    assert changed != SOURCE.decode()
    assert content_digest(changed.encode()) == content_digest(SOURCE)


@pytest.mark.parametrize(
    ("old", "new"),
    [("1.0e-3", "1.0e-4"), ("np.sin", "np.cos"), ("x < 0.0", "x <= 0.0"), ("as np", "as sp")],
)
def test_numbers_and_operations_are_numerical_content(old, new):
    assert content_digest(SOURCE.decode().replace(old, new).encode()) != content_digest(SOURCE)


def test_code_that_nobody_decided_on_enters_the_key_itself(monkeypatch):
    decided = numerics.version("march")
    assert decided.split("-")[0].isdecimal()
    real = numerics.part_digests("march")
    seen = set()
    for digest in ("one", "two"):
        edited = {**real, "jaxfsi/core/laws/fluid.py": digest}
        monkeypatch.setattr(numerics, "part_digests", lambda part, edited=edited: edited)
        seen.add(numerics.version("march"))
    assert len(seen) == 2
    assert all(text.startswith("undecided ") for text in seen)


NOW = {"a": {"p/x.py": "1", "p/y.py": "2"}, "b": {"p/y.py": "2"}}


@pytest.fixture
def manifest(tmp_path):
    path = tmp_path / "numerics.json"
    assert numerics.decide([], "new", path=path, now=NOW) == {}
    return path


def test_decision_must_name_every_part_that_changed(manifest):
    before = read_manifest(manifest)
    changed = {"a": {"p/x.py": "1", "p/y.py": "3"}, "b": {"p/y.py": "3"}}
    assert numerics.decide(["a"], None, path=manifest, now=changed) == {"b": ["p/y.py"]}
    assert read_manifest(manifest) == before
    assert numerics.decide(["a"], "b reads words of it", path=manifest, now=changed) == {}
    after = read_manifest(manifest)
    assert after.versions["a"] is not None
    assert after.versions["a"].startswith("2-")
    assert after.versions["b"] == before.versions["b"]
    assert not numerics.undecided(after, changed)


def test_module_that_comes_or_goes_is_named(manifest):
    found = numerics.undecided(read_manifest(manifest), {"a": {"p/z.py": "1"}, "b": {}})
    assert found == {"a": ["p/z.py"], "no part any more": ["p/x.py", "p/y.py"]}
    assert "p/z.py" in numerics.advice(found)
    assert "--same" in numerics.advice(found)


def _merged(base: pathlib.Path, ours: Manifest, theirs: Manifest) -> pathlib.Path:
    paths = [base.with_name(name) for name in ("ours.json", "theirs.json")]
    for path, manifest in zip(paths, (ours, theirs), strict=True):
        write_manifest(manifest, path)
    subprocess.run(["git", "merge-file", paths[0], base, paths[1]], check=False)
    return paths[0]


def test_decisions_on_neighbouring_modules_merge_without_a_conflict(manifest):
    base = read_manifest(manifest)
    ours = base._replace(modules={**base.modules, "p/x.py": "ours"})
    theirs = base._replace(modules={**base.modules, "p/y.py": "theirs"})
    found = _merged(manifest, ours, theirs)
    assert "<<<<" not in found.read_text()
    assert read_manifest(found).modules == {"p/x.py": "ours", "p/y.py": "theirs"}


def test_two_branches_that_raise_a_version_end_with_a_third(manifest):
    base = read_manifest(manifest)
    ours = base._replace(versions={**base.versions, "a": "2-aaaaaaaa"})
    theirs = base._replace(versions={**base.versions, "a": "2-bbbbbbbb"})
    found = _merged(manifest, ours, theirs)
    assert "<<<<" in found.read_text()
    assert "a" in numerics.undecided(read_manifest(found), NOW)
    assert numerics.decide([], "merged", path=found, now=NOW) == {}
    assert "<<<<" not in found.read_text()
    version = read_manifest(found).versions["a"]
    assert version is not None
    assert version.startswith("3-")


def _made(part, kept, **code):
    day = "2026-01-02T10:00:00" if kept else "2026-02-03T10:00:00"
    known = {"version": "0.1.0", "commit": "abc", "libraries": {"jax": "1"}, "numerics": {}}
    return ComputedPart(part=part, kept=kept, date=day, begun=day, **{**known, **code})


def test_page_says_which_parts_older_code_made():
    by = Code(version="0.1.0", commit="abc", libraries={"jax": "1"}, numerics={})
    parts = [
        _made("mesh", True),
        _made("ramp", True, commit="old"),
        _made("curve-rest", True, commit="old"),
        _made("loop1-rest", True, libraries={"jax": "0"}),
        _made("loop1-stress", False, commit="fresh"),
    ]
    told = list(older_parts(Computed(by, parts)))
    assert len(told) == 2
    assert told[0].startswith(
        "ramp, curve-rest: computed on 2026-01-02 by jaxfsi 0.1.0, commit old"
    )
    assert told[1].startswith("loop1-rest: ")
