"""The gap in 3D with a quick stand-in for the march: beds and inlet reach the run, runs are kept.

The stand-in is the surrogate itself in 0D; everything around the march is real (blocks, model,
keys, stages). With it the gap in 3D must be that of the surrogate.
"""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import study.run.run_3d as run_3d
from diagnosis import CATALOGUE, Diagnosis, Judgement, find_effect, measured, stacked
from diagnosis.boundary import boundary_conditions
from diagnosis.diagnose import row_of
from diagnosis.effects import apply_effects
from diagnosis.engine import base_start, run_fits
from diagnosis.hypothesis import numbers_of
from diagnosis.prediction import OWN, base_circuit, condition_settings
from lumped import MMHG
from study import read_case
from study.case.parameters import WallParameters
from study.case.record import record_files
from study.run.diagnosis_in_3d import circuits_of, entry_of, gap_in_3d
from study.run.driven_beat import PHASES, Drive, drive_key, drive_setup, known_difference
from study.run.finished_study import FinishedStudy, RampCurve, finished_study
from study.run.gap_parts import GapIn3D
from study.run.progress import Progress
from study.run.results import Run3D, RunHistory
from study.run.study_choice import RunChoice, StudyChoice
from study.run.study_context import open_context
from study.store.case_inputs import input_files
from study.store.json_form import ABSENT, as_json, from_json
from study.store.layouts import FORMAT
from study.store.numerics import decided_by
from study.store.options import StudyOptions
from study.store.provenance import origin
from tests.diagnosis.records import synthetic
from tests.study.quick_march import QuickMarch

PUMP = find_effect(CATALOGUE, "intramyocardial_pump")
FEW = tuple(find_effect(CATALOGUE, n) for n in ("vasodilation", "sensor_height"))


@pytest.fixture(scope="module", autouse=True)
def _core_rules():
    """Fields times numbers of elements are allowed, as in the core."""
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module")
def study(tmp_path_factory, tube):
    """A study of the tube as if it had been run; its wall takes no prestress, to save time."""
    folder = tmp_path_factory.mktemp("tube")
    case = read_case(tube.write_case(folder))
    case = dataclasses.replace(case, wall=WallParameters(prestress="none"))
    context, _ = open_context(case, folder / "results", RunChoice(), Progress())
    return FinishedStudy(context, RampCurve(500.0, 1200.0, 0.0), 0.25, [], StudyChoice())


def drive_of(study, size: float) -> Drive:
    record = synthetic({})
    blank = measured(record)
    case = jax.tree.map(lambda leaf: leaf[0], condition_settings(blank))
    circuit = base_circuit(case, jnp.zeros(OWN))
    boundary = boundary_conditions(apply_effects(circuit, [PUMP], jnp.array([size])))
    entry = entry_of(study.context.case, record.conditions[0])
    return Drive(entry, boundary.bed, boundary.P_ostium, np.zeros(PHASES.size))


