"""Closed forms of the verification problems against each other, limits and other sources."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.ports.velocity import VelocityPort
from jaxfsi.core.step.equations import prescribed_velocity
from jaxfsi.core.step.model import build_model
from jaxfsi.meshing import tube
from jaxfsi.verification.derivatives import compare_along, compare_each, steps_of
from jaxfsi.verification.elastic_tube import ElasticTube, measured_wave_number
from jaxfsi.verification.ethier_steinman import (
    BalancedVelocity,
    EthierSteinman,
    box_mesh,
    ethier_steinman_model,
    ethier_steinman_state,
    norm,
    velocity_error,
)
from jaxfsi.verification.figures import figure, in_band, observed_orders, order_figure
from jaxfsi.verification.rigid_tube import (
    RigidTube,
    developed_state,
    middle_section,
    poiseuille_errors,
    rigid_tube_model,
    womersley_errors,
)
from jaxfsi.verification.round_tube import round_tube
from jaxfsi.verification.windkessel_tube import (
    SHORT_TUBE,
    driven_pressure,
    history_error,
    periodic_pressure,
    range_error,
)
from jaxfsi.verification.womersley import (
    friction_factor,
    impedance_per_length,
    static_compliance,
    velocity_shape,
    wave_number,
)
from lumped.waveforms import Constant

SOLUTION = EthierSteinman(mu=0.1)


class Pair(NamedTuple):
    R: float
    C: float


def test_ethier_steinman_solves_the_equations():
    """ρ (∂u/∂t + u·∇u) + ∇p − μ ∇²u = 0 and ∇·u = 0, by automatic differentiation."""
    x = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5)))
    t = jnp.asarray(0.3)

    def at(t, point):
        return SOLUTION(t, point[:, None])[:, 0]

    def pressure(t, point):
        return SOLUTION.pressure(t, point[:, None])[0]

    for point in x.T:
        u, slope = at(t, point), jax.jacfwd(at, 1)(t, point)
        curvature = jnp.trace(jax.jacfwd(jax.jacfwd(at, 1), 1)(t, point), axis1=1, axis2=2)
        rate = jax.jacfwd(at, 0)(t, point)
        np.testing.assert_allclose(rate, -SOLUTION.rate * u, rtol=1e-12)
        residual = (
            SOLUTION.rho_f * (rate + slope @ u)
            + jax.grad(pressure, 1)(t, point)
            - SOLUTION.mu * curvature
        )
        # Terms of about 5 cancel to round-off.
        np.testing.assert_allclose(residual, 0.0, atol=1e-12)
        assert float(jnp.trace(slope)) == pytest.approx(0.0, abs=1e-13)


def test_balanced_velocity_lets_nothing_through_and_changes_little():
    changes = []
    for n in (4, 8):
        model = ethier_steinman_model(box_mesh(n), SOLUTION)
        faces = model.port_faces[0]
        u, exact = BalancedVelocity(SOLUTION, faces)(0.0, model.x), SOLUTION(0.0, model.x)
        assert float(flux(u, model.x, faces)) == pytest.approx(0.0, abs=1e-12)
        changes.append(float(jnp.max(jnp.abs(u - exact))))
    # What is taken out is the error of linear interpolation, of second order.
    assert changes[0] / changes[1] == pytest.approx(4.0, rel=0.05)


def test_a_closed_rigid_box_counts_its_pressure_from_one_node():
    mesh = box_mesh(3)
    model = ethier_steinman_model(mesh, SOLUTION)
    assert int(jnp.sum(~model.in_fluid)) == 1
    state = ethier_steinman_state(0.2, 0.01, model, SOLUTION)
    assert float(jnp.sum(jnp.where(model.in_fluid, 0.0, state.p))) == 0.0
    assert float(velocity_error(state, model, SOLUTION)) < 1e-15
    # A uniform velocity of (1, 2, 2) over 8 cm³.
    uniform = jnp.broadcast_to(jnp.asarray([[1.0], [2.0], [2.0]]), model.x.shape)
    assert float(norm(uniform, model)) == pytest.approx(3.0 * np.sqrt(8.0))


def test_velocity_port_prescribes_its_field_on_its_nodes_only():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=3, n_layers=0)
    ports = {"inlet": FlowPort(Constant(2.0)), "outlet": VelocityPort(SOLUTION)}
    model = build_model(mesh, ports)
    u = prescribed_velocity(jnp.asarray(0.1), model)
    outlet = np.unique(mesh.labelled("outlet"))
    np.testing.assert_array_equal(u[:, outlet], SOLUTION(0.1, model.x)[:, outlet])
    inlet = model.port_faces[0]
    assert float(flux(u, model.x, inlet)) == pytest.approx(-2.0)
    assert np.all(np.asarray(model.prescribed)[outlet])
    others = np.setdiff1d(np.arange(model.n_nodes), np.concatenate([outlet, np.unique(inlet)]))
    np.testing.assert_array_equal(u[:, others], 0.0)


def test_womersley_has_the_limits_of_poiseuille_and_of_no_friction():
    radius, rho, mu = 0.5, 1.06, 0.04
    slow = impedance_per_length(radius, 1e-4, rho, mu)
    assert slow.real == pytest.approx(8.0 * mu / (np.pi * radius**4), rel=1e-6)
    # L = (4/3) ρ/(πR²) in slow flow (Womersley 1955).
    assert slow.imag / 1e-4 == pytest.approx(4.0 / 3.0 * rho / (np.pi * radius**2), rel=1e-4)
    # F → 2/(α √i) in fast flow; the next term is 1/α.
    assert friction_factor(300.0) == pytest.approx(2.0 / (300.0 * np.sqrt(1j)), rel=5e-3)
    r = np.linspace(0.0, radius, 2001)
    mean = 2.0 * np.trapezoid(velocity_shape(r, radius, 6.0) * r, r) / radius**2
    assert abs(mean - (1.0 - friction_factor(6.0))) < 1e-6


def test_wave_speed_tends_to_moens_and_korteweg():
    E, radius, rho = 3e6, 0.5, 1.06
    thin = wave_number(1.0, radius=radius, thickness=1e-4, E=E, rho_s=1.1, rho_f=rho, mu=1e-9)
    # Corrections: thickness over radius, and friction 2/α at α = 1.6e4.
    assert 1.0 / thin.real == pytest.approx(np.sqrt(E * 1e-4 / (2.0 * rho * radius)), rel=5e-4)
    a, b = 0.5, 0.6
    # Lamé at ν = 0: u(a) = p a/E (a² + b²)/(b² − a²).
    assert static_compliance(a, b - a, E) == pytest.approx(a / E * 0.61 / 0.11)


def test_wave_number_is_recovered_from_two_waves():
    k = 0.33 - 0.026j
    z = np.linspace(0.0, 10.0, 41)
    p = (3.0 + 1.0j) * np.exp(-1j * k * z) + (0.4 - 2.0j) * np.exp(1j * k * z)
    assert measured_wave_number(p, 0.25, margin=5, reach=8) == pytest.approx(k, rel=1e-10)
    assert ElasticTube().exact_wave_number.imag < 0.0


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_developed_flow_is_measured_without_error_but_that_of_the_mesh(turn):
    wave, steady = RigidTube(amplitude=2.0), RigidTube(mean=0.05)
    mesh = round_tube(radius=0.5, length=2.0, n_around=24, n_axial=6, n_rings=8)

    def section(t, problem):
        model = rigid_tube_model(mesh, problem)
        return middle_section(developed_state(t, 0.01, model, problem), model, problem)

    errors = poiseuille_errors(section(turn, steady), steady)
    # The velocity is exact at the nodes but on the rim; a flow of chords is short by h²/R².
    assert errors.profile < 1e-2
    assert errors.resistance < 4e-2
    errors = womersley_errors(section(0.0, wave), section(0.75, wave), wave)
    assert errors.profile < 1e-2
    assert errors.resistance < 4e-2


def test_driven_and_periodic_windkessel_agree_after_many_cycles():
    block, n = SHORT_TUBE.block, 400
    t = np.arange(1, 8 * n + 1) / n
    Q = 3.0 + 2.0 * np.cos(2.0 * np.pi * t) - np.sin(6.0 * np.pi * t)
    exact = periodic_pressure(Q[-n:], 1.0, block)
    # Flow linear in each step: (ωΔt)²/12 of the third harmonic.
    assert history_error(driven_pressure(Q, 1.0 / n, block)[-n:], exact) < 2e-4
    # Held over each step it is half a step late: ωΔt/2.
    late = history_error(driven_pressure(Q, 1.0 / n, block, held=True)[-n:], exact)
    assert 2e-3 < late < 2e-2
    # |Z| at the fundamental for a single harmonic (Rp 121, C 1.5e-5, Rd 1212).
    one = periodic_pressure(np.cos(2.0 * np.pi * np.arange(n) / n), 1.0, block)
    Z = abs(121.0 + 1212.0 / (1.0 + 2j * np.pi * 1212.0 * 1.5e-5))
    assert range_error(one, Z * np.cos(np.linspace(0.0, 2.0 * np.pi, 10_001))) < 1e-4


def test_comparisons_of_derivatives_find_a_wrong_one():
    def cubic(p):
        return p.R * p.C**2

    at = Pair(2.0, 3.0)
    right = compare_each(cubic, Pair(9.0, 12.0), at)
    assert max(c.error for c in right) < 1e-6
    assert compare_each(cubic, Pair(9.0, 12.1), at)[1].error == pytest.approx(0.1 / 12.0, rel=1e-3)
    assert compare_along(cubic, Pair(9.0, 12.0), at, np.array([1.0, 0.5])).error < 1e-5
    np.testing.assert_allclose(steps_of(Pair(0.0, -3.0)), [1e-4, 3e-3])


def test_figures_pass_within_their_target_only():
    assert figure("p", "q", 1.009, 1.0, 0.01).passed
    assert not figure("p", "q", 1.011, 1.0, 0.01).passed
    assert not figure("p", "q", float("nan"), 1.0, 0.01).passed
    assert in_band("p", "q", 1.551, 1.55, 1.59).passed
    assert not in_band("p", "q", 1.591, 1.55, 1.59).passed
    order = observed_orders(np.array([0.1, 0.05]), np.array([4e-3, 1e-3]))[0]
    assert order == pytest.approx(2.0)
    assert order_figure("p", "q", 2.3, 1.9, 2.0).error == 0.0
    assert not order_figure("p", "q", 1.85, 1.9, 2.0).passed
