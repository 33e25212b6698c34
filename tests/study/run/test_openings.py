"""Openings are found by name: any order of ports, labels or keys gives the same numbers."""

import dataclasses
import itertools
import json
import pathlib

import jax
import numpy as np
import pytest
import skimage.measure
import trimesh

import study.run.run_3d as run_3d
from jaxfsi.anatomy import Triangles
from jaxfsi.anatomy.surfaces.flat_ends import outwards
from jaxfsi.anatomy.surfaces.triangles import cleaned
from jaxfsi.mesh_files import write_mesh, write_mesh_complete
from jaxfsi.opening import distal_name, inlet_name, is_segment
from jaxfsi.simulation import StepHistory
from jaxfsi.simulation.cycles import inlet_of
from lumped import MMHG
from study.case.anatomy import MeshAnatomy, SurfaceAnatomy, SurfaceCut
from study.case.read import read_case
from study.run.anatomy_source import case_mesh
from study.run.progress import Progress
from study.run.ramp import _columns
from study.run.results import PlannedRun, RunId
from study.run.run_context import RunContext
from study.run.study_choice import RunChoice
from study.store.meshes import mesh_key

NAMES = ("aorta_inlet", "aorta_outlet", "anomalous_outlet", "normal_outlet")
LEVELS = np.array([90.0, 89.0, 77.0, 85.0])  # mmHg
ORDERS = list(itertools.permutations(range(4)))[::5]


def record(order: tuple[int, ...]) -> tuple[StepHistory, tuple[str, ...]]:
    """One beat of 0.8 s with ports in an order, and their names in it."""
    t = 0.08 * np.arange(1, 11)
    P = MMHG * (LEVELS + 10.0 * np.sin(2.0 * np.pi * t / 0.8)[:, None])[:, list(order)]
    ones, counts = np.ones(10), np.ones(10, int)
    Q = np.ones((10, 4)) * np.array(order)
    made = StepHistory(ones, t, 0.0 * t + 0.08, P, Q, counts, counts, ones, ones, ones)
    return made, tuple(NAMES[i] for i in order)


@pytest.mark.parametrize("order", ORDERS)
def test_aortic_pressure_and_ramp_are_taken_by_name(order):
    made, names = record(order)
    wave = inlet_of(made, names)
    assert wave.P_mmHg.mean() == pytest.approx(90.0)
    columns = _columns(made, names)
    assert columns["P_aorta"].mean() == pytest.approx(90.0 * MMHG)
    assert columns["P_distal"].mean() == pytest.approx(77.0 * MMHG)
    assert columns["Q"].mean() == 2.0


@pytest.mark.parametrize("order", ORDERS)
def test_published_ratio_does_not_depend_on_the_order_of_ports(order, tube, tmp_path, monkeypatch):
    """The aortic pressure at the site lies 2 mmHg below that at the inlet."""
    made, names = record(order)
    inlet = 90.0 + 10.0 * np.sin(2.0 * np.pi * made.t / 0.8)
    entries = [type("Frame", (), {"t": t, "file": ""})() for t in made.t.tolist()]
    monkeypatch.setattr(run_3d, "read_series", lambda path: entries)
    monkeypatch.setattr(run_3d, "site_pressures", lambda *given: inlet - 2.0)
    case = read_case(tube.write_case(tmp_path))
    mesh = tube.three_openings()
    context = RunContext(case, mesh, "", tmp_path, RunChoice(), Progress(), np.arange(3))
    run = PlannedRun(RunId("paper", "rest"), 1.0)
    cycles, _ = run_3d._at_site(context, run, made, names, 0.8)
    assert cycles[0].ratio == pytest.approx(77.0 / 88.0)
    assert cycles[0].ratio_to_inlet == pytest.approx(77.0 / 90.0)
    assert cycles[0].site_offset_mmHg == pytest.approx(-2.0)


def test_names_tell_inlet_and_artery():
    assert inlet_name(reversed(NAMES)) == "aorta_inlet"
    assert distal_name(("anomalous_b", "anomalous_a", *NAMES[:2])) == "anomalous_a"
    assert distal_name(NAMES[:2]) is None
    assert distal_name(("outlet_2", "inlet", "outlet_1")) == "outlet_1"
    assert is_segment(("outlet", "inlet"))
    assert not is_segment(NAMES)
    with pytest.raises(ValueError, match=r"proximal, distal.*Name the opening"):
        inlet_name(("proximal", "distal"))


@pytest.fixture(scope="module")
def orders(tube) -> list:
    """The tube with its labels numbered in several orders, faces in the order of labels."""
    mesh = tube.three_openings()
    rng = np.random.default_rng(3)
    made = []
    for _ in range(3):
        names = rng.permutation(mesh.label_names).tolist()
        label = np.array([names.index(name) for name in mesh.label_names])[mesh.face_label]
        rows = np.argsort(label, kind="stable")
        made.append(
            dataclasses.replace(
                mesh, faces=mesh.faces[rows], face_label=label[rows], label_names=tuple(names)
            )
        )
    return made