def test_an_effect_enters_the_key_and_a_size_of_zero_changes_no_bit_of_the_set_up(study):
    plain, *drives = (drive_of(study, size) for size in (0.0, 0.0, 0.3))
    keys = [drive_key(study.context, drive) for drive in (plain, *drives)]
    assert keys[0] == keys[1] != keys[2]
    later = plain._replace(difference=np.full(PHASES.size, 0.5))
    assert drive_key(study.context, later) != keys[0]
    setups = [drive_setup(study.context, drive) for drive in (plain, *drives)]
    structures = {str(jax.tree.structure((s.model, s.state))) for s in setups}
    assert len(structures) == 1  # one compiled step
    leaves = [jax.tree.leaves((s.model, s.state)) for s in setups]
    assert all(np.array_equal(a, b) for a, b in zip(leaves[0], leaves[1], strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(leaves[0], leaves[2], strict=True))


def run_3d_of(history):
    """A calibrated run at rest that shows these pressures."""
    numbers = {"ratio": 0.9, "ratios": [0.9], "ratio_change": None, "drift_mmHg": 0.0}
    steps = {"dt_s": 1e-3, "steps": 800, "repeated": 0, "mean_iterations": 9.0}
    return Run3D(
        id="loop1-rest",
        label="loop1",
        condition="rest",
        rule=None,
        alpha=0.3,
        **numbers,
        cycles=[],
        period_s=0.8,
        **steps,
        least_volume=0.5,
        folder="runs/loop1-rest",
        history=history,
    )


def history_without_site(history):
    return dataclasses.replace(history, t_site_s=ABSENT, P_site_mmHg=ABSENT)


def test_inlet_takes_what_the_ostium_wants_less_the_difference(study):
    history = {
        "t_s": np.linspace(0.0, 0.8, 81).tolist(),
        "P_aorta_mmHg": [80.0] * 81,
        "t_site_s": (0.02 * np.arange(1, 41)).tolist(),
        "P_site_mmHg": (81.0 + np.sin(2.0 * np.pi * 0.025 * np.arange(1, 41))).tolist(),
    }
    history["P_distal_mmHg"] = history["Q_ml_per_min"] = history["t_s"]
    run = run_3d_of(RunHistory(**history))
    drive = drive_of(study, 0.0)
    found = known_difference([run], drive.entry)
    # 40 frames of a sine, read between them
    np.testing.assert_allclose(found, 1.0 + np.sin(2.0 * np.pi * PHASES), atol=0.01)
    stress = dataclasses.replace(run, condition="exercise")
    unread = history_without_site(run.history)
    assert not known_difference([stress], drive.entry).any()
    assert not known_difference([dataclasses.replace(run, history=unread)], drive.entry).any()
    t = jnp.asarray(PHASES * drive.entry.period)
    wanted = jax.vmap(drive.P_ostium)(t)
    given = jax.vmap(drive._replace(difference=found).P_inlet)(t)
    np.testing.assert_allclose((wanted - given) / MMHG, found, atol=1e-9)


@pytest.fixture(scope="module")
def diagnosis():
    """A record and its diagnosis: fitted with and without the cause, the verdict given."""
    record = synthetic({"vasodilation": 0.6}, seed=3)
    batch, hypotheses = stacked([measured(record)]), ((), ("vasodilation",))
    pairs, numbers = [(-1, -1), (0, -1)], numbers_of(FEW)
    fits = run_fits(batch, [0, 0], pairs, np.repeat(base_start(batch), 2, axis=0), numbers, FEW)
    judgement = Judgement("named", hypotheses[1], {}, {}, (), hypotheses[1], True)
    return record, Diagnosis(
        record=jax.tree.map(lambda leaf: leaf[0], batch),
        effects=FEW,
        judgement=judgement,
        fits={h: row_of(fits, k) for k, h in enumerate(hypotheses)},
        log_B={},
        scan={},
        visibility={},
        forcing=np.zeros((1, 1, 1, 1)),
        accompanied={},
        beside={},
        n_data=1,
    )


@pytest.mark.slow
def test_the_gap_in_3d_is_that_of_the_surrogate_where_3d_is_the_surrogate(
    diagnosis, study, tmp_path
):
    record, found = diagnosis
    circuit = circuits_of(found, found.best)[0]
    march = QuickMarch(float(circuit.R0), float(circuit.C0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_3d, "run_simulation", march)
        some = gap_in_3d(record, found, study, ("dobutamine_high",), tmp_path, Progress())
        part = gap_in_3d(record, found, study, (), tmp_path, Progress())
        again = gap_in_3d(record, found, study, (), tmp_path, Progress())
    assert len(march.folders) == 2 * len(record.conditions), "kept runs are not made again"
    assert part == again
    assert from_json(GapIn3D, json.loads(json.dumps(as_json(part)))) == part
    assert some.conditions == part.conditions[-1:]
    assert part.at_the_boundary == ["vasodilation"]
    assert [c.held_out for c in part.conditions] == [False, False, False, True]
    for entry in part.conditions:
        rms = entry.P_distal_rms_mmHg
        # the surrogate keeps 40 harmonics: 0.05 mmHg of 0.5 mmHg noise
        assert rms["in_3d"]["after"] == pytest.approx(rms["surrogate"]["after"], abs=0.05)
        assert entry.P_ostium_rms_mmHg < 0.1
    held = part.conditions[-1].P_distal_rms_mmHg
    assert held["in_3d"]["after"] < 0.5 * held["in_3d"]["before"]


def test_a_study_is_opened_again_and_refused_once_its_case_has_changed(tmp_path, tube):
    path = tube.write_case(tmp_path)
    case = read_case(path)
    command = ["jaxfsi", "study", str(path), "--out", str(tmp_path / "out")]
    options = StudyOptions(case=path)
    document = {
        "kind": "study",
        "format": FORMAT,
        "ramp": {"a": 500.0, "b": 1200.0, "inertance": 0.0},
        "loop": {"alpha": 0.2, "run": "loop1-rest"},
        "runs": [],
        "numerics": decided_by("study"),
        "provenance": as_json(origin(input_files(case), tmp_path, command, options)),
    }
    (tmp_path / "out").mkdir()
    (tmp_path / "out/study.json").write_text(json.dumps(document))
    found = finished_study(tmp_path / "out", Progress())
    assert found.alpha == 0.2
    for other in (None, {**document["numerics"], "libraries": {"jax": "0.0.1"}}):
        text = json.dumps({**document, "numerics": other})
        (tmp_path / "out/study.json").write_text(text)
        with pytest.raises(ValueError, match="another version of the code"):
            finished_study(tmp_path / "out", Progress())
    del document["provenance"]["options"]
    (tmp_path / "out/study.json").write_text(json.dumps({**document, "format": "jaxfsi 1"}))
    with pytest.raises(ValueError, match=r"did not store its options(?s:.*)run jaxfsi study"):
        finished_study(tmp_path / "out", Progress())
    document["provenance"]["options"] = options.stored()
    (tmp_path / "out/study.json").write_text(json.dumps(document))
    assert (found.context.case.surrogate.R0, found.context.case.surrogate.K) == (500.0, 1200.0)
    tube.write_case(tmp_path, systolic=140.0)
    with pytest.raises(ValueError, match=r"changed since the study: case\.toml"):
        finished_study(tmp_path / "out", Progress())


def test_in_3d_without_a_study_is_refused(command, tmp_path):
    record = tmp_path / "record"
    record.mkdir()
    for name, text in record_files(synthetic({})).items():
        (record / name).write_text(text, encoding="utf-8")
    for options, problem in ((["--in-3d"], "finished study"), (["--in-3d", "rests"], "rests")):
        found = command("diagnose", record, *options)
        assert found.status == 2
        assert problem in found.stderr
