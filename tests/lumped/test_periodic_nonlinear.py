"""Periodic states with a quadratic loss: shooting against tight diffrax, derivatives, batches."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    RCR,
    Cycles,
    Fourier,
    Network,
    PressureSource,
    Propagator,
    Shooting,
    Sinusoid,
    Surrogate,
    Vessel,
    connect,
    ffr_divider,
    march,
    pressure_ratio,
    solve_periodic,
)
from lumped.march import aligned_times
from lumped.units import MMHG

P_SYSTOLIC = 110.0 * MMHG
K = 2e4


@pytest.fixture(scope="module")
def surrogate(rest) -> Network:
    return Surrogate(R0=5e3, K=K).network(rest)


@pytest.fixture(scope="module")
def shot(surrogate, solved):
    return solved(surrogate, 0.8, Shooting())


@pytest.fixture(scope="module")
def truth(surrogate, shot, tight_cycle):
    """Every eighth sample of the shooting solution, by diffrax; a wrong start would be seen."""
    return tight_cycle(surrogate, 0.8, shot.t[::8], shot.initial[:3], cycles=3)


def test_shooting_matches_tight_diffrax(shot, truth):
    error = np.abs(np.asarray(shot.z[::8]) - truth)
    # Q|Q| has a kink where the flow reverses, between two steps: there order 5 falls to about 2
    assert np.max(error[:, :5]) < 1e-5 * P_SYSTOLIC
    # at the start of the cycle, far from reversals, less than 1e-8 is left
    assert np.max(error[0, :5]) < 1e-8 * P_SYSTOLIC


def test_error_estimate_of_shooting_is_honest(shot, truth):
    size = np.max(np.abs(truth[:, :3]), axis=0)
    error = np.max(np.abs(np.asarray(shot.z[::8, :3]) - truth[:, :3]) / size)
    assert error / 3.0 < float(shot.error_estimate) < 1e3 * error
    assert float(shot.error_estimate) < 1e-4


def test_flow_that_does_not_reverse_is_solved_to_full_order(solved, tight_cycle):
    inlet = Sinusoid(mean=90.0 * MMHG, amplitude=10.0 * MMHG, period=0.8)
    network = connect(
        {
            "inlet": (PressureSource(inlet), "aorta"),
            "ostium": (Vessel(5e3, C=1e-7, K_stenosis=K), "aorta", "distal"),
            "bed": (RCR(1e4, 3e-6, 8e4), "distal"),
        }
    )
    found = solved(network, 0.8, Shooting(128))
    assert float(jnp.min(found.flow("ostium"))) > 0.1
    truth = tight_cycle(network, 0.8, found.t[::4], found.initial[:2], cycles=3)
    # without a kink the promise of 1e-8 holds
    assert np.max(np.abs(np.asarray(found.z[::4, :4]) - truth[:, :4])) < 1e-8 * P_SYSTOLIC


def test_loss_of_zero_is_the_linear_surrogate(rest, solved):
    nothing = solved(Surrogate(R0=5e3, K=0.0).network(rest), 0.8, Shooting(64))
    linear = solved(Surrogate(R0=5e3).network(rest), 0.8, Shooting(64))
    np.testing.assert_allclose(nothing.z, linear.z, rtol=1e-9, atol=1e-9)
    R_total = linear.network["coronary"].R_total
    assert float(pressure_ratio(nothing)) == pytest.approx(
        float(ffr_divider(5e3, R_total)), rel=1e-7
    )


def test_loss_lowers_the_ratio_and_closes_the_mean_balance(shot):
    bed = shot.network["coronary"]
    linear = float(ffr_divider(5e3, bed.R_total))
    assert float(pressure_ratio(shot)) < linear - 0.01
    # mean pressures obey the linear part: all nonlinearity is in the drop of the ostium
    drain = shot.mean_pressure("distal") / bed.R_total
    assert float(shot.mean_flow("coronary")) == pytest.approx(float(drain), rel=1e-9)


@pytest.mark.parametrize("K", [0.0, 2e4, 1e7])
def test_loss_without_resistance_is_solved(K, rest, solved):
    if K == 0.0:
        found = solved(Surrogate(R0=0.0).network(rest), 0.8, Shooting(64))
        assert float(pressure_ratio(found)) == pytest.approx(1.0, rel=1e-12)
        return
    found = solved(Surrogate(R0=0.0, K=K).network(rest), 0.8, Shooting(64))
    assert bool(jnp.all(jnp.isfinite(found.z)))
    assert 0.0 < float(pressure_ratio(found)) < 1.0


def test_floquet_multiplier_is_the_decay_of_a_disturbance(surrogate, solved):
    shot = solved(surrogate, 0.8, Shooting(64))
    ts = aligned_times(surrogate, 0.8, 64)
    slow = np.linalg.eig(np.asarray(shot.monodromy))
    k = int(np.argmax(np.abs(slow.eigenvalues)))
    direction = np.real(slow.eigenvectors[:, k])
    kick = 1e-3 * P_SYSTOLIC * direction / np.linalg.norm(direction)
    run = jax.jit(march)
    still, moved = (
        run(ts, surrogate, shot.initial.at[:3].add(kick * amount)).z[-1, :3] for amount in (0, 1)
    )
    decay = np.linalg.norm(moved - still) / np.linalg.norm(kick)
    # of a disturbance of 0.1 mmHg: the derivative but for its square
    assert decay == pytest.approx(shot.floquet_multiplier, rel=1e-2)


def test_periodic_state_has_an_exact_gradient(rest, assert_gradient):
    patient = Surrogate(R0=5e3, K=K, alpha=0.7)

    def probe(case):
        condition, (R0, loss, alpha, C0, R_2, C_im) = case
        model = eqx.tree_at(
            lambda s: (s.R0, s.K, s.alpha, s.C0, s.coronary.R_2, s.coronary.C_im),
            patient,
            (R0, loss, alpha, C0, R_2, C_im),
        )
        s = solve_periodic(model.network(condition), condition.period, Shooting(32), throw=False)
        values = s.mean_pressure("distal") + s.pressure("distal")[7] + s.pressure("distal")[20]
        return values / P_SYSTOLIC + s.mean_flow("coronary") + 0.3 * s.flow("coronary")[13]

    bed = patient.coronary
    parameters = (patient.R0, patient.K, patient.alpha, patient.C0, bed.R_2, bed.C_im)
    # a stage near reversal meets the kink within the stencil: a smaller step, a wider tolerance
    assert_gradient(probe, (rest, parameters), tolerance=1e-5, step=1e-4)


def test_periodic_state_of_a_batch_equals_a_loop(rest):
    def run(case):
        loss, alpha = case
        network = Surrogate(R0=5e3, K=loss, alpha=alpha).network(rest)
        return solve_periodic(network, rest.period, Shooting(32), throw=False).z

    cases = jnp.array([[1e3, 1.0], [1e5, 0.2]])
    one = jax.jit(run)
    batch = jax.jit(jax.vmap(run))(cases)
    for found, case in zip(batch, cases, strict=True):
        alone = one(case)
        # the batch iterates until its slowest case is done
        assert np.max(np.abs(found - alone) / np.max(np.abs(alone), axis=0)) < 1e-9


@pytest.mark.slow
def test_cycles_agree_with_shooting(surrogate, solved, truth, shot):
    cycled = solved(surrogate, 0.8, Cycles(rtol=1e-8, atol=1e-4, n_samples=32))
    assert float(cycled.mean_pressure("distal")) == pytest.approx(
        float(shot.mean_pressure("distal")), rel=1e-7
    )
    np.testing.assert_allclose(cycled.initial[:3], truth[0, :3], rtol=1e-6)


@pytest.mark.slow
def test_cycles_have_an_exact_forward_derivative(rest):
    def ratio(R0, solver):
        network = Surrogate(R0=R0).network(rest)
        return pressure_ratio(solve_periodic(network, 0.8, solver, throw=False))

    R0 = jnp.asarray(5e3)
    _, slope = jax.jvp(lambda r: ratio(r, Cycles(n_samples=16)), (R0,), (jnp.ones(()),))
    R_total = Surrogate(R0=5e3).coronary.R_total
    assert float(slope) == pytest.approx(float(-R_total / (5e3 + R_total) ** 2), rel=1e-6)


def test_linear_solvers_refuse_a_loss(surrogate):
    for solver in (Fourier(16), Fourier(16, reduce=False), Propagator(16)):
        with pytest.raises(ValueError, match="quadratic loss"):
            solve_periodic(surrogate, 0.8, solver)


def test_failure_is_said(surrogate):
    with pytest.raises(RuntimeError, match=r"No solution was found.*more steps"):
        solve_periodic(surrogate, 0.8, Shooting(8, max_iterations=1, tolerance=1e-15))
