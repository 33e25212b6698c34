"""A folder kept over a change of code or libraries: what is computed again, and what stays."""

import dataclasses
import importlib.resources
import types

import jinja2
import pytest

import study.run.run_3d as fsi_bench
import study.store.numerics as numerics
from study.case.model import read_case
from study.report.kept_parts import computed_parts, older_parts
from study.run.progress import Progress
from study.run.run_3d import Bench, RunChoice, RunName, fsi_run, run_key
from study.store.meshes import entry_key, mesh_key
from study.store.result_files import CHECKPOINT_FILE

NAME = RunName("curve", "rest", None, 0.5)


@pytest.fixture
def bench(tmp_path, tube):
    case = read_case(tube.write_case(tmp_path))
    return Bench(case, None, "mesh", tmp_path / "out", RunChoice(), Progress())  # pyright: ignore


@pytest.fixture
def march(monkeypatch, bench):
    """Stands in for the march and for what is read of it; counts both, and is new each time."""
    seen = types.SimpleNamespace(marched=0, went_on=0, read=0)

    def run(case, setup, folder, progress):
        if (folder / CHECKPOINT_FILE).exists():
            seen.went_on += 1
        else:
            seen.marched += 1
            (folder / CHECKPOINT_FILE).write_text("state")
        return types.SimpleNamespace(interrupted=False, failure=None)

    def read(*_):
        seen.read += 1
        return {"ratio": 1.0 / (1.0 + seen.read)}

    monkeypatch.setattr(fsi_bench, "setup_of", lambda *_: None)
    monkeypatch.setattr(fsi_bench, "run_simulation", run)
    monkeypatch.setattr(fsi_bench, "run_part", read)
    return seen


def _raised(monkeypatch, *parts):
    real = numerics.version
    monkeypatch.setattr(numerics, "version", lambda p: "raised" if p in parts else real(p))


@pytest.mark.parametrize("part", ["march", "0D"])
def test_ratio_of_other_numerics_is_not_served(bench, march, monkeypatch, part):
    first = fsi_run(bench, NAME)
    assert fsi_run(bench, NAME) == first
    _raised(monkeypatch, part)
    again = fsi_run(bench, NAME)
    assert again["ratio"] != first["ratio"]
    assert (march.marched, march.went_on) == (2, 0)


def test_ratio_of_other_libraries_is_not_served(bench, march, monkeypatch):
    fsi_run(bench, NAME)
    real = numerics.library
    monkeypatch.setattr(numerics, "library", lambda name: "0.1" if name == "jax" else real(name))
    fsi_run(bench, NAME)
    assert (march.marched, march.read) == (2, 2)


def test_other_reading_of_a_run_does_not_march_again(bench, march, monkeypatch):
    fsi_run(bench, NAME)
    _raised(monkeypatch, "reading")
    fsi_run(bench, NAME)
    assert (march.marched, march.went_on, march.read) == (1, 1, 2)


def test_numerics_of_other_parts_leave_a_run_as_it_is(bench, march, monkeypatch):
    fsi_run(bench, NAME)
    _raised(monkeypatch, "diagnosis", "mesh report", "case", "derivatives", "calibration")
    fsi_run(bench, NAME)
    assert (march.marched, march.read) == (1, 1)


def test_run_of_a_folder_of_an_older_form_is_begun_anew(bench, march):
    folder = bench.run_folder(NAME.folder)
    folder.mkdir(parents=True)
    (folder / "inputs.txt").write_text("0123456789abcdef0123456789abcdef")
    (folder / CHECKPOINT_FILE).write_text("old")
    assert bench.run_begun(NAME.folder) is None
    fsi_run(bench, NAME)
    assert (march.marched, march.went_on) == (1, 0)
    assert bench.run_begun(NAME.folder)["numerics"]["march"] == numerics.version("march")


def test_document_tells_when_and_by_which_code_a_run_was_made(bench, march, monkeypatch):
    fsi_run(bench, NAME)
    part = computed_parts(bench, [NAME.folder], [])["parts"][-1]
    assert (part["part"], part["kept"]) == ("curve-rest", False)
    later = dataclasses.replace(bench, begun="2999-01-01")
    monkeypatch.setattr("study.store.provenance._commit_at_start", lambda: "newer")
    found = computed_parts(later, [NAME.folder], [])
    assert found["parts"][-1]["kept"]
    assert found["by"]["commit"] == "newer"
    (told,) = older_parts(found)
    assert told.startswith("curve-rest: computed on 20")
    assert found["parts"][0] == {**dict.fromkeys(found["parts"][0]), "part": "mesh", "kept": False}
    page = _provenance_of(found)
    assert ", kept" in page
    assert "2999" not in page


def _provenance_of(computed):
    """The part of the page that tells of it."""
    text = importlib.resources.files("study").joinpath("report/templates/study.html").read_text()
    start = text.index("{% if d.computed is defined %}")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(
        text[start : text.index("</details>", start)]
    )
    return template.render(d={"computed": computed})


def test_measured_ratio_and_order_of_the_conditions_are_no_input_of_a_run(bench):
    key, case = run_key(bench, NAME), bench.case
    rest = dataclasses.replace(case.conditions["rest"], ffr=0.9)
    conditions = dict(reversed([*{**case.conditions, "rest": rest}.items()]))
    other = dataclasses.replace(bench, case=dataclasses.replace(case, conditions=conditions))
    assert run_key(other, NAME) == key


def test_drawing_a_mesh_in_another_way_leaves_its_runs_valid(bench, monkeypatch):
    case = bench.case
    before = mesh_key(case, "mesh"), entry_key(case, "mesh")
    with monkeypatch.context() as patch:
        _raised(patch, "mesh report")
        assert mesh_key(case, "mesh") == before[0]
        assert entry_key(case, "mesh") != before[1]
    _raised(monkeypatch, "meshing")
    assert mesh_key(case, "mesh") != before[0]
