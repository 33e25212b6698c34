"""α by closed form, Newton and bisection: one answer, right derivatives, clear refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import (
    alpha_closed_form,
    alpha_sensitivities,
    bisect_alpha,
    calibrate_alpha,
    calibrate_many,
    ratio_after_cycles,
    ratio_of_periodic_state,
)
from lumped import (
    MMHG,
    Cycles,
    Fourier,
    HaemodynamicCondition,
    Shooting,
    Surrogate,
    condition_from_clinic,
    nominal_coronary,
)

REST = condition_from_clinic(110.0, 65.0, 0.8)
LINEAR = Surrogate(R0=5e3)
VENOUS = Surrogate(R0=5e3, coronary=nominal_coronary(P_venous=8.0 * MMHG))
QUADRATIC = Surrogate(R0=1e3, K=2e4)


def random_patients(n: int, seed: int = 0):
    """Patients over the clinical range, with and without venous pressure."""
    rng = np.random.default_rng(seed)
    bed = nominal_coronary(P_venous=jnp.asarray(rng.uniform(0.0, 12.0, n) * MMHG))
    beds = eqx.tree_at(lambda b: b.R_3, bed, jnp.asarray(rng.uniform(1e5, 5e5, n)))
    surrogates = Surrogate(R0=jnp.asarray(rng.uniform(5e2, 2e4, n)), coronary=beds)
    diastolic = rng.uniform(45.0, 80.0, n)
    conditions = HaemodynamicCondition(
        jnp.asarray((diastolic + rng.uniform(25.0, 60.0, n)) * MMHG),
        jnp.asarray(diastolic * MMHG),
        jnp.asarray(rng.uniform(0.4, 1.1, n)),
    )
    return surrogates, conditions, jnp.asarray(rng.uniform(0.5, 0.985, n))


def closed_form(surrogates, conditions, targets):
    split, shared = eqx.partition(
        (surrogates, conditions, targets), lambda leaf: eqx.is_array(leaf) and leaf.ndim > 0
    )
    return jax.vmap(lambda own: alpha_closed_form(*eqx.combine(own, shared)))(split)


def test_published_values_of_alpha_are_reproduced():
    # R0 = 5e3 and nominal resistances: values of the divider to the three digits they are known
    for ratio, alpha in ((0.75, 0.041), (0.85, 0.078), (0.9, 0.124), (0.98, 0.676)):
        assert float(alpha_closed_form(LINEAR, REST, ratio)) == pytest.approx(alpha, abs=5e-4)


def test_newton_equals_closed_form_for_random_patients():
    # 1e-12: Newton stops at 1e-13 of 1/ratio, and α is 1/(1 − ratio) ≤ 70 times as sensitive
    surrogates, conditions, targets = random_patients(500)
    batch = calibrate_many(surrogates, conditions, targets)
    exact = closed_form(surrogates, conditions, targets)
    np.testing.assert_allclose(batch.fit.alpha, exact, rtol=1e-11)
    np.testing.assert_allclose(batch.fit.ratio, targets, rtol=1e-13)
    assert int(jnp.max(batch.fit.iterations)) <= 3


@pytest.mark.parametrize("surrogate", [LINEAR, VENOUS], ids=["linear", "venous"])
def test_bisection_equals_newton(surrogate):
    # 1e-8: what is promised of all three ways together; the bracket is cut to 1e-12 of log α
    newton = calibrate_alpha(surrogate, REST, 0.88)
    bisection = bisect_alpha(surrogate, REST, 0.88, solver=Fourier(32))
    assert float(bisection.alpha) == pytest.approx(float(newton.alpha), rel=1e-8)
    assert float(alpha_closed_form(surrogate, REST, 0.88)) == pytest.approx(
        float(newton.alpha), rel=1e-12
    )


def test_four_cycles_miss_alpha_where_the_network_remembers():
    # at α of about 3.5 the transient of four cycles moves α by per cents, at 0.1 by nothing
    slow = Surrogate(R0=2e4)
    exact = alpha_closed_form(slow, REST, 0.985)
    four = bisect_alpha(slow, REST, 0.985, ratio=ratio_after_cycles).alpha
    assert abs(float(four / exact) - 1.0) > 1e-3
    fast = alpha_closed_form(LINEAR, REST, 0.85)
    four_fast = bisect_alpha(LINEAR, REST, 0.85, ratio=ratio_after_cycles).alpha
    assert float(four_fast) == pytest.approx(float(fast), rel=1e-9)


@pytest.fixture(scope="module")
def quadratic_fit():
    return calibrate_alpha(QUADRATIC, REST, 0.85)


def test_quadratic_loss_reaches_the_ratio(quadratic_fit):
    # 1e-10: Newton's tolerance on ratio and periodicity
    patient = eqx.tree_at(lambda s: s.alpha, QUADRATIC, quadratic_fit.alpha)
    reached = ratio_of_periodic_state(patient, REST, solver=Shooting())
    assert float(reached) == pytest.approx(0.85, abs=1e-10)
    assert int(quadratic_fit.iterations) <= 10


@pytest.mark.slow
def test_quadratic_loss_agrees_with_adaptive_cycles(quadratic_fit):
    # 1e-4: the cross-check's mean is a trapezoidal sum of 256 samples
    patient = eqx.tree_at(lambda s: s.alpha, QUADRATIC, quadratic_fit.alpha)
    reached = ratio_of_periodic_state(patient, REST, solver=Cycles())
    assert float(reached) == pytest.approx(0.85, abs=1e-4)


def test_derivative_with_quadratic_loss_matches_central_differences():
    # 1e-6: central differences with a relative step of 1e-4 err by about its square
    def log_alpha(R0, K, target):
        return jnp.log(calibrate_alpha(Surrogate(R0=R0, K=K), REST, target, throw=False).alpha)

    at = (jnp.asarray(1e3), jnp.asarray(2e4), jnp.asarray(0.85))
    both = jax.jit(jax.value_and_grad(log_alpha, argnums=(0, 1, 2)))  # one program for all
    _, slopes = both(*at)
    for k, slope in enumerate(slopes):
        up, down = list(at), list(at)
        up[k], down[k] = at[k] * (1 + 1e-4), at[k] * (1 - 1e-4)
        central = (both(*up)[0] - both(*down)[0]) / (2e-4 * at[k])
        assert float(slope) == pytest.approx(float(central), rel=1e-5)


def test_sensitivities_equal_the_closed_form():
    # log α = log R0 + log r − log(1 − r) − log R_total, round-off of one linear solve
    slopes = alpha_sensitivities(LINEAR, REST, 0.9)
    bed = LINEAR.coronary
    expected = {"ratio": 1.0 / (1.0 - 0.9), "R0": 1.0, "C0": 0.0, "C_im": 0.0, "period": 0.0}
    expected |= {name: -getattr(bed, name) / bed.R_total for name in ("R_1", "R_2", "R_3")}
    for name, value in expected.items():
        assert float(slopes[name]) == pytest.approx(float(value), abs=1e-10)


def test_batch_derivatives_equal_differences_and_the_loop():
    surrogates, conditions, targets = random_patients(7, seed=3)
    batch = calibrate_many(surrogates, conditions, targets, derivatives=True, batch_size=3)
    exact = jax.vmap(jax.grad(lambda r, R0, Rt: R0 * r / ((1 - r) * Rt)))(
        targets, surrogates.R0, surrogates.coronary.R_total
    )
    no_vein = eqx.tree_at(lambda s: s.coronary.P_venous, surrogates, jnp.zeros(7))
    plain = calibrate_many(no_vein, conditions, targets, derivatives=True, batch_size=3)
    np.testing.assert_allclose(plain.d_target, exact, rtol=1e-10)
    loop = calibrate_many(surrogates, conditions, targets, derivatives=True, batch_size=1)
    np.testing.assert_allclose(batch.fit.alpha, loop.fit.alpha, rtol=1e-13)
    np.testing.assert_allclose(batch.d_surrogate.R0, loop.d_surrogate.R0, rtol=1e-11)


def test_jit_equals_eager():
    jitted = eqx.filter_jit(lambda s, c, r: calibrate_alpha(s, c, r, throw=False))
    assert float(jitted(VENOUS, REST, jnp.asarray(0.9)).alpha) == pytest.approx(
        float(calibrate_alpha(VENOUS, REST, 0.9).alpha), rel=1e-13
    )


@pytest.mark.parametrize(
    ("surrogate", "target", "words"),
    [
        (LINEAR, 1.2, "drift"),
        (LINEAR, 1.0, "cannot be reached"),
        (Surrogate(R0=0.0), 0.9, "R0"),
        (VENOUS, 0.05, "venous"),
        (LINEAR, -0.1, "cannot be reached"),
    ],
)
def test_infeasible_targets_are_refused_with_a_cure(surrogate, target, words):
    for solve in (calibrate_alpha, bisect_alpha):
        with pytest.raises(ValueError, match=words):
            solve(surrogate, REST, target)


def test_a_loose_bisection_succeeds_as_loosely():
    fine, loose = (
        bisect_alpha(LINEAR, REST, 0.88, tolerance=t, solver=Fourier(32)) for t in (1e-10, 1e-3)
    )
    assert float(loose.alpha) == pytest.approx(float(fine.alpha), rel=2e-3)
    assert int(loose.iterations) < int(fine.iterations) / 2


def test_bracket_without_root_is_a_failure_with_a_cure():
    with pytest.raises(RuntimeError, match="bracket"):
        bisect_alpha(LINEAR, REST, 0.9, bracket=(10.0, 20.0), solver=Fourier(32))
