"""A coronary artery without the aorta, from a surface in mm, by the command line."""

import re

import jax
import numpy as np
import pytest
import trimesh

import study.cli.simulate_command as simulate_command
import study.run.mesh as mesh_case
from calibration.outlets import outlet_shares, share_of
from jaxfsi import meshing
from jaxfsi.mesh_files import write_mesh
from jaxfsi.opening import opening_area
from lumped import Constant, Coronary
from study.case.read import read_case
from study.run.anatomy_source import case_anatomy
from study.run.expected_times import march_seconds
from study.run.opening_checks import names_segment
from study.run.setup import check_simulation, plan_steps

OPENINGS = "inlet = [0.0, 0.0, 0.0]\noutlet = [0.0, 0.0, 12.0]\n"
CASE = """\
[patient]
id = "segment"
[anatomy]
kind = "surface"
surface = "coronary.stl"
unit = "mm"
smoothing_steps = 0
[anatomy.openings]
{openings}
[wall]
thickness_per_radius = 0.3
[mesh]
preset = "coarse"
wall_layers = 1
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.9
[solver]
dt_s = 0.04
frames_per_cycle = 2
"""


def coronary(radius: float = 1.5, length: float = 12.0, n: int = 20) -> trimesh.Trimesh:
    """An open tube along z [mm]."""
    theta, layers = 2.0 * np.pi * np.arange(n) / n, 24
    z = np.repeat(np.linspace(0.0, length, layers + 1), n)
    around = np.tile(np.stack([np.cos(theta), np.sin(theta)], axis=1), (layers + 1, 1))
    i = np.arange(n)
    low = (n * np.arange(layers)[:, None] + i).ravel()
    right = (n * np.arange(layers)[:, None] + (i + 1) % n).ravel()
    faces = [np.stack([low, right, right + n], 1), np.stack([low, right + n, low + n], 1)]
    return trimesh.Trimesh(np.column_stack([radius * around, z]), np.concatenate(faces))


@pytest.fixture
def case_file(tmp_path):
    """Writes the case with some openings; gives its file."""
    coronary().export(tmp_path / "coronary.stl")

    def written(openings=OPENINGS):
        (tmp_path / "case.toml").write_text(CASE.format(openings=openings))
        return tmp_path / "case.toml"

    return written


@pytest.fixture
def no_meshing(monkeypatch):
    """Meshing is a fault of the test."""

    def refuse(*given):
        raise AssertionError("meshed before the case was refused")

    monkeypatch.setattr(mesh_case, "case_anatomy", refuse)
    monkeypatch.setattr(simulate_command, "mesh_state", refuse)


def test_study_refuses_a_segment_before_meshing_and_names_what_runs_it(
    case_file, command, tmp_path, no_meshing
):
    found = command("study", case_file(), folder=tmp_path / "out")
    assert found.status == 2
    assert "anatomy.openings" in found.stderr
    assert "use jaxfsi simulate" in found.stderr


@pytest.mark.parametrize(
    ("openings", "said"),
    [
        ("proximal = [0.0, 0.0, 0.0]\ndistal = [0.0, 0.0, 12.0]\n", "no opening named aorta_inlet"),
        ("inlet = [0.0, 0.0, 0.0]\n", "the vessel has no outlet"),
    ],
)
def test_names_that_no_run_can_use_are_refused_before_meshing(
    case_file, command, tmp_path, no_meshing, openings, said
):
    found = command("simulate", case_file(openings), folder=tmp_path / "out")
    assert found.status == 2
    assert said in found.stderr
    assert "[anatomy.openings]" in found.stderr


def test_coronary_without_names_is_told_to_name_its_ends(case_file, command, tmp_path):
    path = case_file()
    path.write_text(path.read_text().replace("[anatomy.openings]\n" + OPENINGS, ""))
    found = command("mesh", path, folder=tmp_path / "out")
    assert found.status == 2
    assert "name its ends inlet and outlet ([anatomy.openings]" in " ".join(found.stderr.split())


def test_segment_in_the_wrong_unit_is_refused(case_file, command, tmp_path):
    path = case_file()
    path.write_text(path.read_text().replace('"mm"', '"cm"'))
    found = command("mesh", path, folder=tmp_path / "out")
    assert found.status == 2
    said = " ".join(found.stderr.split())
    assert "radius of 1.49 cm, expected 0.03..0.6 cm: the unit (cm) is probably wrong" in said
    assert "of an aorta, name its ends aorta_inlet, aorta_outlet" in said


