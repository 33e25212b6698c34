"""The lumen over a cycle, and what a wire drawn back through it reads."""

import types

import numpy as np
import pytest

from jaxfsi.anatomy.anatomy import Anatomy, Centerline
from jaxfsi.fields import Entry, frame_name
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.lumen_cycle import cycle_frames, lumen_cycle, mean_pressure
from jaxfsi.fields.pullback import pullback
from jaxfsi.meshing import tube
from jaxfsi.opening import ANOMALOUS

PERIOD, FRAMES, LENGTH = 0.5, 8, 2.0


def _pressure(z, t):
    return 90.0 - 6.0 * z**2 + 10.0 * np.cos(2.0 * np.pi * t / PERIOD)


def _bulge(t):
    return 0.2 * np.sin(np.pi * t / PERIOD) ** 2


def _nothing(points):
    """Stands for the shape of an anatomy, which has a mesh already."""
    raise AssertionError(points)


def _anatomy(centerlines, meta=None):
    return Anatomy("tube", *[_nothing] * 4, (), np.zeros((2, 3)), centerlines, meta or {})


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A tube of which two cycles are written, its mesh, entries and axis."""
    folder = tmp_path_factory.mktemp("frames")
    mesh = tube(radius=0.2, length=LENGTH, thickness=0.05, n_around=16, n_axial=24, n_layers=1)
    grid = Grid(mesh.points, mesh.tets)
    entries = []
    for k in range(2 * FRAMES + 1):
        t = PERIOD * k / FRAMES
        late = 1.0 if t > PERIOD * (1.0 + 1e-9) else 0.0  # the first cycle is another one
        fields = {
            "pressure_mmHg": late * _pressure(mesh.points[:, 2], t),
            "displacement_cm": mesh.points * np.array([1.0, 1.0, 0.0]) * _bulge(t),
        }
        grid.write(folder / frame_name("fields", k), t, fields)
        entries.append(Entry(t, frame_name("fields", k)))
    z = np.linspace(0.0, LENGTH, 101)
    line = Centerline(np.stack([0.0 * z, 0.0 * z, z], axis=1), z)
    anatomy = _anatomy({ANOMALOUS: line}, {"s_frames": [0.333]})
    return types.SimpleNamespace(folder=folder, mesh=mesh, entries=entries, anatomy=anatomy)


@pytest.fixture(scope="module")
def cycle(run):
    return lumen_cycle(run.folder, run.entries, run.mesh, PERIOD)


def test_frames_are_those_of_the_last_whole_cycle():
    entries = [Entry(0.1 * k, f"f{k}") for k in range(26)]
    for n, span in ((26, (11, 20)), (21, (11, 20)), (11, (1, 10)), (6, (1, 5))):
        begin, found = cycle_frames(entries[:n], 1.0)
        assert [e.file for e in found] == [f"f{k}" for k in range(span[0], span[1] + 1)]
        assert begin == pytest.approx(0.1 * (span[0] - 1))
    assert cycle_frames(entries[:1], 1.0)[1] == []


def test_nodes_carry_their_own_pressure_and_displacement(run, cycle):
    assert cycle.whole
    t = cycle.t + PERIOD
    z = run.mesh.points[cycle.nodes, 2]
    assert cycle.P == pytest.approx(_pressure(z[None], t[:, None]), rel=1e-12)
    radius = np.linalg.norm((cycle.points + cycle.moved)[..., :2], axis=2)
    assert radius == pytest.approx(0.2 * (1.0 + np.tile(_bulge(t)[:, None], len(z))), rel=1e-9)
    assert np.array_equal(cycle.nodes[cycle.triangles], run.mesh.labelled("interface"))
    assert np.mean(cycle.P_openings["inlet"]) == pytest.approx(90.0, rel=1e-12)


def test_means_at_both_ends_are_those_of_all_steps(run, cycle):
    found = mean_pressure(cycle, ("inlet", 91.0), ("outlet", 65.5))
    z = cycle.points[:, 2]
    assert found[z == 0.0] == pytest.approx(91.0, rel=1e-12)
    assert found[z == LENGTH] == pytest.approx(65.5, rel=1e-12)
    # between them along the line through both: frames give 90 - 6 z² and 66
    frames = 90.0 - 6.0 * z**2
    assert found == pytest.approx(65.5 + (frames - 66.0) * 25.5 / 24.0, rel=1e-12)


def test_without_a_drop_means_are_only_shifted(run, cycle):
    flat = cycle._replace(
        P=0.0 * cycle.P + 80.0, P_openings={n: 0.0 * cycle.t + 80.0 for n in cycle.P_openings}
    )
    found = mean_pressure(flat, ("inlet", 80.4), ("outlet", 80.2))
    assert found == pytest.approx(80.3, rel=1e-12)


def test_pullback_reads_pressure_and_lumen_of_each_section(run, cycle):
    found = pullback(run.mesh, run.anatomy, cycle)
    assert 0.333 in found.s
    assert np.all(np.diff(found.s) > 0.0)
    assert len(found.s) > 30
    polygon = 8.0 * 0.2**2 * np.sin(2.0 * np.pi / 16.0)
    assert found.area_image == pytest.approx(polygon, rel=1e-6)
    more = (1.0 + _bulge(cycle.t + PERIOD)) ** 2
    assert found.area == pytest.approx(polygon * np.tile(more[:, None], len(found.s)), rel=1e-6)
    P = found.read(cycle.P, cycle.points)
    # a field that is linear between nodes 1/12 cm apart: 6 h²/8
    expected = _pressure(found.s[None], (cycle.t + PERIOD)[:, None])
    assert np.abs(P - expected).max() < 6.0 * (LENGTH / 24.0) ** 2 / 4.0 + 1e-9


def test_planes_that_cross_an_end_are_left_out(run, cycle):
    short = Centerline(
        np.array([[0.0, -0.1, 1.0], [0.0, 0.1, 1.9], [0.0, 0.3, 2.8]]), np.array([0.0, 0.92, 1.84])
    )
    anatomy = _anatomy({ANOMALOUS: short})
    found = pullback(run.mesh, anatomy, cycle)
    assert 0.0 < found.s[-1] < 1.0
    assert pullback(run.mesh, _anatomy({}), cycle) is None
