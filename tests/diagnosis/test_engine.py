"""What the diagnosis compiles."""

import numpy as np
import pytest

from benchmarks.blind.clocked import Clock
from diagnosis import CATALOGUE, engine, measured, stacked
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
        engine._force_block.lower(batch, pairs, x, **how).as_text(),
    ]
    if nonlinear:
        sizes = np.zeros((2, len(CATALOGUE)))
        scan = engine._scan_block.lower(batch, x, sizes, numbers, effects=CATALOGUE)
        texts.append(scan.as_text())
        texts.append(engine._predict_block.lower(batch, pairs, x, **how).as_text())
    for text in texts:
        assert "while" in text
        for library in ("lapack", "custom_call", "stablehlo.fft", "cholesky", "triangular_solve"):
            assert library not in text
