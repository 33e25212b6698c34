"""Every block of the registry through all its views; a new block takes one line there."""

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    Coronary,
    ExtendedCoronary,
    Fourier,
    Sinusoid,
    Vessel,
    advance,
    algebraic,
    block_field,
    direct_current,
    driven,
    implicit_step,
    transfer_impedance,
)
from lumped.verification import BLOCKS, IMPEDANCES, PERIOD, VESSELS, impedance

FLOW = Sinusoid(mean=1.2, amplitude=0.9, period=PERIOD, phase=0.3)
OMEGA = np.array([0.5, 7.85, 60.0, 900.0])
every_block = pytest.mark.parametrize("block", BLOCKS.values(), ids=BLOCKS)
dynamic_block = pytest.mark.parametrize(
    "block",
    [block for block in BLOCKS.values() if block.state_names],
    ids=[name for name, block in BLOCKS.items() if block.state_names],
)


@pytest.fixture(scope="module")
def exact():
    """Periodic states of each block under FLOW: both sources are one harmonic, so all is exact."""

    @eqx.filter_jit
    def solve(block):
        return Fourier(64)(driven(block, FLOW), PERIOD)

    return solve


def back_pressure(block) -> float:
    """Pressure at the port without flow [dyn/cm²]."""
    if not isinstance(block, Coronary | ExtendedCoronary):
        return float(block.P_ref)
    if isinstance(block, Coronary):
        return float(block.P_venous)
    g, G = 1.0 / (block.R_2 + block.R_3) + block.G_bypass, block.G_collateral
    return float((g * block.P_venous + G * block.P_source(0.0)) / (g + G))


def test_registry_covers_every_block():
    assert {type(block) for block in BLOCKS.values()} == set(IMPEDANCES)
    assert all(element.n_ports == 2 for element in VESSELS.values())


@every_block
def test_transfer_impedance_matches_series_and_parallel_rules(block):
    Z = transfer_impedance(block, jnp.asarray(OMEGA))
    np.testing.assert_allclose(Z, impedance(block, 1j * OMEGA), rtol=1e-13)


@every_block
def test_direct_current_is_the_impedance_at_zero_frequency(block):
    R, P_0 = direct_current(0.1, block)
    assert float(R) == pytest.approx(float(impedance(block, 0.0)), rel=1e-13)
    assert float(P_0) == pytest.approx(back_pressure(block), rel=1e-12)


@every_block
def test_port_pressure_under_sinusoidal_flow_is_the_impedance(block, exact):
    solution = exact(block)
    omega = 2 * np.pi / PERIOD
    Z = complex(impedance(block, 1j * omega))
    phasor = 0.9 * np.exp(1j * (omega * np.asarray(solution.t) + 0.3)) * Z
    R, P_0 = direct_current(0.0, block)
    P = np.asarray(solution.pressure("port")) - phasor.real - float(P_0 + 1.2 * R)
    if isinstance(block, Coronary | ExtendedCoronary):
        # what is left is the answer to P_im, verified in test_periodic_linear.py
        P = P - np.mean(P)
        assert np.max(np.abs(P)) > 1e3
    else:
        assert np.max(np.abs(P)) < 1e-11 * np.max(np.abs(solution.pressure("port")))


@dynamic_block
def test_vector_field_in_diffrax_returns_to_the_periodic_state(block, exact):
    solution = exact(block)
    n = len(block.state_names)
    network = driven(block, FLOW)

    @jax.jit
    def cycle(x):
        saved = dfx.diffeqsolve(
            dfx.ODETerm(block_field(block, FLOW)),
            dfx.Dopri8(),
            t0=0.0,
            t1=PERIOD,
            dt0=None,
            y0=x,
            saveat=dfx.SaveAt(ts=jnp.append(solution.t, PERIOD)),
            stepsize_controller=dfx.PIDController(rtol=1e-12, atol=1e-10),
        ).ys
        return jax.vmap(lambda t, x: jnp.append(x, algebraic(t, network, x)))(
            solution.t, saved[:-1]
        )

    z = cycle(solution.z[0, :n])
    size = np.max(np.abs(solution.z), axis=0)
    # the integrator's dense output between its steps
    assert np.max(np.abs(z - solution.z) / size) < 5e-9


