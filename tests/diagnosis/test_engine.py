"""What the diagnosis compiles."""

import os

import numpy as np
import pytest

from benchmarks.blind.clocked import Clock
from diagnosis import CATALOGUE, engine, measured, stacked
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
    texts = [
        engine._fit_block.lower(batch, pairs, x, np.full(2, FITTED), **how).as_text(),
        engine._force_block.lower(batch, pairs, x, np.ones((2, 3)), **how).as_text(),
        engine._descend_block.lower(
            batch, pairs, at_start(x), np.full(2, FITTED), np.ones(2, int), **how
        ).as_text(),
    ]
    if nonlinear:
        scan = engine._scan_block.lower(batch, pairs, x, np.ones((2, 3)), **how)
        texts.append(scan.as_text())
        texts.append(engine._predict_block.lower(batch, pairs, x, **how).as_text())
    for text in texts:
        assert "while" in text
        for library in ("lapack", "custom_call", "stablehlo.fft", "cholesky", "triangular_solve"):
            assert library not in text


def test_programs_compiled_ahead_are_those_that_are_called(monkeypatch):
    effects = CATALOGUE[2:4]
    batch, numbers = stacked([measured(settings())] * 2), numbers_of(effects)
    start = engine.base_start(batch)
    pairs = [(0, -1), (1, -1)]
    own = engine.run_fits(batch, [0, 1], pairs, start, numbers, effects)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with engine.compiled_ahead(batch, numbers, effects):
        assert (engine._fit_block, False) in engine._pending
        ahead = engine.run_fits(batch, [0, 1], pairs, start, numbers, effects)
        assert (engine._fit_block, False) not in engine._pending
    assert not engine._pending
    np.testing.assert_array_equal(ahead.x, own.x)


def test_what_fails_ahead_fails_where_it_is_called(monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    effects = (CATALOGUE[2]._replace(change=lambda c, size: c._replace(nothing=size)),)
    batch, numbers = stacked([measured(settings())]), numbers_of(effects)
    start = engine.base_start(batch)
    with engine.compiled_ahead(batch, numbers, effects), pytest.raises(ValueError, match="nothing"):
        engine.run_fits(batch, [0], [(0, -1)], start, numbers, effects)


def test_each_optimum_is_fitted_once():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.1, 0.1], [0.1, 0.1], [1.0, 0.3]])
    assert engine._distinct(x, np.array([0, 1, 0, 1, 1])).tolist() == [0, 1, 3, 4]
