"""What a refusal says: short, in the words of the format, and before any heavy work."""

import math
import pathlib
import time
import tracemalloc

import numpy as np
import pytest

from study import CaseError, read_case
from study.case.faults import Fault
from study.case.onsets import find_upstrokes
from study.case.record_beats import read_beats
from study.run import mesh as mesh_case
from study.run.progress import Progress
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
    "[patient]": "line 3, column 9: the table appears twice",
    'id = "b"': "the key appears twice",
    "a = [1": "at its end: a list without its closing bracket",
    "a = {b = 1, b = 2}": "a key appears twice between braces",
    'a = "b': "a text without its closing quote",
    "a = 'b": "a text without its closing quote",
    'a = "C:\\users"': "a backslash in a text",
    "a = 2020-02-31": "no such date",
    "a = yes": "neither a number, a text in quotes, true nor false",
    "a = 1 2": "there is something after the value",
    "[a": "no closing bracket after the name of a table",
    "%": "a key cannot begin like this",
    "a = \"\x01\"": "a control character",
}  # fmt: skip


@pytest.mark.parametrize("line", SYNTAX)
def test_syntax_errors_are_said_in_own_words(tmp_path, line):
    said = said_of(tmp_path, HEAD + line + "\n")
    assert "not valid TOML at" in said
    assert SYNTAX[line] in said
    assert "Cannot" not in said
    assert "Expected" not in said


def test_beat_of_more_samples_than_it_needs_is_refused_before_it_is_read(tmp_path):
    rows = "".join(f"{k * 4e-6:.6f},{90 + 20 * math.sin(k / 3e4):.3f}\n" for k in range(200_000))
    (tmp_path / "beat.csv").write_text(f"time_s,P_aorta_mmHg\n{rows}")
    start = time.process_time()
    said = said_of(
        tmp_path,
        HEAD + "[condition.rest]\nP_systolic_mmHg = 110\nP_diastolic_mmHg = 65\nperiod_s = 0.8\n"
        'waveform = "beat.csv"\n',
    )
    assert time.process_time() - start < 20.0
    assert "condition.rest.waveform = 200000: more samples than a beat needs" in said
    assert "keep every 200th sample" in said


def recording(path: pathlib.Path, seconds: float, rate: float) -> pathlib.Path:
    t = np.arange(int(seconds * rate)) / rate
    phase = np.mod(t / 0.7103, 1.0)
    P = 70.0 + 45.0 * np.sin(np.pi * np.minimum(phase / 0.4, 1.0)) + 10.0 * np.exp(-3.0 * phase)
    np.savetxt(path, np.stack([t, P], 1), "%.5f", ",", header="time_s,P_aorta_mmHg", comments="")
    return path


LONG = {
    "ten minutes at 250 Hz": (590.0, 250.0, "147500: too many samples (allowed: at most 120000)"),
    "ten minutes at 100 Hz": (590.0, 100.0, "831: too many beats (allowed: at most 200)"),
}


@pytest.mark.parametrize("claim", LONG)
def test_long_recordings_are_refused_with_what_to_cut(tmp_path, claim):
    seconds, rate, says = LONG[claim]
    faults: list[Fault] = []
    path = recording(tmp_path / "rest.csv", seconds, rate)
    start = time.process_time()
    assert read_beats(path, 0.71, 115.0, "condition.rest.file", faults) is None
    assert time.process_time() - start < 20.0
    (fault,) = faults
    assert says in str(fault)
    assert "cut it to a steady stretch" in str(fault)


def test_a_minute_of_beats_is_aligned_in_no_time(tmp_path):
    t, P = np.loadtxt(recording(tmp_path / "rest.csv", 60.0, 1000.0), delimiter=",", skiprows=1).T
    start = time.process_time()
    found = find_upstrokes(t, P, 0.71)
    assert time.process_time() - start < 20.0
    assert found.at.size >= 83
    np.testing.assert_allclose(np.diff(found.at), 0.7103, atol=5e-4)


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
