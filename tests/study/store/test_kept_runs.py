"""A folder kept over a change of code or libraries: what is computed again, and what stays."""

import dataclasses
import importlib.resources
import json
import types

import jinja2
import pytest

import study.run.run_3d as run_3d
import study.store.numerics as numerics
from study.case.read import read_case
from study.report.older_parts import older_parts
from study.run.computed_parts import computed_parts
from study.run.progress import Progress
from study.run.results import PlannedRun, Run3D, RunHistory, RunId
from study.run.run_3d import fsi_run, run_key
from study.run.run_context import RunContext
from study.run.study_choice import RunChoice
from study.store.json_form import as_json
from study.store.meshes import entry_key, mesh_key
from study.store.result_files import CHECKPOINT_FILE

RUN = PlannedRun(RunId("curve", "rest"), 0.5)


def run_with(ratio):
    """A run of one step."""
    numbers = dict.fromkeys(("period_s", "dt_s", "mean_iterations", "least_volume"), 1.0)
    history = RunHistory([0.1], [90.0], [80.0], [50.0])
    return Run3D(
        id=RUN.id.name,
        label=RUN.id.label,
        condition=RUN.id.condition,
        rule=None,
        alpha=RUN.alpha,
        ratio=ratio,
        ratios=[ratio],
        ratio_change=None,
        drift_mmHg=None,
        cycles=[],
        steps=1,
        repeated=0,
        folder="runs/curve-rest",
        history=history,
        **numbers,
    )


@pytest.fixture
def context(tmp_path, tube):
    case = read_case(tube.write_case(tmp_path))
    return RunContext(case, None, "mesh", tmp_path / "out", RunChoice(), Progress())  # pyright: ignore


@pytest.fixture
def march(monkeypatch, context):
    """Stands in for the march and for what is read of it; counts both, and is new each time."""
    seen = types.SimpleNamespace(marched=0, went_on=0, read=0)

    def run(case, setup, folder, progress):
        if (folder / CHECKPOINT_FILE).exists():
            seen.went_on += 1
        else:
            seen.marched += 1
            (folder / CHECKPOINT_FILE).write_text("state")
        return types.SimpleNamespace(interrupted=False, failure=None, collapse=None)

    def read(*_):
        seen.read += 1
        return run_with(1.0 / (1.0 + seen.read))

    monkeypatch.setattr(run_3d, "setup_of", lambda *_: None)
    monkeypatch.setattr(run_3d, "with_ramp_off", lambda setup: setup)
    monkeypatch.setattr(run_3d, "run_simulation", run)
    monkeypatch.setattr(run_3d, "run_result", read)
    return seen


def _raised(monkeypatch, *parts):
    real = numerics.version
    monkeypatch.setattr(numerics, "version", lambda p: "raised" if p in parts else real(p))


@pytest.mark.parametrize("part", ["march", "0D"])
def test_ratio_of_other_numerics_is_not_served(context, march, monkeypatch, part):
    first = fsi_run(context, RUN)
    assert fsi_run(context, RUN) == first
    _raised(monkeypatch, part)
    again = fsi_run(context, RUN)
    assert again.ratio != first.ratio
    assert (march.marched, march.went_on) == (2, 0)


def test_ratio_of_other_libraries_is_not_served(context, march, monkeypatch):
    fsi_run(context, RUN)
    real = numerics.library
    monkeypatch.setattr(numerics, "library", lambda name: "0.1" if name == "jax" else real(name))
    fsi_run(context, RUN)
    assert (march.marched, march.read) == (2, 2)


def test_other_reading_of_a_run_does_not_march_again(context, march, monkeypatch):
    fsi_run(context, RUN)
    _raised(monkeypatch, "reading")
    fsi_run(context, RUN)
    assert (march.marched, march.went_on, march.read) == (1, 1, 2)


def test_numerics_of_other_parts_leave_a_run_as_it_is(context, march, monkeypatch):
    fsi_run(context, RUN)
    _raised(monkeypatch, "diagnosis", "mesh report", "case", "derivatives", "calibration")
    fsi_run(context, RUN)
    assert (march.marched, march.read) == (1, 1)


def test_run_of_a_folder_of_an_older_form_is_begun_anew(context, march):
    folder = context.run_folder(RUN.id.name)
    folder.mkdir(parents=True)
    (folder / "inputs.txt").write_text("0123456789abcdef0123456789abcdef")
    (folder / CHECKPOINT_FILE).write_text("old")
    assert context.run_begun(RUN.id.name) is None
    fsi_run(context, RUN)
    assert (march.marched, march.went_on) == (1, 0)
    assert context.run_begun(RUN.id.name)["numerics"]["march"] == numerics.version("march")


def test_document_tells_when_and_by_which_code_a_run_was_made(context, march, monkeypatch):
    fsi_run(context, RUN)
    part = computed_parts(context, [RUN.id.name], []).parts[-1]
    assert (part.part, part.kept) == ("curve-rest", False)
    later = dataclasses.replace(context, begun="2999-01-01")
    monkeypatch.setattr("study.store.provenance._commit_at_start", lambda: "newer")
    found = computed_parts(later, [RUN.id.name], [])
    assert found.parts[-1].kept
    assert found.by.commit == "newer"
    (told,) = older_parts(found)
    assert told.startswith("curve-rest: computed on 20")
    stored = as_json(found)
    assert stored["parts"][0] == {
        **dict.fromkeys(stored["parts"][0]),
        "part": "mesh",
        "kept": False,
    }
    page = _provenance_of(stored)
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


def test_run_that_an_older_version_kept_without_an_id_is_read(context, march):
    first = fsi_run(context, RUN)
    file = context.folder / "stages/run-curve-rest.json"
    stored = json.loads(file.read_text())
    del stored["value"]["id"]
    file.write_text(json.dumps(stored))
    assert fsi_run(context, RUN) == first
    assert march.read == 1


def test_measured_ratio_and_order_of_the_conditions_are_no_input_of_a_run(context):
    key, case = run_key(context, RUN), context.case
    rest = dataclasses.replace(case.conditions["rest"], ffr=0.9)
    conditions = dict(reversed([*{**case.conditions, "rest": rest}.items()]))
    other = dataclasses.replace(context, case=dataclasses.replace(case, conditions=conditions))
    assert run_key(other, RUN) == key


def test_drawing_a_mesh_in_another_way_leaves_its_runs_valid(context, monkeypatch):
    case = context.case
    before = mesh_key(case, "mesh"), entry_key(case, "mesh")
    with monkeypatch.context() as patch:
        _raised(patch, "mesh report")
        assert mesh_key(case, "mesh") == before[0]
        assert entry_key(case, "mesh") != before[1]
    _raised(monkeypatch, "meshing")
    assert mesh_key(case, "mesh") != before[0]
