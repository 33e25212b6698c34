"""The index of a time series, damaged in every way that a disk and a hand know."""

import meshio
import numpy as np
import pytest

from jaxfsi.fields import frame_name, read_series, write_series
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.series import Entry

POINTS = np.vstack([np.zeros(3), np.eye(3)])
TIMES = {10: 0.01, 20: 0.025}


@pytest.fixture
def series(tmp_path):
    """A series of two frames; and the entries that it names."""
    grid = Grid(POINTS, np.arange(4)[None], {}, {})
    entries = []
    for step, t in TIMES.items():
        grid.write(tmp_path / frame_name("fields", step), t, {"v": np.zeros((4, 3))}, {})
        entries.append(Entry(t, frame_name("fields", step)))
    write_series(tmp_path / "fields.pvd", entries)
    return tmp_path / "fields.pvd", entries


DAMAGE = {
    "truncated": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "another encoding": lambda text: text.replace("?>", ' encoding="nothing"?>'),
    "a word for a time": lambda text: text.replace("0.025", "late"),
    "not a number": lambda text: text.replace("0.025", "nan"),
    "no time": lambda text: text.replace("timestep", "time"),
    "a frame that is not there": lambda text: text.replace("_0000020", "_0000021"),
    "a frame elsewhere": lambda text: text.replace('file="', 'file="../'),
}


def test_entries_are_read_as_they_were_written(series):
    path, entries = series
    assert read_series(path) == entries
    assert [entry.step for entry in entries] == list(TIMES)


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_index_gives_way_to_the_frames(damage, series):
    path, entries = series
    path.write_text(DAMAGE[damage](path.read_text()))
    assert read_series(path) == entries


def test_no_index_names_no_frame(tmp_path):
    assert read_series(tmp_path / "fields.pvd") == []


def test_meshio_reads_a_frame(tmp_path):
    cell = {"region": np.array([1], np.uint8)}
    grid = Grid(POINTS, np.arange(4)[None], cell, {"region": ("blood", "wall")})
    velocity, stress = np.arange(12.0).reshape(4, 3), np.arange(6.0)[None]
    grid.write(tmp_path / "frame.vtu", 0.25, {"v": velocity}, {"stress": stress})
    found = meshio.read(tmp_path / "frame.vtu")
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_array_equal(found.cells_dict["tetra"], [[0, 1, 2, 3]])
    np.testing.assert_array_equal(found.point_data["v"], velocity)
    np.testing.assert_array_equal(found.cell_data["stress"][0], stress)
    np.testing.assert_array_equal(found.cell_data["region"][0], [1])
    named = {name: values.item() for name, values in found.field_data.items()}
    assert named == {"TimeValue": 0.25, "region_blood": 0.0, "region_wall": 1.0}