@pytest.mark.parametrize("form", ["vtu", "msh", "folder"])
def test_finished_mesh_is_the_same_whatever_the_order_of_its_labels(orders, form, tube, tmp_path):
    found = []
    for k, mesh in enumerate(orders):
        folder = tmp_path / str(k)
        folder.mkdir()
        path = folder / ("folder" if form == "folder" else f"mesh.{form}")
        if form == "folder":
            path.mkdir()
            write_mesh_complete(path / "fluid", path / "solid", mesh, unit="cm")
        else:
            write_mesh(path, mesh, unit="cm")
        case = read_case(tube.write_case(folder))
        found.append(
            case_mesh(dataclasses.replace(case, anatomy=MeshAnatomy(unit="cm", path=path)))
        )
    for other in found[1:]:
        assert other.label_names == found[0].label_names
        for name in ("points", "tets", "region", "faces", "face_label"):
            np.testing.assert_array_equal(getattr(other, name), getattr(found[0], name))
    assert found[0].openings == ("aorta_inlet", "aorta_outlet", "anomalous_outlet")


def test_key_of_a_mesh_does_not_depend_on_the_order_of_openings(tube, tmp_path):
    case = read_case(tube.write_case(tmp_path))
    points = {name: (float(i), 0.0, 0.0) for i, name in enumerate(NAMES)}
    cuts = {n: SurfaceCut((0.0, 0.0, x), (0.0, 0.0, 1.0), 1.0) for n, x in (("a", 1.0), ("b", 2.0))}
    labels = {"one": "aorta_inlet", "two": "aorta_outlet"}
    file = pathlib.Path(tmp_path / "tube.vtu")

    def keys(turn) -> list[str]:
        made = (
            SurfaceAnatomy(file, "mm", openings=turn(points), cuts=turn(cuts)),
            MeshAnatomy(unit="cm", path=file, labels=turn(labels)),
        )
        return [mesh_key(dataclasses.replace(case, anatomy=a), "surface") for a in made]

    assert keys(dict) == keys(lambda table: dict(reversed(table.items())))


ENDS = {
    "aorta_inlet": (0.0, 0.0, -15.0),
    "aorta_outlet": (0.0, 0.0, 15.0),
    "anomalous_outlet": (20.0, 0.0, 0.0),
    "normal_outlet": (-20.0, 0.0, 3.0),
}
BRANCHED = """\
[patient]
id = "branched"
[anatomy]
kind = "surface"
surface = "lumen.obj"
unit = "mm"
[anatomy.openings]
{openings}
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
cardiac_output_l_per_min = 4.5
ffr = 0.93
[condition.exercise]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
"""


def branched() -> trimesh.Trimesh:
    """An aorta of radius 8 mm with a coronary of 2 mm to either side, cut open at four planes."""
    step, low = 0.8, np.array([-24.0, -11.0, -18.0])
    axes = [np.arange(a, -a, step) for a in low]
    x, y, z = np.stack(np.meshgrid(*axes, indexing="ij"))
    right = np.maximum(np.hypot(y, z) - 2.0, -x)
    left = np.maximum(np.hypot(y, z - 3.0) - 2.0, x)
    distance = np.minimum(np.hypot(x, y) - 8.0, np.minimum(right, left))
    points, faces, _, _ = skimage.measure.marching_cubes(distance, 0.0, spacing=(step,) * 3)
    points, faces = points + low, faces[:, ::-1].astype(np.int64)
    for end in ENDS.values():
        along = np.array(end) * (np.abs(end) == np.max(np.abs(end)))
        normal = -along / np.linalg.norm(along)
        points, faces = trimesh.intersections.slice_faces_plane(points, faces, normal, along)[:2]
    whole = outwards(cleaned(Triangles(points, faces)))  # slicing leaves slivers
    return trimesh.Trimesh(whole.points, whole.faces, process=False)


@pytest.mark.slow
def test_studies_with_two_orders_of_openings_are_equal(command, tmp_path):
    """Meshes, ramps, calibrations and ratios in 3D agree to the last digit."""
    found = []
    for k, order in enumerate((ENDS, ("aorta_outlet", "normal_outlet", "anomalous_outlet"))):
        folder = tmp_path / str(k)
        folder.mkdir()
        branched().export(folder / "lumen.obj")
        names = dict.fromkeys((*order, *ENDS))
        openings = "\n".join(f"{name} = {list(ENDS[name])}" for name in names)
        (folder / "case.toml").write_text(BRANCHED.format(openings=openings))
        options = ("--quick", "--conditions", "exercise", "--json")
        with jax.numpy_rank_promotion("allow"):  # fields times numbers of elements, as in the core
            outcome = command("study", folder / "case.toml", *options, folder=folder / "out")
        assert outcome.status == 0, outcome.stderr
        found.append(json.loads(outcome.stdout))
    first, second = found
    assert first["rows"]
    for part in ("ramp", "loop", "rows"):
        assert first[part] == second[part], part
