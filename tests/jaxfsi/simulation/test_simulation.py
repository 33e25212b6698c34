"""Runs of a small elastic tube: records, files, repeats, adaptive steps, checkpoints."""

import csv
import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import pyvista as pv

import jaxfsi.simulation.simulation as simulation
from jaxfsi.core.step.march import march
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import INTERFACE
from jaxfsi.simulation import (
    CheckpointError,
    FieldSeries,
    ShearCycle,
    SimulationError,
    StepControl,
    mean_over,
    write_csv,
)
from lumped.units import ML_PER_MIN, MMHG

DT, N = 1e-3, 20


@pytest.fixture(scope="module")
def plain(run, tube_model, tmp_path_factory):
    """A run with all outputs: folder, result, observer of shear, glimpses."""
    mesh, _, _ = tube_model
    folder = tmp_path_factory.mktemp("plain")
    shear, seen = ShearCycle(mesh, every=2), []
    series = FieldSeries(folder, mesh, every=8)
    end = run(
        observers=[series, shear],
        checkpoint=folder / "c.npz",
        checkpoint_every=10,
        progress=seen.append,
    )
    return folder, end, shear, seen


@pytest.mark.slow  # compiles a second program
def test_run_is_the_march(tube_model, plain, pulsed):
    _, model, state = tube_model
    _, end, _, _ = plain
    expected = march(model, state, prepare(DT, model, **dataclasses.asdict(pulsed.SOLVER)), N)
    np.testing.assert_allclose(end.record.t, expected.history.t, rtol=1e-12)
    # two programs of one step: round-off through iterations that stop at 1e-3
    scale = float(jnp.max(jnp.abs(expected.history.Q_port)))
    np.testing.assert_allclose(end.record.Q_port, expected.history.Q_port, atol=1e-5 * scale)
    np.testing.assert_allclose(end.record.P_port, expected.history.P_port, rtol=1e-5)
    assert end.events == []
    assert end.resumed_from is None
    assert np.all(end.record.n_gmres > 0)
    assert np.all(end.record.residual <= 1e-2)


def test_glimpses_tell_time_and_ports(plain):
    _, end, _, seen = plain
    assert [g.step for g in seen] == [2, 4, 5, 6, 8, 10, 12, 14, 15, 16, 18, 20]
    assert seen[-1].t == float(end.state.t)
    np.testing.assert_array_equal(seen[-1].P_port, end.record.P_port[-1])


