"""Fits and runs whose data have no answer: refused, or NaN with a reason."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from calibration import (
    Trial,
    VesselRecord,
    calibrate_in_loop,
    calibrate_vessels,
    fit,
    next_alpha,
    surrogate_ratio,
)
from lumped import Surrogate, condition_from_clinic

NAN, INF = float("nan"), float("inf")
REST = condition_from_clinic(120.0, 80.0, 0.8)
PATIENT = Surrogate(R0=1000.0)


def test_calibration_in_the_loop_refuses_what_no_factor_reaches():
    trials = [Trial(0.1, 0.9), Trial(0.2, 0.95)]
    for target in (1.0, 1.2, 0.0, -0.5, NAN):
        with pytest.raises(ValueError, match="between 0 and 1"):
            next_alpha(PATIENT, REST, target, trials)
        with pytest.raises(ValueError, match="between 0 and 1"):
            calibrate_in_loop(PATIENT, REST, target, lambda alpha: 0.9, [0.1])
    for alpha in (0.0, -1.0, NAN, INF):
        with pytest.raises(ValueError, match="positive"):
            surrogate_ratio(PATIENT, REST, alpha)
        with pytest.raises(ValueError, match="positive"):
            calibrate_in_loop(PATIENT, REST, 0.9, lambda alpha: 0.9, [alpha])


def test_run_without_a_ratio_is_never_the_best():
    ratios = iter([NAN, 0.7])
    found = calibrate_in_loop(
        PATIENT, REST, 0.9, lambda alpha: next(ratios), [0.1, 0.2], max_extra=1
    )
    assert found.ratio == 0.7
    assert not found.reached


def _vessel_record(values):
    return VesselRecord(*(jnp.asarray(values) * (k + 1.0) for k in range(7)))


@pytest.mark.slow
def test_vessels_without_finite_records_have_no_parameters():
    values = np.sin(np.arange(12.0)).reshape(2, 6)
    values[1, 2] = np.nan

    def resistance(record):
        fit = calibrate_vessels(record, throw=False)
        return jnp.nansum(fit.parameters.R_viscous), fit

    slope, found = jax.grad(resistance, has_aux=True)(_vessel_record(values))
    for leaf in jax.tree.leaves(found.parameters):
        np.testing.assert_array_equal(np.isnan(leaf), [False, True])
    assert jax.tree.map(lambda leaf: leaf[1], found.result) == optx.RESULTS.nonfinite
    assert np.all(np.isfinite(slope.P_in[0]))
    with pytest.raises(ValueError, match=r"vessels \[1\]"):
        calibrate_vessels(_vessel_record(values))
    with pytest.raises(ValueError, match="determines nothing"):
        calibrate_vessels(_vessel_record(np.zeros((1, 0))))


class Numbers(eqx.Module):
    x: Any


@pytest.mark.slow
def test_fit_to_what_is_not_finite_has_no_values():
    model = Numbers(jnp.asarray(2.0))

    def data(m):
        return jnp.array([m.x * NAN])

    assert np.all(np.isnan(fit(model, ["x"], data, throw=False).values))
    with pytest.raises(RuntimeError, match="not finite"):
        fit(model, ["x"], data)
