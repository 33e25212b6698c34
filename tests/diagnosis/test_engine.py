"""What the diagnosis compiles."""

import jax
import numpy as np
import pytest

from benchmarks.blind.clocked import Clock
from diagnosis import CATALOGUE, engine, measured, programs, stacked
from diagnosis.descent import at_start
from diagnosis.hypothesis import FITTED, numbers_of
from diagnosis.prediction import n_unknowns
from tests.diagnosis.records import clocked, settings


@pytest.mark.parametrize("nonlinear", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_compiled_blocks_call_no_library(nonlinear):
    """Batches of factorisations by a library may wait for XLA's threads for ever."""
    batch = stacked([measured(clocked({}, Clock(97.0, 8, 0.03), seed=7)[0])] * 2)
    assert batch.modes is not None  # the scatter of beats, as in any imported record
    k = n_unknowns(measured(settings())) + 2
    pairs, x = np.array([[0, 1], [-1, -1]]), np.zeros((2, k))
    numbers = numbers_of(CATALOGUE)
    how = {"numbers": numbers, "effects": CATALOGUE, "nonlinear": nonlinear}
    traced = [
        engine._fit.traced(batch, pairs, x, np.full(2, FITTED), **how),
        engine._force.traced(batch, pairs, x, np.ones((2, 3)), **how),
        engine._descend.traced(
            batch, pairs, at_start(x), np.full(2, FITTED), np.ones(2, int), **how
        ),
    ]
    if nonlinear:
        traced.append(engine._scan.traced(batch, pairs, x, np.ones((2, 3)), **how))
        traced.append(engine._predict.traced(batch, pairs, x, **how))
    for program in traced:
        lines = program.mlir_module().splitlines()
        text = "\n".join(line for line in lines if not line.startswith("#loc"))
        assert "while" in text
        for library in ("lapack", "custom_call", "stablehlo.fft", "cholesky", "triangular_solve"):
            assert library not in text


def test_programs_compiled_ahead_are_those_that_are_called(monkeypatch):
    effects = CATALOGUE[2:4]
    batch, numbers = stacked([measured(settings())] * 2), numbers_of(effects)
    start = engine.base_start(batch)
    pairs = [(0, -1), (1, -1)]
    own = engine.run_fits(batch, [0, 1], pairs, start, numbers, effects)
    monkeypatch.setattr(engine, "usable_cores", lambda: 2)
    monkeypatch.setattr(engine._fit, "_made", type(engine._fit._made)())
    with engine.compiled_ahead(batch, numbers, effects):
        begun = dict(engine._fit._made)
        assert len(begun) == 1
        ahead = engine.run_fits(batch, [0, 1], pairs, start, numbers, effects)
        assert set(engine._fit._made) == set(begun)
    np.testing.assert_array_equal(ahead.x, own.x)


def test_what_fails_ahead_fails_where_it_is_called(monkeypatch):
    monkeypatch.setattr(engine, "usable_cores", lambda: 2)
    effects = (CATALOGUE[2]._replace(change=lambda c, size: c._replace(nothing=size)),)
    batch, numbers = stacked([measured(settings())]), numbers_of(effects)
    start = engine.base_start(batch)
    with engine.compiled_ahead(batch, numbers, effects), pytest.raises(ValueError, match="nothing"):
        engine.run_fits(batch, [0], [(0, -1)], start, numbers, effects)


def test_each_optimum_is_fitted_once():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 0.1], [0.1, 0.1], [1.0, 0.3]])
    assert engine._distinct(x, np.array([0, 1, 0, 1, 1])).tolist() == [0, 1, 3, 4]


def test_a_program_that_cannot_be_serialised_is_not_kept(tmp_path, monkeypatch):
    def refuse(*_):
        raise ValueError("an operation of no stable version")

    program = jax.export.export(jax.jit(lambda x: x + 1.0))(jax.ShapeDtypeStruct((), float))
    monkeypatch.setattr(jax.export.Exported, "serialize", refuse)
    programs._write(tmp_path / "folder" / "a", program)
    assert list((tmp_path / "folder").iterdir()) == []


def test_a_program_is_traced_once_for_all_processes(tmp_path, monkeypatch):
    """What a process has traced another one reads; a broken file is traced again."""
    effects = CATALOGUE[2:4]
    batch, numbers = stacked([measured(settings())] * 2), numbers_of(effects)
    monkeypatch.setattr(engine._descend, "_made", type(engine._descend._made)())
    start = (
        batch,
        np.array([[0, -1]] * 2),
        at_start(engine.base_start(batch)),
        np.full(2, FITTED),
        np.ones(2, int),
    )
    how = {"numbers": numbers, "effects": effects, "nonlinear": False}
    before = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    try:
        own = engine._descend(*start, **how)
        (kept,) = tmp_path.glob(f"*{programs.SUFFIX}")
        engine._descend._made.clear()
        monkeypatch.setattr(engine._descend, "_traced", None)  # not called
        np.testing.assert_array_equal(engine._descend(*start, **how).x, own.x)
        monkeypatch.undo()
        kept.write_bytes(b"broken")
        engine._descend._made.clear()
        np.testing.assert_array_equal(engine._descend(*start, **how).x, own.x)
        assert kept.stat().st_size > 1000
        other = (effects[0]._replace(change=lambda c, size: c), effects[1])
        engine._descend(*start, numbers=numbers, effects=other, nonlinear=False)
        assert list(tmp_path.glob(f"*{programs.SUFFIX}")) == [kept]
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
        engine._descend._made.clear()
