"""Pressures of a run, whatever its inlet is called."""

import numpy as np
import pytest

from jaxfsi.simulation.cycles import cycle_means, inlet_of, waveforms
from jaxfsi.simulation.record import StepHistory
from lumped.units import ML_PER_MIN, MMHG

NAMES = ("outer_wall", "outlet", "inlet")


@pytest.fixture
def record() -> StepHistory:
    """Eight steps of a segment, which has no aorta: 90 mmHg at its inlet, 80 at its outlet."""
    n = 8
    rows, counts = np.ones(n), np.ones(n, np.int64)
    t = 0.1 * np.arange(1, n + 1)
    P = MMHG * np.array([0.0, 80.0, 90.0]) * rows[:, None]
    Q = ML_PER_MIN * np.array([0.0, 60.0, -60.0]) * rows[:, None]
    return StepHistory(rows, t, 0.1 * rows, P, Q, counts, counts, rows, rows, rows)


def test_waveforms_of_a_segment_are_those_of_its_inlet(record):
    found = waveforms(record, NAMES, "outlet", 4)
    np.testing.assert_allclose(found.P_aorta_mmHg, 90.0, rtol=1e-12)
    np.testing.assert_allclose(found.P_distal_mmHg, 80.0, rtol=1e-12)
    np.testing.assert_allclose(found.Q_ml_per_min, 60.0, rtol=1e-12)
    assert len(found.t_s) == 4
    np.testing.assert_array_equal(inlet_of(record, NAMES).P_mmHg[::2], found.P_aorta_mmHg)
    (cycle,) = cycle_means(record, NAMES, 0.8)
    assert cycle.ratio == pytest.approx(80.0 / 90.0, rel=1e-12)


def test_waveforms_of_ports_without_an_inlet_are_refused(record):
    with pytest.raises(ValueError, match="Name the opening where blood comes in"):
        waveforms(record, ("outer_wall", "outlet", "arch"), "outlet", 4)
