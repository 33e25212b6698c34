"""Losses of a ramp, read from its frames."""

import types
from typing import Any

import jax
import numpy as np
import pytest

from jaxfsi.fields import write_series
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.series import Entry, frame_name
from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.meshing import tube
from study.case.blood import BloodParameters
from study.run.ramp_losses import ramp_losses
from study.run.run_context import INPUTS_FILE, RunContext
from study.store.stages import Stages

KEY, DT, STRETCH = "made", 1e-3, 3.0


@pytest.fixture(autouse=True)
def _fields_times_numbers_of_elements():
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture
def mesh():
    return tube(
        radius=0.1, length=0.2, thickness=0.02, n_around=6, n_axial=2, n_layers=1, n_rings=1
    )


@pytest.fixture
def context(tmp_path, mesh):
    """A context whose ramp left one frame: blood that is stretched along z, on a moved mesh."""
    folder = tmp_path / "ramp"
    (folder / "fields").mkdir(parents=True)
    (folder / INPUTS_FILE).write_text(f"{KEY}\n{{}}\n")
    place = mesh.points * np.array([1.0, 1.0, 2.0])
    u = STRETCH * place * np.array([-0.5, -0.5, 1.0])
    p = np.full(len(place), np.nan)
    p[np.unique(mesh.tets_of(Region.FLUID))] = 60.0
    fields = {
        "velocity_cm_per_s": u.astype(np.float32),
        "pressure_mmHg": p.astype(np.float32),
        "displacement_cm": (place - mesh.points).astype(np.float32),
    }
    grid = Grid(mesh.points, mesh.tets, {"region": mesh.region.astype(np.uint8)})
    entries = [Entry(t, frame_name("fields", step)) for step, t in enumerate((0.0, 0.1))]
    for entry in entries:
        grid.write(folder / "fields" / entry.file, entry.t, fields)
    write_series(folder / "fields" / "fields.pvd", entries)
    made: Any = types.SimpleNamespace(
        case=types.SimpleNamespace(blood=BloodParameters()),
        stages=Stages(tmp_path / "stages"),
        run_folder=lambda name: tmp_path / name,
    )
    made.is_of = lambda key, name: RunContext.is_of(made, key, name)
    return made


def test_losses_are_those_of_the_blood_in_its_moved_place(context, mesh):
    found = ramp_losses(context, KEY, DT)
    assert found is not None
    volume = 2.0 * np.sum(tet_volumes(mesh.points, mesh.tets_of(Region.FLUID)))
    mu = BloodParameters().mu
    np.testing.assert_array_equal(found.t, [0.1])  # the start is no state of the ramp
    np.testing.assert_allclose(found.viscous, 2.0 * mu * 1.5 * STRETCH**2 * volume, rtol=1e-5)
    # fields are in single precision
    np.testing.assert_allclose(found.defect / found.viscous, 0.0, atol=1e-10)
    assert np.all(np.isfinite(found.unresolved))


def test_losses_are_kept_and_frames_of_another_ramp_are_not_read(context, tmp_path):
    found = ramp_losses(context, KEY, DT)
    assert found is not None
    (tmp_path / "ramp" / INPUTS_FILE).write_text("another\n{}\n")
    again = ramp_losses(context, KEY, DT)
    assert again is not None
    np.testing.assert_array_equal(again.viscous, found.viscous)
    context.stages = Stages(tmp_path / "other stages")
    assert ramp_losses(context, KEY, DT) is None
