"""The method in time on problems with an exact solution."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha, generalized_alpha

DAMPINGS = [0.0, 0.5, 1.0]


def _field(value: float) -> jnp.ndarray:
    return jnp.full((3, 1), float(value))


def _advanced(method: GeneralizedAlpha, dt, state, stiffness, damping, load=0.0):
    """One step of a + damping u + stiffness d = load with the relations of the method."""
    d, u, a = (_field(value) for value in state)

    def parts(u_new):
        a_new = method.acceleration(dt, u, a, u_new)
        return a_new, method.displacement(dt, d, u, a, a_new)

    def residual(u_new):
        a_new, d_new = parts(u_new)
        return (
            a
            + method.alpha_m * (a_new - a)
            + damping * (u + method.alpha_f * (u_new - u))
            + stiffness * (d + method.alpha_f * (d_new - d))
            - load
        )

    w_a, w_u, w_d = method.weights(dt)
    slope = w_a + damping * w_u + stiffness * w_d
    u_new = -residual(_field(0.0)) / slope
    assert float(jnp.max(jnp.abs(residual(u_new)))) <= 1e-9 * (1.0 + abs(float(slope)))
    a_new, d_new = parts(u_new)
    return tuple(float(field[0, 0]) for field in (d_new, u_new, a_new))


def _amplification(method: GeneralizedAlpha, dt, stiffness, damping) -> np.ndarray:
    columns = [_advanced(method, dt, unit, stiffness, damping) for unit in np.eye(3)]
    return np.asarray(columns).T


def _oscillation_error(method: GeneralizedAlpha, n_steps: int) -> tuple[float, float]:
    omega, T = 3.0, 2.0
    dt = T / n_steps
    step = _amplification(method, dt, omega**2, 0.0)
    d, u, _ = np.linalg.matrix_power(step, n_steps) @ [1.0, 0.0, -(omega**2)]
    return abs(d - np.cos(omega * T)), abs(u + omega * np.sin(omega * T)) / omega


@pytest.mark.parametrize("rho_infinity", DAMPINGS)
def test_oscillator_converges_with_order_two(rho_infinity):
    method = generalized_alpha(rho_infinity)
    errors = np.asarray([_oscillation_error(method, n) for n in (40, 80, 160)])
    orders = np.log2(errors[:-1] / errors[1:])
    # Asymptotic at ω Δt = 0.15: the next term changes the order by a few per cent.
    assert np.all(orders > 1.9)
    assert np.all(orders < 2.3)


@pytest.mark.parametrize("rho_infinity", DAMPINGS)
def test_decay_converges_with_order_two(rho_infinity):
    method, rate, T = generalized_alpha(rho_infinity), 2.0, 1.0
    errors = []
    for n in (20, 40, 80):
        step = _amplification(method, T / n, 0.0, rate)
        u = (np.linalg.matrix_power(step, n) @ [0.0, 1.0, -rate])[1]
        errors.append(abs(u - np.exp(-rate * T)))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(orders > 1.9)


@pytest.mark.parametrize("rho_infinity", DAMPINGS)
def test_fast_decay_shrinks_by_the_chosen_factor(rho_infinity):
    step = _amplification(generalized_alpha(rho_infinity), 1.0, 0.0, 1e9)
    radius = np.max(np.abs(np.linalg.eigvals(step[1:, 1:])))
    # A double root at ρ∞ = 0: round-off of 1e-9 enters by its square root.
    assert radius == pytest.approx(rho_infinity, abs=1e-4)


@pytest.mark.parametrize("rho_infinity", DAMPINGS)
def test_oscillations_never_grow(rho_infinity):
    method = generalized_alpha(rho_infinity)
    for frequency in np.logspace(-2, 6, 30):
        values = np.linalg.eigvals(_amplification(method, 1.0, frequency**2, 0.0))
        assert np.max(np.abs(values)) <= 1.0 + 1e-6


def test_trapezoidal_limit_conserves_energy():
    # ρ∞ = 1 is the implicit midpoint rule for linear problems.
    omega = 3.0
    step = np.linalg.matrix_power(_amplification(generalized_alpha(1.0), 0.1, omega**2, 0.0), 100)
    d, u, _ = step @ [1.0, 0.0, -(omega**2)]
    assert u**2 + omega**2 * d**2 == pytest.approx(omega**2, rel=1e-10)


@pytest.mark.parametrize("rho_infinity", [-0.1, 1.1, float("nan")])
def test_damping_out_of_range_is_refused(rho_infinity):
    with pytest.raises(ValueError, match=r"between 0 and 1; 0\.5 is usual"):
        generalized_alpha(rho_infinity)
