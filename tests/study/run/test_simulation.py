"""The command `simulate` on a small tube with three openings, and what it refuses."""

import csv
import dataclasses
import json
import shutil

import jax
import numpy as np
import pytest
import pyvista as pv

import jaxfsi.simulation.simulation as simulation
import study.run.mesh as mesh_case
import study.run.simulation as simulation_run
from jaxfsi.core.step.step import RESULTS
from jaxfsi.mesh_files import write_mesh
from jaxfsi.meshing import tube
from lumped import MMHG
from study import CaseError, read_case
from study.case.parameters import WindkesselParameters
from study.report.packed_array import unpacked
from study.report.stored_vessel import stored_vessel
from study.run.anatomy_source import case_mesh
from study.run.opening_checks import check_openings
from study.run.setup import (
    check_simulation,
    plan_steps,
    prepare_simulation,
)
from study.run.simulation_data import LumenCollapse
from study.store.earlier_run import clear_run

CASE = """\
[patient]
id = "tube"
[anatomy]
kind = "mesh"
path = "tube.vtu"
unit = "cm"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
cardiac_output_l_per_min = 4.5
ffr = 0.91
[condition.exercise]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
[windkessel]
characteristic = "paper"
[solver]
dt_s = 2.0e-3
frames_per_cycle = 40
checkpoint_every = 10
"""


def _three_openings(n_layers: int):
    """A tube whose outlet is one half aorta, one half anomalous artery."""
    mesh = tube(radius=1.0, length=3.0, thickness=0.2, n_around=10, n_axial=5, n_layers=n_layers)
    names = ["aorta_inlet", "aorta_outlet", "anomalous_outlet", "interface"]
    if n_layers:
        names += ["outer_wall", *(f"{name}_ring" for name in names[:3])]
    new = {"inlet": "aorta_inlet", "outlet": "aorta_outlet"}
    label = np.zeros(len(mesh.faces), np.int64)
    side = mesh.points[mesh.faces].mean(axis=1)[:, 0] < 0.0
    for k, old in enumerate(mesh.label_names):
        stem = old.removesuffix("_ring")
        name = new.get(stem, stem) + old[len(stem) :]
        label[mesh.face_label == k] = names.index(name)
        if stem == "outlet":
            other = name.replace("aorta", "anomalous")
            label[(mesh.face_label == k) & side] = names.index(other)
    return dataclasses.replace(mesh, face_label=label, label_names=tuple(names))


@pytest.fixture(scope="module", autouse=True)
def _quick():
    """Fields times numbers of elements are allowed, as in the core; meshes are not drawn."""
    with jax.numpy_rank_promotion("allow"), pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_case, "draw_mesh", lambda mesh, anatomy: ({}, None))
        yield


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """A process of its own draws them: for `outcome`, which is made before this, and no other."""
    none = ({}, [], "no pictures: these tests have them once")
    monkeypatch.setattr("study.cli.simulate_command.draw_simulation", lambda *scene: none)


@pytest.fixture(scope="module")
def case_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulate")
    write_mesh(folder / "tube.vtu", _three_openings(0), unit="cm")
    path = folder / "case.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def outcome(case_file, command, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    found = command("simulate", case_file, "--rigid", "--cycles", "0.1", "--json", folder=folder)
    assert found.status == 0, found.stderr
    return found


def test_openings_under_other_names_are_refused_until_the_case_names_them(tmp_path):
    mesh = _three_openings(1)
    names = [name.replace("aorta", "main") for name in mesh.label_names]
    write_mesh(
        tmp_path / "tube.vtu", dataclasses.replace(mesh, label_names=tuple(names)), unit="cm"
    )
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    case = read_case(path)
    with pytest.raises(CaseError, match=r"\[anatomy\.labels\], such as main_inlet = \"aorta_in"):
        check_openings(case, case_mesh(case), rigid=False)
    table = '[anatomy.labels]\nmain_inlet = "aorta_inlet"\nmain_outlet = "aorta_outlet"\n'
    path.write_text(CASE + table)
    case = read_case(path)
    check_openings(case, case_mesh(case), rigid=False)