def test_record_as_csv_has_clinical_units(plain, tube_model, tmp_path):
    _, end, _, _ = plain
    write_csv(tmp_path / "h.csv", end.record, tube_model[1].names)
    with (tmp_path / "h.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == N
    assert float(rows[-1]["P_outlet_mmHg"]) == pytest.approx(end.record.P_port[-1, 1] / MMHG)
    assert float(rows[3]["Q_inlet_ml_per_min"]) == pytest.approx(
        end.record.Q_port[3, 0] / ML_PER_MIN
    )
    assert float(rows[-1]["step"]) == N


def test_means_weigh_steps_by_length(plain):
    _, end, _, _ = plain
    P, _ = mean_over(end.record, 0.0)
    np.testing.assert_allclose(P, end.record.P_port.mean(axis=0))
    late = mean_over(end.record, 10 * DT)[1]
    np.testing.assert_allclose(late, end.record.Q_port[10:].mean(axis=0))


def test_fields_are_read_back_by_vtk(plain, tube_model):
    folder, end, _, _ = plain
    mesh, _, _ = tube_model
    reader = pv.get_reader(folder / "fields.pvd")
    np.testing.assert_allclose(reader.time_values, [0.0, 8 * DT, 16 * DT], rtol=1e-12)
    reader.set_active_time_value(reader.time_values[-1])
    grid = reader.read()[0]
    np.testing.assert_array_equal(grid.points, mesh.points)
    np.testing.assert_array_equal(grid.cells.reshape(-1, 5)[:, 1:], mesh.tets)
    np.testing.assert_array_equal(grid.cell_data["region"], mesh.region)
    assert grid.field_data["TimeValue"][0] == reader.time_values[-1]
    velocity = grid.point_data["velocity_cm_per_s"]
    faces = mesh.labelled("outlet")
    moved = mesh.points + grid.point_data["displacement_cm"]
    corner = moved[faces]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2.0
    flow = np.sum(velocity[faces].mean(axis=1) * area)
    # single precision, and the interface moved on by a step's displacement error
    assert flow == pytest.approx(end.record.Q_port[15, 1], rel=1e-4)
    solid = mesh.region == 1
    stress = grid.cell_data["stress_dyn_per_cm2"]
    assert stress.shape == (len(mesh.tets), 6)
    assert np.all(stress[~solid] == 0.0)
    xx, yy, zz, xy, yz, xz = stress[solid].T.astype(float)
    mises = np.sqrt(
        ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2.0 + 3.0 * (xy**2 + yz**2 + xz**2)
    )
    # single precision of differences
    np.testing.assert_allclose(grid.cell_data["von_mises_dyn_per_cm2"][solid], mises, rtol=1e-3)
    dry = np.setdiff1d(mesh.tets[solid], mesh.tets[~solid])
    assert len(dry)
    assert np.all(np.isnan(grid.point_data["pressure_mmHg"][dry]))
    assert np.all(np.isfinite(grid.point_data["pressure_mmHg"][mesh.tets[~solid]]))
    assert [int(grid.field_data[f"region_{name}"][0]) for name in ("blood", "wall")] == [0, 1]
    array = grid.GetCellData().GetArray("stress_dyn_per_cm2")
    named = [array.GetComponentName(i) for i in range(6)]
    assert named == ["xx", "yy", "zz", "xy", "yz", "xz"]
    assert np.linalg.norm(grid.point_data["wss_dyn_per_cm2"], axis=1).max() > 0.0


def test_shear_means_are_written_and_in_range(plain, tmp_path):
    shear = plain[2]
    means = shear.means()
    assert means.duration == pytest.approx(N * DT)
    assert np.all((means.osi >= 0.0) & (means.osi <= 0.5))
    assert np.all(means.tawss + 1e-12 >= np.linalg.norm(means.mean, axis=1))
    assert shear.write(tmp_path / "shear.vtu")
    surface = pv.read(tmp_path / "shear.vtu")
    assert surface.n_points == len(means.tawss)
    np.testing.assert_allclose(surface.point_data["tawss_dyn_per_cm2"], means.tawss, rtol=1e-6)


def test_shear_over_the_surface_does_not_count_nodes(plain):
    """Half the area has shear 1, half has 3, whatever the number of nodes in either half."""
    means = plain[2].means()
    area = np.array([0.25, 0.25, 0.05, 0.15, 0.1, 0.2])
    shear = np.array([1.0, 1.0, 3.0, 3.0, 3.0, 3.0])
    means = means._replace(tawss=shear, osi=0.1 * shear, area=area)
    assert means.mean_tawss == pytest.approx(2.0)
    assert means.mean_osi == pytest.approx(0.2)
    assert means.tawss_above(0.9) == pytest.approx(1.0)
    assert means.tawss_above(0.1) == pytest.approx(3.0)


def test_areas_of_nodes_sum_to_the_interface(plain, tube_model):
    mesh = tube_model[0]
    corners = mesh.points[mesh.labelled(INTERFACE)]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = 0.5 * np.linalg.norm(sides, axis=1).sum()
    assert plain[2].means().area.sum() == pytest.approx(whole, rel=1e-12)


def test_shear_means_of_a_flow_to_and_fro(tube_model):
    """Shear τ₀ cos(2π t): TAWSS = 2/π |τ₀|, OSI = ½."""
    mesh, model, state = tube_model
    u = jnp.zeros_like(model.x).at[2].set(jnp.where(model.in_solid, 0.0, 10.0))
    once = ShearCycle(mesh, every=1)
    for t in (0.0, 1.0):
        once.observe(0, model, state._replace(t=jnp.asarray(t), u=u))
    cycle = ShearCycle(mesh, every=1, period=1.0)
    for t in np.linspace(0.0, 2.3, 185):
        now = state._replace(t=jnp.asarray(t), u=u * np.cos(2.0 * np.pi * t))
        cycle.observe(0, model, now)
    found, size = cycle.means(), once.means().tawss
    assert (found.duration, found.t_end) == pytest.approx((1.0, 2.0))
    # trapezoids of |cos| with 80 a cycle: (2π/80)²/12 = 5e-4
    np.testing.assert_allclose(found.tawss, 2.0 / np.pi * size, rtol=2e-3)
    wet = size > 1e-3 * size.max()
    np.testing.assert_allclose(found.osi[wet], 0.5, atol=1e-9)
    np.testing.assert_allclose(once.means().osi[wet], 0.0, atol=1e-9)


def test_interrupted_run_goes_on_to_the_same_bits(run, plain, tube_model, tmp_path):
    mesh, _, _ = tube_model
    folder, end, shear, _ = plain

    def observers():
        return [FieldSeries(tmp_path, mesh, every=8), ShearCycle(mesh, every=2)]

    def interrupt(progress):
        if progress.step == 13 or progress.step == 14:
            raise KeyboardInterrupt

    options = {"checkpoint": tmp_path / "c.npz", "checkpoint_every": 10}
    with pytest.raises(KeyboardInterrupt):
        run(observers=observers(), progress=interrupt, **options)
    again = observers()
    resumed = run(observers=again, **options)
    assert resumed.resumed_from == 12
    for name, column in end.record._asdict().items():
        np.testing.assert_array_equal(getattr(resumed.record, name), column, err_msg=name)
    assert eqx.tree_equal(resumed.state, end.state)
    np.testing.assert_array_equal(again[1].means().tawss, shear.means().tawss)
    for path in folder.glob("fields*"):
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name
    longer = run(n_steps=24, observers=observers(), **options)
    assert longer.resumed_from == N
    assert longer.record.n_steps == 24


@pytest.mark.slow  # compiles the step of a wall that bends
def test_wall_that_bends_goes_on_bit_for_bit(pulsed, tmp_path):
    _, model, state = pulsed.pulsed_tube(wall_element="bending")
    options = {"dt": DT, "solver": pulsed.SOLVER, "chunk": 5, "checkpoint_every": 5}
    whole = simulation.simulate(model, state, n_steps=10, checkpoint=tmp_path / "a.npz", **options)
    path = tmp_path / "b.npz"
    simulation.simulate(model, state, n_steps=5, checkpoint=path, **options)
    resumed = simulation.simulate(model, state, n_steps=10, checkpoint=path, **options)
    assert resumed.resumed_from == 5
    assert float(jnp.max(jnp.abs(whole.state.d))) > 1e-5
    assert eqx.tree_equal(resumed.state, whole.state)
    for name, column in whole.record._asdict().items():
        np.testing.assert_array_equal(getattr(resumed.record, name), column, err_msg=name)


def test_checkpoint_of_another_run_is_refused(run, plain, tube_model, tmp_path):
    mesh, model, _ = tube_model
    folder, _, _, _ = plain
    observers = [FieldSeries(tmp_path, mesh, every=8), ShearCycle(mesh, every=2)]
    options = {"observers": observers, "checkpoint": folder / "c.npz", "checkpoint_every": 10}
    stiffer = eqx.tree_at(lambda m: m.wall.material.E, model, model.wall.material.E * 1.01)
    with pytest.raises(CheckpointError, match=r"another model.*the same parts and sizes"):
        run(model=stiffer, **options)
    with pytest.raises(CheckpointError, match=r"another model.*the same parts and sizes"):
        run(dt=2.0 * DT, **options)
    (tmp_path / "bad.npz").write_bytes((folder / "c.npz").read_bytes()[:500])
    with pytest.raises(CheckpointError, match="cannot be read"):
        run(**{**options, "checkpoint": tmp_path / "bad.npz"})


def test_failed_step_is_repeated_in_parts_and_grows_back(run, plain, monkeypatch):
    """The first attempt at the sixth step is spoilt."""
    _, end, _, _ = plain
    failed_at = []
    advance = simulation.advance_chunk

    def fail_once(model, state, stepper, n_steps, limit, size):
        if float(state.t) > 4.5 * DT and not failed_at:
            failed_at.append(float(state.t))
            bad = state._replace(u=state.u * jnp.nan)
            failed = advance(model, bad, stepper, n_steps, limit, size)
            return failed._replace(state=state)
        return advance(model, state, stepper, n_steps, limit, size)

    monkeypatch.setattr(simulation, "advance_chunk", fail_once)
    found = run(control=StepControl(good_steps=4))
    assert [event["step"] for event in found.events] == [5.0]
    assert "no longer finite" in found.events[0]["cause"]
    np.testing.assert_allclose(found.record.dt[:5], DT)
    np.testing.assert_allclose(found.record.dt[5:9], DT / 2)
    np.testing.assert_allclose(found.record.dt[9:], DT)
    assert float(found.state.t) == pytest.approx(N * DT, rel=1e-12)
    # other steps, other errors: those of a step of 1/100 of the pulse
    scale = np.max(np.abs(end.record.Q_port))
    np.testing.assert_allclose(found.record.Q_port[-1], end.record.Q_port[-1], atol=0.03 * scale)


def test_step_that_fails_at_every_length_is_reported_and_the_rest_is_kept(run, tmp_path, pulsed):
    hard = dataclasses.replace(pulsed.SOLVER, max_iterations=60, tolerance=1e-3)
    path = tmp_path / "c.npz"
    broken = simulation.advance_chunk

    def fail_late(model, state, stepper, n_steps, limit, size):
        if float(state.t) > 4.5 * DT:
            bad = broken(model, state._replace(u=state.u * jnp.nan), stepper, n_steps, limit, size)
            return bad._replace(state=state)
        return broken(model, state, stepper, n_steps, limit, size)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "advance_chunk", fail_late)
        with pytest.raises(
            SimulationError, match=r"Step 6 failed at t = 0.005 s.*step of 0.00025 s"
        ) as error:
            run(control=StepControl(max_halvings=2), checkpoint=path, solver=hard)
    assert error.value.simulation.record.n_steps == 5
    assert len(error.value.simulation.events) == 2
    resumed = run(n_steps=6, control=StepControl(max_halvings=2), checkpoint=path, solver=hard)
    assert resumed.resumed_from == 5


def test_adaptive_steps_shorten_where_the_flow_changes_fast(run):
    found = run(n_steps=5, dt=4.0 * DT, control=StepControl(change_limit=0.05, good_steps=2))
    assert float(found.state.t) == pytest.approx(20 * DT, rel=1e-12)
    assert found.record.dt.min() < 2.0 * DT
    assert np.sum(found.record.dt) == pytest.approx(20 * DT, rel=1e-12)
    # equal steps of the shortest length, as reference
    plain = run(n_steps=20, dt=DT)
    scale = np.max(np.abs(plain.record.Q_port))
    np.testing.assert_allclose(found.record.Q_port[-1], plain.record.Q_port[-1], atol=0.05 * scale)


@pytest.mark.parametrize("fault", [{"n_steps": 0}, {"chunk": 0}, {"checkpoint_every": 0}], ids=str)
def test_numbers_out_of_range_are_refused(run, fault):
    with pytest.raises(ValueError, match=next(iter(fault))):
        run(**fault)
