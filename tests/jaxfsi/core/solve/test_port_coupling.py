"""Resistance of ports in the preconditioner: inverses against dense matrices, iterations."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve.nested_factor import nested_solve
from jaxfsi.core.solve.port_coupling import (
    closed_pressure,
    closed_velocity,
    closed_velocity_transposed,
    with_resistance,
)
from jaxfsi.core.solve.preconditioner import preconditioner
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.verification.coupled_tube import coupled_mesh, coupled_model
from lumped.blocks import Resistance
from lumped.waveforms import Constant, Ramp

DT = 1e-3
Z = jnp.array([3e3, 0.0, 2e4])


@pytest.fixture(scope="module")
def model():
    """A short tube with a resistance at either end, and a pressure on its wall."""
    mesh = coupled_mesh(n_around=10, n_axial=6)
    known = coupled_model(mesh)
    block = BlockPort(Resistance(2e3))
    ports = {"inlet": block, "outer_wall": PressurePort(Constant(0.0)), "outlet": block}
    return build_model(mesh, ports, wall=known.wall)


@pytest.fixture(scope="module")
def factors(model):
    return preconditioner(DT, model, generalized_alpha(0.5), dtype=np.float64)


@pytest.fixture(scope="module")
def ports(factors):
    return with_resistance(factors.ports, Z, factors.inverse_diagonal)


def _area(model, ports):
    """Derivative of the flow of each port by the velocity of the blood's own nodes there."""
    known = np.zeros(model.n_nodes, bool)
    known[np.asarray(ports.nodes)] = True
    slopes = [
        jax.grad(lambda u, f=model.port_faces[i]: flux(u, model.x, f))(jnp.zeros_like(model.x))
        for i in ports.port
    ]
    return jnp.where(known, jnp.stack(slopes), 0.0)


def test_velocity_is_that_of_the_resisted_block(model, factors, ports):
    a, D = _area(model, ports), factors.inverse_diagonal
    r = jnp.where(D > 0.0, jax.random.normal(jax.random.key(0), model.x.shape), 0.0)
    z = closed_velocity(ports, D, D * r)
    resisted = jnp.einsum("k,kin->in", Z[np.array(ports.port)] * jnp.sum(a * z, (1, 2)), a)
    inverse = jnp.where(D > 0.0, D, 1.0)
    np.testing.assert_allclose(z / inverse + resisted, r, atol=1e-10 * np.abs(r).max())


def test_velocity_has_its_transpose(factors, ports):
    keys = jax.random.split(jax.random.key(1))
    v, w = (jax.random.normal(key, factors.inverse_diagonal.shape) for key in keys)
    forward = jnp.vdot(w, closed_velocity(ports, factors.inverse_diagonal, v))
    backward = jnp.vdot(closed_velocity_transposed(ports, factors.inverse_diagonal, w), v)
    assert float(forward) == pytest.approx(float(backward), rel=1e-12)


def test_pressure_is_that_of_the_resisted_complement(factors, ports):
    """S from its factor column by column; g is S s."""
    n = len(factors.pressure_nodes)
    S = np.linalg.inv(jax.vmap(lambda e: nested_solve(factors.pressure, e))(jnp.eye(n)))
    g = np.asarray(ports.pressure) @ S
    resistance = np.diag(1.0 / np.maximum(np.asarray(Z)[np.array(ports.port)], 1e-30))
    flow = np.asarray(ports.compliance) + g @ np.asarray(ports.pressure).T
    resisted = S - g.T @ np.linalg.solve(resistance + flow, g)
    r = np.asarray(jax.random.normal(jax.random.key(2), (n,)))
    z = closed_pressure(ports, nested_solve(factors.pressure, jnp.asarray(r)), jnp.asarray(r))
    np.testing.assert_allclose(resisted @ z, r, atol=1e-9 * np.abs(r).max())


def test_ports_without_resistance_change_nothing(model, factors):
    open_ = with_resistance(factors.ports, jnp.zeros(3), factors.inverse_diagonal)
    v = jax.random.normal(jax.random.key(3), model.x.shape)
    np.testing.assert_array_equal(closed_velocity(open_, factors.inverse_diagonal, v), v)
    p = jax.random.normal(jax.random.key(4), factors.pressure_nodes.shape)
    np.testing.assert_array_equal(closed_pressure(open_, p, p), p)


def test_only_ports_whose_pressure_follows_the_flow_take_part(model, factors):
    assert factors.ports.port == (0, 2)
    given = dict.fromkeys(model.names, PressurePort(Constant(0.0)))
    alone = dataclasses.replace(model, ports=tuple(given.values()))
    assert preconditioner(DT, alone, generalized_alpha(0.5)).ports is None


def test_a_resistance_takes_no_more_iterations_than_an_open_end():
    mesh = coupled_mesh(n_around=16, n_axial=32)
    wall = coupled_model(mesh).wall
    push = PressurePort(Ramp(0.0, 1e6))

    def iterations(outlet):
        model = build_model(mesh, {"inlet": push, "outlet": outlet}, wall=wall)
        end = march(model, initial_state(model), prepare(DT, model), 12)
        return np.asarray(end.history.report.n_gmres) / np.asarray(end.history.report.n_newton)

    most = np.max(iterations(PressurePort(Constant(0.0))))
    for R in (1e2, 1e4, 1e6):
        assert np.max(iterations(BlockPort(Resistance(R)))) <= most, R