def test_files_of_a_run(outcome):
    names = {path.name for path in outcome.folder.iterdir()}
    assert {
        "fields",
        "history.csv",
        "shear.vtu",
        "simulation.json",
        "simulation.html",
        "simulation-vessel.html",
        "simulation-vessel.json",
        "checkpoint.npz",
    } <= names
    series = pv.get_reader(outcome.folder / "fields/fields.pvd")
    np.testing.assert_allclose(series.time_values, np.arange(5) * 0.02, atol=1e-12)
    page = (outcome.folder / "simulation.html").read_text()
    assert "Pressures and flows" in page
    assert page.count("<svg") == 2
    assert "no pictures: these tests" not in page
    assert outcome.json["frames"] == 5


def test_document_says_what_was_run(outcome):
    document = outcome.written("simulation.json")
    assert document["kind"] == "simulate"
    assert document["solver"]["steps_done"] == 40
    assert document["solver"]["dt_s"] == pytest.approx(2e-3)
    # R0 d/((1 − d) R_total), the closed form
    alpha = 5.0e3 * 0.91 / 0.09 / (3.1992e4 + 6.3984e4 + 2.666e5)
    assert document["alpha"] == pytest.approx(alpha, rel=1e-9)
    assert document["ports"]["anomalous_outlet"]["R_1"] == pytest.approx(alpha * 3.1992e4)
    assert document["ports"]["aorta_outlet"]["kind"] == "RCR"
    assert "history" not in outcome.json
    assert outcome.json["cycles"] == document["cycles"]
    with (outcome.folder / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    P = [float(row["P_aorta_inlet_mmHg"]) for row in rows]
    mean = document["cycles"][0]["ports"]["aorta_inlet"]["mean_P_mmHg"]
    assert mean == pytest.approx(np.mean(P), rel=1e-6)


def test_page_of_the_vessel_holds_the_numbers_of_the_document(outcome):
    document = outcome.written("simulation.json")
    data = stored_vessel(outcome.folder, "simulate")
    assert data is not None
    (view,) = data.views
    cycle = document["cycles"][0]
    assert view.wall == "rigid"
    assert view.ratio is None  # a part of a cycle
    assert view.P_distal_mean_mmHg == cycle["ports"]["anomalous_outlet"]["mean_P_mmHg"]
    assert view.P_distal_mean_mmHg / view.P_aorta_mean_mmHg == pytest.approx(cycle["ratio"])
    assert len(view.t_s) == 4
    P = unpacked(view.node_P_mmHg)
    low, high = (document["history"]["P_mmHg"]["aorta_inlet"][i] for i in (0, -1))
    assert P.mean() == pytest.approx(0.5 * (low + high), rel=0.2)
    page = (outcome.folder / "simulation.html").read_text()
    assert 'href="simulation-vessel.html"' in page


def test_rigid_wall_lets_as_much_out_as_in(outcome):
    document = outcome.written("simulation.json")
    Q = document["history"]["Q_ml_per_min"]
    total = sum(np.asarray(flow) for flow in Q.values())
    # the tolerance of a step, 1e-3, of the largest flow
    assert np.abs(total).max() < 1e-3 * max(np.abs(flow).max() for flow in Q.values())


def test_same_command_goes_on_and_finds_nothing_left(outcome, case_file, command):
    before = (outcome.folder / "checkpoint.npz").read_bytes()
    again = command(
        "simulate", case_file, "--rigid", "--cycles", "0.1", "--json", folder=outcome.folder
    )
    assert again.status == 0
    assert again.json["solver"]["resumed_from"] == 40
    assert again.json["cycles"] == outcome.json["cycles"]
    assert (outcome.folder / "checkpoint.npz").read_bytes() == before


def test_other_input_in_the_same_folder_is_refused(outcome, case_file, command):
    other = command(
        "simulate", case_file, "--rigid", "--condition", "exercise", folder=outcome.folder
    )
    assert other.status == 2
    assert "--restart" in other.stderr
    assert "belongs to a run with another model" in other.stderr


def test_shorter_run_in_the_same_folder_is_refused(outcome, case_file, command):
    before = _content(outcome.folder)
    shorter = command("simulate", case_file, "--rigid", "--cycles", "0.05", folder=outcome.folder)
    assert shorter.status == 2
    assert "checkpoint.npz: holds a longer run: 40 steps, 0.08 s" in shorter.stderr
    assert "where 20 steps, 0.04 s, were asked for" in shorter.stderr
    for cure in ("--cycles 0.1)", "--out", "--restart"):
        assert cure in shorter.stderr
    assert _content(outcome.folder) == before


def test_damaged_checkpoint_is_refused(outcome, case_file, command, tmp_path):
    folder = shutil.copytree(outcome.folder, tmp_path / "out")
    with np.load(folder / "checkpoint.npz") as file:
        arrays = {name: file[name] for name in file.files if name != "state.3"}
    np.savez(folder / "checkpoint.npz", **arrays)
    before = _content(folder)
    found = command("simulate", case_file, "--rigid", "--cycles", "0.1", folder=folder)
    assert found.status == 2
    assert "checkpoint.npz: is damaged: state.3 is missing" in found.stderr
    assert "--restart" in found.stderr
    assert _content(folder) == before


def _content(folder):
    """Files by name but for the log, to which every command adds."""
    files = (p for p in folder.rglob("*") if p.is_file() and p.name != "run.log")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_restart_that_fails_at_once_keeps_the_earlier_run_apart(
    outcome, case_file, command, tmp_path, monkeypatch
):
    folder = shutil.copytree(outcome.folder, tmp_path / "out")
    before = _content(folder)
    advance = simulation.advance_chunk

    def spoil(model, state, *rest):
        return advance(model, state._replace(u=state.u * np.nan), *rest)._replace(state=state)

    monkeypatch.setattr(simulation, "advance_chunk", spoil)
    options = ("--rigid", "--cycles", "0.1", "--alpha", "2", "--restart")
    for k in (1, 2):
        found = command("simulate", case_file, *options, folder=folder)
        assert found.status == 1
        assert f"moved the earlier run to {folder / f'earlier-{k}'}" in found.stderr
        assert found.written("simulation.json")["alpha"] == 2.0
        assert not (folder / "history.csv").exists()
        assert not (folder / "shear.vtu").exists()
    assert _content(folder / "earlier-1") == before
    assert "Step 1 failed at t = 0 s" in found.stderr
    assert "What was computed before" not in found.stderr
    assert "iterations" not in found.stderr
    for cure in ("--dt", "alpha", "pressures of the case"):
        assert cure in found.stderr


def test_run_without_a_checkpoint_does_not_mix_with_a_new_one(
    outcome, case_file, command, tmp_path
):
    folder = shutil.copytree(outcome.folder, tmp_path / "out")
    (folder / "checkpoint.npz").unlink()
    left = _content(folder)
    found = command("simulate", case_file, "--rigid", "--cycles", "0.05", folder=folder)
    assert found.status == 0
    assert _content(folder / "earlier-1") == left
    assert len(list((folder / "fields").glob("*.vtu"))) == 3


def test_run_that_ends_before_its_first_frame_says_so(case_file, command, tmp_path):
    found = command("simulate", case_file, "--rigid", "--cycles", "0.01", folder=tmp_path / "out")
    assert found.status == 0
    assert len(list((tmp_path / "out" / "fields").glob("*.vtu"))) == 1
    said = [note["text"] for note in found.written("simulation.json")["notes"]]
    assert any("4 steps ends before the first frame, at step 10" in text for text in said)


def test_forgotten_run_leaves_nothing(outcome, tmp_path):
    folder = shutil.copytree(outcome.folder, tmp_path / "out")
    (folder / "inputs.txt").write_text("key")
    clear_run(folder)
    left = {name.split("/")[0].split("-pictures")[0] for name in _content(folder)}
    shown = {"simulation.json", "simulation.html", "simulation"}
    assert left <= {"inputs.txt", *shown, "simulation-vessel.html", "simulation-vessel.json"}
    clear_run(folder)  # also where there is none


def test_stored_result_is_shown_again(outcome, command, tmp_path):
    shown = command("show", outcome.folder, folder=tmp_path / "page")
    assert shown.status == 0
    assert "anomalous_outlet" in shown.stdout
    first = (outcome.folder / "simulation.html").read_text()
    assert (tmp_path / "page/simulation.html").read_text() == first


def test_interrupted_run_keeps_what_it_has_and_goes_on(case_file, command, tmp_path, monkeypatch):
    text = simulation_run.progress_text

    def interrupt(progress, *rest):
        if progress.step >= 20:
            raise KeyboardInterrupt
        return text(progress, *rest)

    options = ("simulate", case_file, "--rigid", "--cycles", "0.1", "--json")
    monkeypatch.setattr(simulation_run, "progress_text", interrupt)
    stopped = command(*options, folder=tmp_path)
    assert stopped.status == 130
    assert "same command again" in stopped.stderr
    assert stopped.written("simulation.json")["interrupted"]
    assert _steps_kept(tmp_path) == stopped.written("simulation.json")["solver"]["steps_done"] == 10
    stopped = command(*options, folder=tmp_path)
    assert stopped.status == 130
    assert stopped.written("simulation.json")["solver"]["resumed_from"] == 10
    monkeypatch.setattr(simulation_run, "progress_text", text)
    resumed = command(*options, folder=tmp_path)
    assert resumed.status == 0
    assert 0 < resumed.json["solver"]["resumed_from"] < 40


def _steps_kept(folder):
    """Steps of the history, which are those of the checkpoint."""
    with (folder / "history.csv").open() as file:
        rows = list(csv.DictReader(file))
    with np.load(folder / "checkpoint.npz") as file:
        np.testing.assert_allclose([float(row["t_s"]) for row in rows], file["record.t"])
    return len(rows)


def test_run_interrupted_before_its_first_steps_says_so(case_file, command, tmp_path, monkeypatch):
    def interrupt(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(simulation, "advance_chunk", interrupt)
    stopped = command("simulate", case_file, "--rigid", "--cycles", "0.1", folder=tmp_path)
    assert stopped.status == 130
    assert "interrupted before the first steps were done" in stopped.stderr
    assert "nothing was written" not in stopped.stderr


def test_failed_run_keeps_what_it_has(case_file, command, tmp_path, monkeypatch):
    advance = simulation.advance_chunk

    def spoil(model, state, *rest):
        late = float(state.t) > 0.03
        end = advance(model, state._replace(u=state.u * np.nan) if late else state, *rest)
        return end._replace(state=state) if late else end

    monkeypatch.setattr(simulation, "advance_chunk", spoil)
    found = command("simulate", case_file, "--rigid", "--cycles", "0.1", folder=tmp_path)
    assert found.status == 1
    assert "Step 21 failed at t = 0.04 s, also with a step of 0.000125 s" in found.stderr
    assert "What was computed before is in" in found.stderr
    document = found.written("simulation.json")
    assert "no longer finite" in document["failure"]
    assert document["solver"]["steps_done"] == 20
    assert len(document["events"]) == 4


def test_collapse_is_a_result_with_time_and_place(case_file, command, tmp_path, monkeypatch):
    advance = simulation.advance_chunk

    def spoil(model, state, *rest):
        if not float(state.t) > 0.03:
            return advance(model, state, *rest)
        end = advance(model, state._replace(u=state.u * np.nan), *rest)
        flat = model.x.at[jax.numpy.array([0, 2])].set(0.0) * -0.9
        pressed = state._replace(d_mesh=jax.numpy.where(model.in_fluid, flat, 0.0))
        return end._replace(state=pressed, result=RESULTS.inverted)

    monkeypatch.setattr(simulation, "advance_chunk", spoil)
    found = command("simulate", case_file, "--rigid", "--cycles", "0.1", folder=tmp_path)
    assert found.status == 0, found.stderr
    document = found.written("simulation.json")
    assert document["failure"] is None
    assert document["solver"]["steps_done"] == 20
    assert document["collapse"]["t_s"] == pytest.approx(0.04)
    assert document["collapse"]["volume_share"] == pytest.approx(0.1)
    # the case names a finished mesh, which has no axis
    assert document["collapse"]["from_ostium_mm"] is None
    text = "The lumen collapsed at t = 0.04 s, at ("
    assert any(note["text"].startswith(text) for note in document["notes"])
    assert text in (tmp_path / "simulation.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("place", "area", "words"),
    [
        (6.25, 0.118, "6.2 mm from the ostium, at (1.0, 2.0, 3.0) mm: its area there had fallen"),
        (None, None, "at (1.0, 2.0, 3.0) mm: an element of the blood there kept 4.0 % of"),
    ],
)
def test_collapse_is_told_in_a_sentence(place, area, words):
    told = LumenCollapse(0.2, [1.0, 2.0, 3.0], place, area, 0.04).sentence
    assert told.startswith(f"The lumen collapsed at t = 0.2 s, {words}")


def test_blocks_start_in_the_periodic_state(case_file):
    case = read_case(case_file)
    mesh = _three_openings(0)
    for condition in ("rest", "exercise"):
        setup = prepare_simulation(case, mesh, condition, plan_steps(case, condition), rigid=True)
        starts = setup.outlets.starts
        # between diastolic and systolic aortic pressure, the wave of the coronary bed included
        entry = case.conditions[condition]
        assert entry.P_diastolic * 0.7 < starts["aorta_outlet"][0] < entry.P_systolic
        assert entry.P_diastolic * 0.7 < starts["anomalous_outlet"][0] < entry.P_systolic
    # half of (2 P_diastolic + P_systolic)/3 / CO at rest
    block = setup.outlets.blocks["aorta_outlet"]
    assert float(block.R_distal) == pytest.approx(0.5 * (130.0 + 110.0) / 3.0 * MMHG / 75.0)


def test_resistance_in_series_can_be_the_papers(case_file):
    case, plan = read_case(case_file), plan_steps(read_case(case_file), "rest")
    setup = prepare_simulation(case, _three_openings(0), "rest", plan, rigid=True)
    assert float(setup.outlets.blocks["aorta_outlet"].R_proximal) == pytest.approx(10.0)


def test_impedance_in_series_keeps_the_whole_resistance(case_file):
    case = read_case(case_file)
    wall = dataclasses.replace(case.wall, E=1e5)  # the impedance stays below half of the whole
    case = dataclasses.replace(case, wall=wall, windkessel=WindkesselParameters())
    mesh, found = _three_openings(0), {}
    for condition in ("rest", "exercise"):
        setup = prepare_simulation(case, mesh, condition, plan_steps(case, condition), rigid=True)
        found[condition] = setup.outlets.blocks["aorta_outlet"]
    total = (130.0 + 110.0) / 3.0 * MMHG / 75.0
    for block, share in ((found["rest"], 1.0), (found["exercise"], 0.5)):
        assert float(block.R_proximal + block.R_distal) == pytest.approx(share * total)
    assert float(found["rest"].R_proximal) == pytest.approx(float(found["exercise"].R_proximal))
    assert 20.0 < float(found["rest"].R_proximal) < 0.5 * total


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("cardiac_output_l_per_min = 4.5", "", "cardiac_output_l_per_min"),
        ("dt_s = 2.0e-3", "dt_s = 0.06", "twentieth of the cycle"),
        ("frames_per_cycle = 40", "frames_per_cycle = 0.5", "solver.frames_per_cycle"),
        ("checkpoint_every = 10", "checkpoint_evry = 10", "checkpoint_every"),
        ('kind = "mesh"', 'kind = "none"', "anatomy.kind"),
    ],
)
def test_bad_input_is_refused_before_anything_runs(case_file, command, tmp_path, old, new, said):
    bad = case_file.with_name("bad.toml")
    bad.write_text(CASE.replace(old, new))
    out = tmp_path / "out"
    found = command("simulate", bad, "--rigid", folder=out)
    assert found.status == 2
    assert said in found.stderr
    assert not out.exists()


