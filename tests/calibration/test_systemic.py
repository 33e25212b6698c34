import jax
import jax.numpy as jnp
import pytest

from calibration import characteristic_impedance, systemic_windkessel
from lumped import L_PER_MIN, MMHG


def test_windkessel_of_a_typical_adult():
    block = systemic_windkessel(120.0 * MMHG, 75.0 * MMHG, 6.0 * L_PER_MIN, 80.0)
    # ⅔ 75 + ⅓ 120 = 90 mmHg over 100 cm³/s; 80 cm³ over 45 mmHg; exact but for round-off
    assert float(block.R_distal) == pytest.approx(90.0 * MMHG / 100.0, rel=1e-14)
    assert float(block.C) == pytest.approx(80.0 / (45.0 * MMHG), rel=1e-14)
    assert float(block.R_proximal) == 10.0


def test_time_constant_is_the_period_times_mean_over_pulse_pressure():
    period, flow = 0.8, 75.0
    block = systemic_windkessel(110.0 * MMHG, 65.0 * MMHG, flow, flow * period)
    # three roundings
    assert float(block.R_distal * block.C) == pytest.approx(period * 80.0 / 45.0, rel=1e-13)


def test_swapped_pressures_are_refused():
    with pytest.raises(ValueError, match="Were the two swapped"):
        systemic_windkessel(65.0 * MMHG, 110.0 * MMHG, 75.0, 60.0)


@pytest.mark.parametrize(("flow", "volume"), [(0.0, 60.0), (75.0, -1.0)])
def test_output_and_volume_must_be_positive(flow, volume):
    with pytest.raises(ValueError, match=r"(cardiac_output|stroke_volume).*must be finite and pos"):
        systemic_windkessel(110.0 * MMHG, 65.0 * MMHG, flow, volume)


def test_batch_equals_loop():
    flows = jnp.array([50.0, 75.0, 100.0])
    batch = jax.jit(jax.vmap(lambda q: systemic_windkessel(1.4e5, 0.9e5, q, 60.0)))(flows)
    for k in range(3):
        one = systemic_windkessel(1.4e5, 0.9e5, flows[k], 60.0)
        # the same two divisions, possibly by a reciprocal
        assert float(batch.R_distal[k]) == pytest.approx(float(one.R_distal), rel=1e-14)


def test_derivative_matches_central_differences():
    def resistance(q):
        return systemic_windkessel(1.4e5, 0.9e5, q, 60.0).R_distal

    h = 1e-3
    central = (resistance(75.0 + h) - resistance(75.0 - h)) / (2.0 * h)
    # truncation (h/q)² = 2e-10, round-off 1e-16 q/h
    assert float(jax.grad(resistance)(75.0)) == pytest.approx(float(central), rel=1e-8)


def test_impedance_is_that_of_a_line_of_inertance_and_compliance():
    """Z = √(L'/C') with L' = ρ/A, C' = dA/dP = 2 A r (1 − ν²)/(E h) per length."""
    area, rho, E, nu, share = 5.0, 1.06, 4e6, 0.45, 0.1
    compliance = 2.0 * area * (1.0 - nu**2) / (E * share)
    Z = characteristic_impedance(area, rho, E, nu, share)
    assert float(Z) == pytest.approx((rho / area / compliance) ** 0.5, rel=1e-14)
    slope = jax.grad(characteristic_impedance, argnums=2)(area, rho, E, nu, share)
    assert float(slope) == pytest.approx(float(Z) / (2.0 * E), rel=1e-12)
