"""Checkpoints that cannot be used are refused before anything is written; ends by the user."""

import json

import numpy as np
import pytest

import jaxfsi.simulation.simulation as simulation
from jaxfsi.fields import read_series
from jaxfsi.simulation import (
    CheckpointError,
    FieldSeries,
    ShearCycle,
    SimulationInterrupted,
    StepControl,
)
from jaxfsi.simulation.checkpoint import FORMAT

N = 10
OPTIONS = {"n_steps": N, "checkpoint_every": 5}


@pytest.fixture
def observers(tube_model, tmp_path):
    """Makes the observers of a run in the test's folder."""
    mesh, _, _ = tube_model
    return lambda: [FieldSeries(tmp_path, mesh, every=5), ShearCycle(mesh, every=5)]


@pytest.fixture(scope="module")
def files(run, tube_model, tmp_path_factory):
    """Content of all files of a finished run, by name."""
    mesh, _, _ = tube_model
    folder = tmp_path_factory.mktemp("whole")
    observed = [FieldSeries(folder, mesh, every=5), ShearCycle(mesh, every=5)]
    run(observers=observed, checkpoint=folder / "c.npz", **OPTIONS)
    return _content(folder)


def _content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def _lay_out(files, folder):
    for name, content in files.items():
        (folder / name).write_bytes(content)


def _without(*starts):
    return lambda arrays: {k: v for k, v in arrays.items() if not k.startswith(starts)}


def _with(name, change):
    return lambda arrays: {**arrays, name: change(arrays[name])}


def _with_head(**changes):
    def change(head):
        text = json.dumps({**json.loads(head.tobytes()), **changes})
        return np.frombuffer(text.encode(), np.uint8)

    return _with("head", change)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_without("state.3"), "state.3 is missing"),
        (_with("state.1", lambda a: a[..., :-1]), r"state.1 is float64 of shape .* not float64"),
        (_with("state.0", lambda a: a.astype("f4")), "state.0 is float32"),
        (_without("record.t"), "record.t is missing"),
        (_with("record.Q_port", lambda a: a[1:]), "record.Q_port is"),
        (_without("observer.shear."), r"observer.shear.size is missing.* and \d more"),
        (_with("observer.shear.last", lambda a: a[:2]), "observer.shear.last is"),
        (_with_head(position=[1, 0]), "position"),
        (_with_head(events=None), "events"),
        (_without("head"), "cannot be read"),
        (_with_head(numerics="other"), "another version of the code or of its libraries"),
        (
            _with_head(run_hash="0", structure="0"),
            "version of the code whose model has other fields",
        ),
        (_with_head(format=1), f"has format 1, that of another version; this one reads {FORMAT}"),
    ],
    ids=range(13),
)
def test_damaged_checkpoint_is_refused_and_left_alone(
    run, observers, files, tmp_path, damage, said
):
    _lay_out(files, tmp_path)
    with np.load(tmp_path / "c.npz") as file:
        arrays = damage(dict(file))
    np.savez(tmp_path / "c.npz", **arrays)
    before = _content(tmp_path)
    with pytest.raises(CheckpointError, match=said):
        run(observers=observers(), checkpoint=tmp_path / "c.npz", **OPTIONS)
    assert _content(tmp_path) == before


@pytest.mark.parametrize("content", [b"", b"no archive", b"npy", b"packed"], ids=str)
def test_what_is_no_checkpoint_is_refused(run, tmp_path, content):
    path = tmp_path / "c.npz"
    path.write_bytes(content)
    if content == b"npy":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    if content == b"packed":  # 32 MB of zeros in 32 kB
        np.savez_compressed(path, head=np.zeros(2**22))
    with pytest.raises(CheckpointError, match="cannot be read as a checkpoint"):
        run(checkpoint=path, **OPTIONS)


def test_shorter_run_is_refused_and_leaves_the_longer_one(run, observers, files, tmp_path):
    _lay_out(files, tmp_path)
    said = r"longer run: 10 steps, 0.01 s, where 7 steps, 0.007 s"
    with pytest.raises(CheckpointError, match=said) as refusal:
        run(observers=observers(), checkpoint=tmp_path / "c.npz", **{**OPTIONS, "n_steps": 7})
    assert refusal.value.n_steps == N
    assert _content(tmp_path) == files


@pytest.mark.parametrize("content", [None, b"junk", b"<VTKFile/>"], ids=str)
def test_series_is_listed_anew_from_its_frames(run, observers, files, tmp_path, content):
    _lay_out(files, tmp_path)
    (tmp_path / "fields.pvd").unlink()
    if content is not None:
        (tmp_path / "fields.pvd").write_bytes(content)
    run(observers=observers(), checkpoint=tmp_path / "c.npz", **OPTIONS)
    assert _content(tmp_path) == files


def test_frames_that_cannot_be_read_are_left_out(run, observers, files, tmp_path):
    _lay_out(files, tmp_path)
    (tmp_path / "fields_0000005.vtu").write_bytes(files["fields_0000005.vtu"][:500])
    (tmp_path / "fields_0000003.vtu").write_bytes(files["fields_0000005.vtu"])
    (tmp_path / "fields_first.vtu").write_bytes(files["fields_0000005.vtu"])
    run(observers=observers(), checkpoint=tmp_path / "c.npz", **OPTIONS)
    assert [entry.step for entry in read_series(tmp_path / "fields.pvd")] == [0, 10]


def test_interrupted_run_says_what_its_checkpoint_holds(run, observers, tmp_path, monkeypatch):
    """A step is repeated, then the user ends the run while its second chunk is looked at."""
    advance = simulation.advance_chunk
    failed = []

    def fail_once(model, state, *rest):
        if not failed:
            failed.append(True)
            spoilt = advance(model, state._replace(u=state.u * np.nan), *rest)
            return spoilt._replace(state=state)
        return advance(model, state, *rest)

    monkeypatch.setattr(simulation, "advance_chunk", fail_once)
    observed = observers()
    look = observed[1].observe

    def interrupt(step, model, state):
        look(step, model, state)
        if step == N:
            raise KeyboardInterrupt

    monkeypatch.setattr(observed[1], "observe", interrupt)
    path = tmp_path / "c.npz"
    options = {**OPTIONS, "control": StepControl(max_halvings=1, good_steps=2)}
    with pytest.raises(SimulationInterrupted) as stop:
        run(observers=observed, checkpoint=path, **options)
    kept = stop.value.simulation
    with np.load(path) as file:
        np.testing.assert_array_equal(kept.record.t, file["record.t"])
    assert kept.record.step[-1] == 5
    assert len(kept.events) == 1
    assert observed[1].means().t_end == pytest.approx(5e-3)
    assert [entry.step for entry in read_series(tmp_path / "fields.pvd")] == [0, 5]
    again = observers()
    resumed = run(observers=again, checkpoint=path, **options)
    assert resumed.resumed_from == 5
    assert again[1].means().t_end == pytest.approx(1e-2)
    assert [entry.step for entry in read_series(tmp_path / "fields.pvd")] == [0, 5, 10]
