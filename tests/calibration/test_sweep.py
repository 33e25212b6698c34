"""Sweeps: every case equals the case alone, whatever the chunks."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import grid, simulate_many, sweep_alpha
from lumped import (
    MMHG,
    Fourier,
    HaemodynamicCondition,
    Propagator,
    StressRule,
    Surrogate,
    condition_from_clinic,
    ffr_divider,
    metrics,
    pressure_ratio,
    solve_periodic,
    stress_rule,
)

REST = condition_from_clinic(110.0, 65.0, 0.8)
PATIENT = Surrogate(R0=5e3)
ALPHAS = jnp.geomspace(0.03, 3.0, 23)


def test_ratios_of_a_sweep_equal_the_divider():
    # both are the same direct-current network: round-off
    sweep = sweep_alpha(PATIENT, REST, ALPHAS, n_samples=64, batch_size=10)
    divider = ffr_divider(5e3, ALPHAS * PATIENT.coronary.R_total)
    np.testing.assert_allclose(sweep.metrics.ratio, divider, rtol=1e-12)
    assert sweep.P_distal.shape == (23, 64)


def test_waveforms_of_a_sweep_equal_the_accurate_solver():
    # 1e-3 of the systolic pressure at the slope kinks of the inlet, Fourier's weak point
    sweep = sweep_alpha(PATIENT, REST, ALPHAS[10:12], n_samples=512)
    network = eqx.tree_at(lambda s: s.alpha, PATIENT, ALPHAS[10]).network(REST)
    fine = solve_periodic(network, REST.period, Propagator(512))
    at = np.interp(sweep.t[0], fine.t, fine.pressure("distal"), period=0.8)
    np.testing.assert_allclose(sweep.P_distal[0], at, atol=1e-3 * 110 * MMHG)
    alone = solve_periodic(network, REST.period, Fourier(512))
    np.testing.assert_allclose(sweep.P_distal[0], alone.pressure("distal"), rtol=1e-11)
    np.testing.assert_allclose(sweep.Q[0], alone.flow("ostium"), rtol=1e-9, atol=1e-9)


def test_grid_of_patients_conditions_and_rules_equals_the_loop():
    patients = Surrogate(R0=jnp.asarray([3e3, 8e3]), alpha=jnp.asarray([0.1, 0.4]))
    conditions = HaemodynamicCondition(
        jnp.asarray([110.0, 130.0, 125.0]) * MMHG,
        jnp.asarray([65.0, 70.0, 60.0]) * MMHG,
        jnp.asarray([0.8, 0.45, 0.6]),
    )
    rules = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), stress_rule("printed"), stress_rule("all")
    )
    P, C, R = grid(patients, conditions, rules)
    sweep = simulate_many(P, C, rule=R, n_samples=32, waveforms=False)
    ratios = sweep.metrics.ratio.reshape(2, 3, 2)
    for i in range(2):
        for k, name in enumerate(("printed", "all")):
            pick = jax.tree.map(lambda leaf, i=i: leaf[i] if leaf.ndim else leaf, patients)
            state = jax.tree.map(lambda leaf: leaf[1], conditions)
            network = pick.network(state, rule=stress_rule(name))
            alone = pressure_ratio(solve_periodic(network, state.period, Fourier(32)))
            assert float(ratios[i, 1, k]) == pytest.approx(float(alone), rel=1e-12)


def test_chunk_size_changes_nothing():
    # same arithmetic, other vector lengths: a few units of the last digit
    big = sweep_alpha(PATIENT, REST, ALPHAS, n_samples=32, batch_size=23)
    small = sweep_alpha(PATIENT, REST, ALPHAS, n_samples=32, batch_size=4)
    np.testing.assert_allclose(big.P_distal, small.P_distal, rtol=1e-12)


@pytest.mark.slow
def test_sweep_with_quadratic_loss_falls_below_the_linear_one():
    lossy = eqx.tree_at(lambda s: s.K, PATIENT, jnp.asarray(2e4), is_leaf=lambda x: x is None)
    sweep = sweep_alpha(lossy, REST, ALPHAS[8:10], n_samples=64, rule=StressRule())
    linear = sweep_alpha(PATIENT, REST, ALPHAS[8:10], n_samples=64, rule=StressRule())
    assert np.all(np.asarray(sweep.metrics.ratio) < np.asarray(linear.metrics.ratio))
    network = eqx.tree_at(lambda s: s.alpha, lossy, ALPHAS[8]).network(REST, rule=StressRule())
    alone = metrics(solve_periodic(network, REST.period))
    # 2e-4: 64 steps a cycle against 192, third order lost where the flow changes sign
    assert float(sweep.metrics.ratio[0]) == pytest.approx(float(alone.ratio), abs=2e-4)


def test_grid_refuses_axes_of_unequal_length():
    bad = HaemodynamicCondition(jnp.ones(2), jnp.ones(3) * 0.5, jnp.ones(2))
    with pytest.raises(ValueError, match="leading axes"):
        grid(PATIENT, bad)
