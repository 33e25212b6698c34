"""What a refusal says: short, in the words of the format, and before any heavy work."""

import pathlib
import time
import tracemalloc

import numpy as np
import pytest

from study import CaseError, mesh_case, read_case
from study.faults import Fault
from study.progress import Progress
from tests.study import tube_case

HEAD = '[patient]\nid = "a"\n'


def said_of(folder: pathlib.Path, text: str) -> str:
    file = folder / "case.toml"
    file.write_text(text)
    with pytest.raises(CaseError) as caught:
        read_case(file)
    return str(caught.value)


def test_of_many_faults_the_first_are_said_and_the_others_counted(tmp_path):
    said = said_of(tmp_path, HEAD + "".join(f"[unknown_{k}]\n" for k in range(300)))
    assert said.startswith("the input was refused: 300 faults")
    assert "unknown_9:" in said
    assert "unknown_10" not in said
    assert said.endswith(f"{tmp_path / 'case.toml'}: and 290 more")


def test_each_file_has_its_faults_said():
    faults = [Fault(pathlib.Path(name), "", None, "wrong", "", "mend") for name in "ab" * 12]
    said = str(CaseError(faults))
    assert said.count("a: wrong") == said.count("b: wrong") == 10
    assert "a: and 2 more\nb: and 2 more" in said


KEYS = {
    "bare": ".".join("a" * 20_000) + " = 1",
    "quoted": ".".join(['"a"'] * 20_000) + " = 1",
    "spaced": " . ".join(["'a'"] * 20_000) + " = 1",
    "heading": "[" + ".".join("a" * 20_000) + "]",
    "inner": "x = {" + ".".join("a" * 20_000) + " = 1}",
}


@pytest.mark.parametrize("form", KEYS)
def test_keys_of_many_parts_are_refused_before_they_are_read(tmp_path, form):
    tracemalloc.start()
    said = said_of(tmp_path, f"{HEAD}\n{KEYS[form]}\n")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "line 4 has more than 32 parts" in said
    assert most < 2e7


def test_long_lines_are_searched_for_such_keys_in_no_time(tmp_path):
    start = time.process_time()
    for text in ("a" * 500_000, '"' * 500_001, "a." * 31 + "\n", "a '" * 150_000):
        said_of(tmp_path, HEAD + text)
    assert time.process_time() - start < 2.0


SYNTAX = {
    'id "a"': "line 3, column 4: no = after the key",
    "[patient]": "line 3, column 9: the table stands twice",
    'id = "b"': "the key stands twice",
    "a = [1": "at its end: a list without its closing bracket",
    "a = {b = 1, b = 2}": "a key stands twice between braces",
    'a = "b': "a text without its closing quote",
    "a = 'b": "a text without its closing quote",
    'a = "C:\\users"': "a backslash in a text",
    "a = 2020-02-31": "no such date",
    "a = yes": "neither a number, a text in quotes, true nor false",
    "a = 1 2": "something stands behind the value",
    "[a": "no closing bracket after the name of a table",
    "%": "no key begins so",
    "a = \"\x01\"": "a control character",
}  # fmt: skip


@pytest.mark.parametrize("line", SYNTAX)
def test_syntax_errors_are_said_in_own_words(tmp_path, line):
    said = said_of(tmp_path, HEAD + line + "\n")
    assert "not valid TOML at" in said
    assert SYNTAX[line] in said
    assert "Cannot" not in said
    assert "Expected" not in said


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_finished_mesh_whose_wall_has_no_thickness_is_refused(tmp_path, monkeypatch, value):
    monkeypatch.setenv("JAXFSI_CACHE_DIR", str(tmp_path / "cache"))
    measured = mesh_case.wall_thickness

    def spoilt(mesh):
        found = measured(mesh)
        return found._replace(thickness=np.full_like(found.thickness, value))

    monkeypatch.setattr(mesh_case, "wall_thickness", spoilt)
    case = tube_case.write_case(tmp_path)
    with Progress() as progress, pytest.raises(CaseError) as caught:
        mesh_case.mesh_state(read_case(case), "finished", progress)
    assert f"{tmp_path / 'tube.vtu'}: the wall has no thickness at " in str(caught.value)
