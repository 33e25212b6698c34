"""Input that has no answer: refused when it can be looked at, NaN with a reason under jit and vmap.

One registry: a function of named numbers, good ones, and changes that leave it without an answer.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from calibration import (
    PressureFlowLaw,
    RampRecord,
    alpha_closed_form,
    bisect_alpha,
    calibrate_alpha,
    calibrate_many,
    characteristic_impedance,
    contraction_coefficient,
    fit_ramp,
    lumen_law,
    map_cases,
    mean_aortic_pressure,
    mean_pressure_target,
    measured_slope,
    ratio_after_cycles,
    simulate_many,
    systemic_windkessel,
)
from diagnosis import ratio_gap
from jaxfsi import Lumen
from lumped import (
    MMHG,
    RC,
    RESULTS,
    Fourier,
    Surrogate,
    averaged,
    condition_from_clinic,
    ffr_divider,
    mean_state,
    metrics,
    nominal_coronary,
    scale_resistances,
    solve_periodic,
)
from lumped.parameters import real
from lumped.views import direct_current, transfer_impedance

NAN, INF = float("nan"), float("inf")
REST = condition_from_clinic(120.0, 80.0, 0.8)
PATIENT = Surrogate(R0=1000.0)
RAMP = RampRecord(np.linspace(0.0, 1.0, 40), *np.zeros((3, 40)))


class Case(NamedTuple):
    function: Callable[..., Any]
    good: dict[str, float]
    bad: list[dict[str, float]]


def _patient(R0, target, P_systolic, P_venous, period):
    bed = nominal_coronary(P_venous=P_venous)
    condition = condition_from_clinic(P_systolic, 80.0, period)
    return Surrogate(R0=R0, coronary=bed), condition, target


def _found(fit):
    return fit.alpha, fit.ratio


def _circle(radius):
    angle = jnp.linspace(0.0, 2.0 * jnp.pi, 12, endpoint=False)
    ring = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    return Lumen(radius * jnp.broadcast_to(ring, (3, 12, 2)), jnp.array([0.0, 0.5, 1.0]))


def _ramp(flow, offset=0.0):
    rise, growth = jnp.asarray(4e4 * RAMP.t), jnp.asarray(RAMP.t**0.7)
    columns = (rise + offset, jnp.zeros(40), flow * growth)
    return eqx.tree_at(lambda r: (r.P_aorta, r.P_distal, r.Q), RAMP, columns)


def _divider(surrogate, condition):
    return jnp.asarray(ffr_divider(surrogate.R0, surrogate.alpha * surrogate.coronary.R_total))


def _views(block):
    return jnp.abs(transfer_impedance(block, jnp.array([6.0]))), direct_current(0.0, block)[0]


ALPHA = {"R0": 1000.0, "target": 0.9, "P_systolic": 120.0, "P_venous": 0.0, "period": 0.8}
WITHOUT_ALPHA = [
    *({"target": value} for value in (1.2, 1.0, 0.0, -0.5, NAN, INF)),
    *({"R0": value} for value in (0.0, -5.0, NAN, INF)),
    *({"P_systolic": value} for value in (70.0, 0.0, -120.0, NAN, INF)),
    *({"period": value} for value in (0.0, -0.8, NAN)),
    *({"P_venous": value} for value in (95.0 * MMHG, 1e300, NAN)),
]
CASES = {
    "calibrate_alpha": Case(
        lambda **x: _found(calibrate_alpha(*_patient(**x))), ALPHA, WITHOUT_ALPHA
    ),
    "alpha_closed_form": Case(lambda **x: alpha_closed_form(*_patient(**x)), ALPHA, WITHOUT_ALPHA),
    "bisect_alpha": Case(
        lambda **x: _found(bisect_alpha(*_patient(**x), ratio=_divider)), ALPHA, WITHOUT_ALPHA
    ),
    "systemic_windkessel": Case(
        lambda s, d, q, v: jax.tree.leaves(
            (lambda b: (b.R_proximal, b.C, b.R_distal))(systemic_windkessel(s, d, q, v))
        ),
        {"s": 1.6e5, "d": 1e5, "q": 90.0, "v": 70.0},
        [
            {"s": 0.9e5},
            {"d": -1.0},
            *({name: value} for name in "sdqv" for value in (0.0, -1.0, NAN, INF)),
        ],
    ),
    "characteristic_impedance": Case(
        lambda area, rho, E, nu, h: characteristic_impedance(area, rho, E, nu, h),
        {"area": 5.0, "rho": 1.06, "E": 4e6, "nu": 0.45, "h": 0.1},
        [
            *({"nu": value} for value in (1.0, 0.6, -0.1, NAN)),
            *(
                {name: value}
                for name in ("area", "rho", "E", "h")
                for value in (0.0, -1.0, NAN, INF)
            ),
        ],
    ),
    "fit_ramp": Case(
        lambda flow, offset: (lambda f: (f.law.R0, f.law.K, f.L, f.rms, f.covariance))(
            fit_ramp(_ramp(flow, offset))
        ),
        {"flow": 5.0, "offset": 0.0},
        [*({"flow": value} for value in (0.0, -5.0, NAN, INF)), {"offset": NAN}, {"offset": INF}],
    ),
    "ratio_after_cycles": Case(
        lambda R0, period: ratio_after_cycles(
            Surrogate(R0=R0), condition_from_clinic(120.0, 80.0, period), n_steps=8
        ),
        {"R0": 1000.0, "period": 0.8},
        [{"R0": -900.0}, {"R0": NAN}, {"period": -0.8}, {"period": 0.0}],
    ),
    "mean_state": Case(
        lambda R0, s: mean_state(
            Surrogate(R0=R0).network(condition_from_clinic(s, 80.0, 0.8)), 0.8
        ),
        {"R0": 1000.0, "s": 120.0},
        [{"R0": -900.0}, {"R0": NAN}, {"s": 70.0}, {"s": NAN}],
    ),
    "mean_aortic_pressure": Case(
        lambda s, T: mean_aortic_pressure(PATIENT, condition_from_clinic(s, 80.0, T)),
        {"s": 120.0, "T": 0.8},
        [{"s": 70.0}, {"s": NAN}, {"T": 0.0}, {"T": -0.8}, {"T": INF}],
    ),
    "ffr_divider": Case(
        lambda R0, R, P, v: ffr_divider(R0, R, P, v),
        {"R0": 1.0, "R": 9.0, "P": 1e5, "v": 0.0},
        [
            *({"R0": value} for value in (-1.0, NAN, INF)),
            *({name: value} for name in "RP" for value in (0.0, -9.0, NAN, INF)),
            {"v": NAN},
        ],
    ),
    "contraction_coefficient": Case(
        lambda angle: contraction_coefficient(angle),
        {"angle": 0.5},
        [{"angle": value} for value in (-0.1, 30.0, NAN, INF)],
    ),
    "PressureFlowLaw": Case(
        lambda a, b: (lambda law: (law.tangent(4e4), law.secant(4e4), law.flow(4e4)))(
            PressureFlowLaw(a, b)
        ),
        {"a": 500.0, "b": 450.0},
        [{"a": -500.0}, {"a": 0.0, "b": 0.0}, {"a": NAN}, {"b": NAN}],
    ),
    "lumen_law": Case(
        lambda radius, mu, rho, Q, up: (lambda law: (law.R0, law.K))(
            lumen_law(_circle(radius), mu=mu, rho=rho, Q_reference=Q, area_upstream=up)
        ),
        {"radius": 0.1, "mu": 0.04, "rho": 1.06, "Q": 1.5, "up": 5.0},
        [
            *({name: value} for name in ("mu", "rho", "Q", "radius") for value in (0.0, NAN, INF)),
            *({name: -1.0} for name in ("mu", "rho", "Q", "up")),
            {"up": 0.0},
            {"up": NAN},
        ],
    ),
    "ratio_gap": Case(
        lambda p, m, sd: tuple(ratio_gap(p, m, sd))[1:],
        {"p": 0.85, "m": 0.8, "sd": 0.02},
        [
            *({"sd": value} for value in (0.0, -0.02, NAN, INF)),
            *({name: value} for name in "pm" for value in (NAN, INF)),
        ],
    ),
    "views of a block": Case(
        lambda R, C: _views(RC(R=R, C=C)),
        {"R": 1e3, "C": 1e-5},
        [{name: value} for name in "RC" for value in (-1.0, 0.0, NAN, INF)],
    ),
}


SLOW = ("bisect_alpha", "ratio_after_cycles", "mean_state", "mean_aortic_pressure")
"""Cases that take seconds to compile."""
NAMES = [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in CASES]
EAGER = [
    pytest.param(n, marks=pytest.mark.slow) if n in (*SLOW, "fit_ramp", "lumen_law") else n
    for n in CASES
]


def _rows(case: Case) -> dict[str, np.ndarray]:
    rows = [case.good, *({**case.good, **change} for change in case.bad)]
    return {name: np.array([row[name] for row in rows]) for name in case.good}


@pytest.mark.parametrize("name", NAMES)
def test_input_without_an_answer_gives_nan_under_jit_and_vmap(name):
    case = CASES[name]
    found = jax.jit(jax.vmap(lambda x: case.function(**x)))(_rows(case))
    for leaf in jax.tree.leaves(found):
        assert np.all(np.isfinite(leaf[0])), "the good row"
        answered = np.any(~np.isnan(np.asarray(leaf[1:]).reshape(len(case.bad), -1)), axis=1)
        plausible = [case.bad[k] for k in np.flatnonzero(answered)]
        assert not plausible


@pytest.mark.parametrize("name", EAGER)
def test_input_without_an_answer_is_refused_eagerly(name):
    case = CASES[name]
    for change in case.bad:
        with pytest.raises((ValueError, RuntimeError), match=r"\. |\?"):
            case.function(**{**case.good, **change})


@pytest.mark.slow
def test_reasons_are_told_apart_and_derivatives_are_nan_too():
    targets = jnp.array([0.9, 1.2, 0.9])
    patients = Surrogate(R0=1000.0)
    patients = eqx.tree_at(lambda s: s.R0, patients, jnp.array([1e3, 1e3, -1e3]))
    found = calibrate_many(patients, REST, targets, derivatives=True)
    codes = [RESULTS.successful, RESULTS.infeasible, RESULTS.outside_range]
    for k, code in enumerate(codes):
        assert jax.tree.map(lambda leaf, k=k: leaf[k], found.fit.result) == code
    np.testing.assert_array_equal(np.isnan(found.fit.alpha), [False, True, True])
    assert found.d_target is not None
    assert found.d_surrogate is not None
    for slopes in (found.d_target, found.d_surrogate.R0):
        np.testing.assert_array_equal(jnp.isnan(slopes), [False, True, True])


def test_no_alpha_without_throw_is_nan_with_a_reason():
    found = calibrate_alpha(PATIENT, REST, 1.2, throw=False)
    assert np.isnan(found.alpha)
    assert found.result == RESULTS.infeasible


def test_codes_equal_those_of_optimistix():
    """Whoever compares with `optimistix.RESULTS` may go on doing so."""
    found = calibrate_alpha(PATIENT, REST, 0.9, throw=False)
    assert found.result == optx.RESULTS.successful
    assert optx.RESULTS.successful == found.result
    assert found.result != optx.RESULTS.singular
    assert calibrate_alpha(PATIENT, REST, 1.2, throw=False).result != optx.RESULTS.successful

    @jax.jit
    @jax.vmap
    def successful(target):
        return calibrate_alpha(PATIENT, REST, target).result == optx.RESULTS.successful

    np.testing.assert_array_equal(successful(jnp.array([0.9, 1.2])), [True, False])


@pytest.mark.slow
def test_one_patient_without_an_answer_spoils_no_other_with_quadratic_loss():
    one = Surrogate(R0=1000.0, K=120.0)
    alone = calibrate_alpha(one, REST, 0.9).alpha
    for where, bad in ((lambda s: s.R0, -1e3), (lambda s: s.K, NAN), (lambda s: s.C0, INF)):
        patients = eqx.tree_at(where, one, jnp.stack([where(one), real(bad), where(one)]))
        found = calibrate_many(patients, REST, jnp.array([0.9, 0.9, 1.2]), derivatives=True)
        np.testing.assert_array_equal(np.isnan(found.fit.alpha), [False, True, True])
        assert found.d_target is not None
        np.testing.assert_array_equal(jnp.isnan(found.d_target), [False, True, True])
        # the batch is compiled by itself: the last bits, times the condition of Newton's step
        np.testing.assert_allclose(found.fit.alpha[0], alone, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("K", [None, 120.0])
def test_sweep_tells_which_cases_have_no_periodic_state(K):
    surrogates = eqx.tree_at(lambda s: s.R0, Surrogate(R0=1e3, K=K), jnp.array([1e3, -1e3, NAN]))
    found = simulate_many(surrogates, REST, n_samples=32)
    good = found.result == RESULTS.successful
    np.testing.assert_array_equal(good, [True, False, False])
    for leaf in jax.tree.leaves((found.metrics, found.error_estimate, found.Q, found.P_distal)):
        finite = np.isfinite(np.asarray(leaf).reshape(3, -1))
        np.testing.assert_array_equal(finite.all(axis=1), good)
        np.testing.assert_array_equal(finite.any(axis=1), good)


@pytest.mark.slow
def test_ramp_without_flow_has_no_law_and_says_why():
    assert fit_ramp(_ramp(0.0), throw=False).result == RESULTS.undetermined
    assert fit_ramp(_ramp(NAN), throw=False).result == RESULTS.nonfinite
    with pytest.raises(RuntimeError, match=r"do not determine.*must not vanish"):
        fit_ramp(_ramp(0.0))


def test_derivatives_near_the_limit_are_finite():
    slope = jax.grad(lambda r: alpha_closed_form(PATIENT, REST, r))
    near = jax.jit(jax.vmap(slope))(jnp.array([0.9, 1.0 - 1e-9, 1e-9]))
    assert np.all(np.isfinite(near))
    # α = R0 r / ((1 − r) R_total), so dα/dr = R0/((1 − r)² R_total); round-off
    expected = 1000.0 / (0.1**2 * float(PATIENT.coronary.R_total))
    np.testing.assert_allclose(near[0], expected, rtol=1e-12)


def test_slope_of_a_ramp_is_none_where_it_has_none():
    good = measured_slope(_ramp(5.0), 2e4)
    assert good is not None
    assert good > 0.0
    for flow in (0.0, -5.0, NAN):
        assert measured_slope(_ramp(flow), 2e4) is None
    assert measured_slope(_ramp(5.0, NAN), 2e4) is None


def test_factors_that_are_not_positive_are_refused():
    for factor in (0.0, -1.0, NAN, INF):
        with pytest.raises(ValueError, match="finite and positive"):
            scale_resistances(nominal_coronary(), factor)
        with pytest.raises(ValueError, match="bracket"):
            bisect_alpha(PATIENT, REST, 0.9, bracket=(factor, 1e4), ratio=_divider)


def test_cycles_and_tolerances_that_are_none_are_refused(solution):
    for counts in ({"cycles": 0}, {"n_steps": 0}, {"n_steps": -3}):
        with pytest.raises(ValueError, match="at least 1"):
            ratio_after_cycles(PATIENT, REST, **counts)
    for tolerance in (0.0, 1.0, -1.0, NAN):
        with pytest.raises(ValueError, match="between 0 and 1"):
            solution.cycles_to(tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("K", [1.0, -1e4, -1e6, -1e9])
def test_mean_state_of_a_nonlinear_network_is_one_or_nan(K):
    network = Surrogate(R0=1e3, K=1.0).network(REST)
    lossy = eqx.tree_at(lambda n: n["ostium"].K_stenosis, network, real(K))
    z = mean_state(lossy, 0.8)
    left = averaged(lossy, 0.8).residual(0.0, z)
    # pressures [dyn/cm²] of 1e5
    assert np.all(np.isnan(z)) or np.max(np.abs(left)) < 1e-4
    assert np.all(np.isfinite(z)) or K < 0.0


def test_cases_need_one_common_length():
    for cases in ((jnp.zeros(2), jnp.zeros(3)), (jnp.zeros(()),), (jnp.zeros(0),)):
        with pytest.raises(ValueError, match=r"one common length|at least one"):
            map_cases(lambda case: case[0], cases, batch_size=2)


NETWORK = PATIENT.network(REST)
COMPLIANCE = lambda n: n["coronary"].C_a  # noqa: E731
RESISTANCE = lambda n: n["ostium"].R_viscous  # noqa: E731
SYSTOLE = lambda n: n["inlet"].waveform.P_systolic  # noqa: E731


@pytest.fixture(scope="module")
def solution():
    return solve_periodic(NETWORK, 0.8, Fourier(16))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "value"),
    [
        *((RESISTANCE, value) for value in (-900.0, NAN, INF)),
        *((COMPLIANCE, value) for value in (-4.5e-7, 0.0, NAN, INF)),
        *((SYSTOLE, value) for value in (70.0 * MMHG, -1e5, NAN)),
    ],
)
def test_network_outside_its_ranges_has_no_periodic_state(where, value, solution):
    """A network made under jit: its parameters were not looked at."""
    assert np.isfinite(metrics(solution).ratio)
    bad = eqx.tree_at(where, NETWORK, real(value))
    found = solve_periodic(bad, 0.8, Fourier(16), throw=False)
    assert found.result == RESULTS.outside_range
    assert np.all(np.isnan(found.z))
    assert all(np.isnan(number) for number in metrics(found))
    with pytest.raises(RuntimeError, match=r"outside its range.*Is some node"):
        solve_periodic(bad, 0.8, Fourier(16))


@pytest.mark.slow
def test_spread_below_zero_leaves_no_residual(solution):
    target = mean_pressure_target("aorta", 1e5, 1e3)
    for sd in (1e3, -1e3, 0.0, NAN):
        residual = eqx.tree_at(lambda t: t.sd, target, real(sd))(solution)
        assert np.all(np.isfinite(residual)) == (sd == 1e3)
