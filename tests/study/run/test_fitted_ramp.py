"""What documents hold of a ramp: where the power of its flow goes."""

import numpy as np
import pytest

from calibration import RampRecord
from lumped import MMHG
from study.run.fitted_ramp import RampLosses, fitted, ramp_power
from study.run.study_choice import RampChoice
from study.run.study_parts import RampPart
from study.store.json_form import ABSENT, as_json, from_json

A, B = 800.0, 900.0
T = np.linspace(0.0, 1.0, 101)
Q = 7.0 * T
RECORD = RampRecord(T, A * Q + B * Q**2, np.zeros_like(T), Q)
T_FRAME, Q_FRAME = T[[50, 100]], Q[[50, 100]]
LOSSES = RampLosses(T_FRAME, A * Q_FRAME**2, 0.2 * A * Q_FRAME**2, 0.7 * B * Q_FRAME**3)


def test_shares_are_of_drop_times_flow():
    power = ramp_power(RECORD, LOSSES)
    assert power is not ABSENT
    assert power.viscous == pytest.approx(A)
    assert power.viscous_defect == pytest.approx(0.2 * A)
    drop = A * Q_FRAME + B * Q_FRAME**2
    np.testing.assert_allclose(power.frame_drop_mmHg, drop / MMHG, rtol=1e-3)
    np.testing.assert_allclose(power.viscous_share, A * Q_FRAME / drop, rtol=1e-3)
    np.testing.assert_allclose(power.unresolved_share, 0.7 * B * Q_FRAME**2 / drop, rtol=1e-3)


def test_curve_and_resistances_are_the_same_with_losses_and_without():
    alone, with_losses = (as_json(fitted(RECORD, RampChoice(), x).part) for x in (None, LOSSES))
    assert "power" not in alone
    assert alone == {name: part for name, part in with_losses.items() if name != "power"}


def test_a_document_without_power_is_read():
    written = as_json(fitted(RECORD, RampChoice()).part)
    assert from_json(RampPart, written).power is ABSENT


def test_frames_without_flow_have_no_shares():
    still = RECORD.__class__(T, 0.0 * T, 0.0 * T, 0.0 * T)
    assert ramp_power(still, LOSSES) is ABSENT