def test_faults_of_a_run_are_told_together(case_file):
    text = CASE.replace("cardiac_output_l_per_min = 4.5", "").replace("2.0e-3", "0.06")
    path = case_file.with_name("two.toml")
    path.write_text(text + "[wall]\nnu = 0.5\n")
    with pytest.raises(ValueError, match="3 faults"):
        check_simulation(read_case(path), "rest", rigid=False, dt=None)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--condition", "sleep"), "rest, exercise"),
        (("--dt", "0"), "--dt"),
        (("--cycles", "many"), "--cycles"),
        (("--state", "late"), "try: choose from finished\n"),
        (("--state", "all"), "there is no state 'all' to run; a run takes one state"),
        ((), "no wall"),
    ],
    ids=str,
)
def test_bad_options_are_refused(case_file, command, tmp_path, options, said):
    rigid = () if not options else ("--rigid",)
    found = command("simulate", case_file, *rigid, *options, folder=tmp_path / "out")
    assert found.status == 2
    assert said in found.stderr


def test_steps_fit_cycles_and_frames(case_file):
    case = read_case(case_file)
    plan = plan_steps(case, "exercise", dt=1e-3, cycles=2.0)
    assert plan.per_cycle % plan.per_frame == 0
    assert plan.dt * plan.per_cycle == pytest.approx(0.45, rel=1e-12)
    assert plan.dt <= 1e-3
    assert plan.n_steps == 2 * plan.per_cycle


def test_result_is_plain_json(outcome):
    text = (outcome.folder / "simulation.json").read_text()
    assert json.loads(text)["provenance"]["inputs"]