@dynamic_block
@pytest.mark.parametrize("order", [1, 2])
def test_implicit_step_converges_to_the_periodic_state(block, order, exact):
    solution = exact(block)
    n = len(block.state_names)

    @jax.jit
    def cycle(x, steps):
        dt = PERIOD / steps

        def body(k, carry):
            x, _ = carry
            t = k * dt
            return advance(t, dt, x, block, FLOW(t), FLOW(t + dt), order=order)

        start = advance(0.0, dt, x, block, FLOW(0.0), FLOW(dt), order=order)
        return jax.lax.fori_loop(0.0, steps, body, type(start)(x, start.P))

    size = np.max(np.abs(solution.z), axis=0)
    errors = []
    for steps in (256.0, 512.0, 1024.0):
        end = cycle(solution.z[0, :n], steps)
        gap = np.append(end.x - solution.z[0, :n], end.P - solution.pressure("port")[0])
        errors.append(np.max(np.abs(gap / size[: n + 1])))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - order) < 0.15), (errors, rates)
    assert errors[-1] < (1e-2 if order == 1 else 1e-5)


@every_block
def test_implicit_step_is_exactly_Z_Q_plus_b(block):
    t, dt = 0.13, 2e-3
    x = jnp.linspace(9e4, 7e4, len(block.state_names))

    @jax.jit
    def gaps(Q_new):
        results = []
        for order in (1, 2):
            Z, b = implicit_step(t, dt, x, block, 1.1, 5.0, order=order)
            P = advance(t, dt, x, block, 1.1, Q_new, order=order).P
            results.append((Z, (Z * Q_new + b) / P - 1.0))
        return results

    (Z_euler, gap_euler), (Z_radau, gap_radau) = gaps(-0.7)
    # linear: what is left is rounding, about 1e-16 · R Q/P
    assert abs(float(gap_euler)) < 1e-12
    assert abs(float(gap_radau)) < 1e-12
    assert float(Z_euler) == pytest.approx(float(impedance(block, 1.0 / dt)), rel=1e-12)
    assert float(Z_radau) > 0.0


def test_backward_euler_impedance_of_the_five_element_block_is_the_published_formula():
    b, dt = BLOCKS["coronary"], 1e-3
    Z, _ = implicit_step(0.0, dt, jnp.array([8e4, 1e4]), b, 1.0, 1.0, order=1)
    formula = b.R_1 + 1 / (b.C_a / dt + 1 / (b.R_2 + 1 / (b.C_im / dt + 1 / b.R_3)))
    assert float(Z) == pytest.approx(float(formula), rel=1e-12)


def views(block):
    """One number from all views."""
    x = jnp.linspace(9e4, 7e4, len(block.state_names))
    Z_1, b_1 = implicit_step(0.1, 2e-3, x, block, 1.1, 1.3, order=1)
    Z_2, b_2 = implicit_step(0.1, 2e-3, x, block, 1.1, 1.3, order=2)
    Z = transfer_impedance(block, jnp.array([8.0, 90.0]))
    R, P_0 = direct_current(0.0, block)
    return (Z_1 + Z_2 + R + jnp.sum(jnp.abs(Z))) / 1e4 + (b_1 + b_2 + P_0) / 1e5


compiled_views = jax.jit(views)


@every_block
def test_views_have_exact_gradients_in_every_parameter(block, assert_gradient):
    assert_gradient(compiled_views, block)


@every_block
def test_views_of_a_batch_equal_a_loop(block):
    batch = jax.tree.map(lambda leaf: leaf * jnp.array([1.0, 1.1]), block)
    second = jax.tree.map(lambda leaf: leaf * 1.1, block)
    both = jax.jit(jax.vmap(views))(batch)
    np.testing.assert_allclose(both, [compiled_views(block), compiled_views(second)], rtol=1e-13)


@pytest.mark.parametrize("name", ["resistance", "coronary"])
def test_views_are_the_same_without_jit(name):
    np.testing.assert_allclose(compiled_views(BLOCKS[name]), views(BLOCKS[name]), rtol=1e-13)


def test_nonlinear_element_has_no_impedance():
    vessel = Vessel(R_viscous=1.0, K_stenosis=1.0)
    with pytest.raises(ValueError, match="no transfer impedance"):
        transfer_impedance(vessel, jnp.array([1.0]))
    with pytest.raises(ValueError, match="no resistance"):
        direct_current(0.0, vessel)
    with pytest.raises(ValueError, match="port"):
        driven(VESSELS["R"], FLOW)
    with pytest.raises(ValueError, match="order 1 or 2"):
        advance(0.0, 0.1, jnp.zeros(0), BLOCKS["resistance"], 1.0, 1.0, order=3)