def test_refusal_says_where_the_ends_are_in_the_unit_of_the_surface(case_file, command, tmp_path):
    found = command("mesh", case_file("inlet = [0.0, 0.0, 0.0]\n"), folder=tmp_path / "out")
    assert found.status == 2
    said = " ".join(found.stderr.split())
    assert re.search(r"1 names for 2 ends of the surface, \[.*\]", said)
    middles = [[float(x) for x in point.split(",")] for point in re.findall(r"\[(-?\d.*?)\]", said)]
    assert sorted(point[2] for point in middles) == [0.0, 12.0]
    np.testing.assert_allclose(np.array(middles)[:, :2], 0.0)


def test_segment_may_end_in_an_anomalous_outlet(case_file):
    """Its course then has the files of an anomalous artery."""
    case = read_case(case_file(OPENINGS.replace("outlet", "anomalous_outlet")))
    assert names_segment(case)
    assert list(case_anatomy(case).centerlines) == ["anomalous"]


def test_finished_mesh_of_a_segment_needs_no_cardiac_output(tmp_path, command):
    mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=6, n_axial=3)
    write_mesh(tmp_path / "tube.vtu", mesh, unit="cm")
    text = CASE.format(openings="").replace("ffr = 0.9\n", "")
    anatomy = '[anatomy]\nkind = "mesh"\npath = "tube.vtu"\nunit = "cm"\n[wall]'
    begin, end = text.index("[anatomy]"), text.index("[wall]") + len("[wall]")
    (tmp_path / "case.toml").write_text(text[:begin] + anatomy + text[end:])
    check_simulation(read_case(tmp_path / "case.toml"), "rest", rigid=False, dt=None)
    found = command("check", tmp_path / "case.toml", "--json").json["checked"][0]
    assert found["runs"] == ["mesh", "simulate"]


def test_segment_needs_no_cardiac_output_and_its_estimate_follows_its_steps(case_file):
    case = read_case(case_file())
    assert names_segment(case)
    check_simulation(case, "rest", rigid=False, dt=None)
    few = plan_steps(case, "rest", cycles=0.4).n_steps
    assert few == 8
    assert march_seconds("coarse", few) < 120.0


def test_outlets_of_one_artery_share_its_bed(tube):
    """In parallel they are the bed of the case; the wider one has more of it."""
    mesh = tube.three_openings()
    names = ("aorta_outlet", "anomalous_outlet")  # each is half of an end of the tube
    bed = Coronary(Constant(0.0), R_1=1e3, R_2=3e3, R_3=2e3, C_a=1e-6, C_im=5e-6)
    shares = outlet_shares({name: opening_area(mesh, name) for name in names})
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-15)
    ratio = opening_area(mesh, names[0]) / opening_area(mesh, names[1])
    assert shares[names[0]] / shares[names[1]] == pytest.approx(ratio**1.3)
    parts = [share_of(bed, share) for share in shares.values()]
    for name in ("R_1", "R_2", "R_3"):
        together = 1.0 / sum(1.0 / getattr(part, name) for part in parts)
        assert together == pytest.approx(getattr(bed, name))
    for name in ("C_a", "C_im"):
        assert sum(getattr(part, name) for part in parts) == pytest.approx(getattr(bed, name))
    assert share_of(bed, 1.0) is bed


@pytest.mark.slow
def test_segment_runs(case_file, command, tmp_path, monkeypatch):
    """The flow follows from the bed alone: nearly all resistance lies behind the outlet."""
    out, options = tmp_path / "out", ("--rigid", "--cycles", "1", "--json")
    monkeypatch.setattr(mesh_case, "draw_mesh", lambda mesh, anatomy: ({}, None))
    with jax.numpy_rank_promotion("allow"):  # fields times numbers of elements, as in the core
        found = command("simulate", case_file(), *options, folder=out)
    assert found.status == 0, found.stderr
    document = found.written("simulation.json")
    assert document["mesh"]["openings"] == ["inlet", "outlet"]
    assert document["ports"]["inlet"]["kind"] == "pressure"
    assert document["ports"]["outlet"]["kind"] == "Coronary"
    assert any("without the aorta" in note["text"] for note in document["notes"])
    (cycle,) = document["cycles"]
    assert 0.9 < cycle["ratio"] < 1.0
    assert 20.0 < cycle["ports"]["outlet"]["mean_Q_ml_per_min"] < 120.0
