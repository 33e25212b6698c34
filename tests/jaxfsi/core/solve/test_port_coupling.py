"""Resistance of ports in the preconditioner: inverses against dense matrices, iterations."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.assembly import host_geometry
from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve.nested_factor import nested_solve
from jaxfsi.core.solve.port_coupling import (
    resisted_pressure,
    resisted_velocity,
    resisted_velocity_transposed,
    with_resistance,
)
from jaxfsi.core.solve.preconditioner import SMOOTH, preconditioner
from jaxfsi.core.solve.step_blocks import step_blocks
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.meshing import tube
from jaxfsi.verification.coupled_tube import coupled_mesh, coupled_model
from lumped.blocks import Resistance
from lumped.waveforms import Constant, Ramp

DT = 1e-3
METHOD = generalized_alpha(0.5)
Z = jnp.array([3e3, 0.0, 2e4])
BLOCK = BlockPort(Resistance(2e3))
OPEN = PressurePort(Constant(0.0))


@pytest.fixture(scope="module")
def model():
    """A short tube with a resistance at either end, and a pressure on its wall."""
    mesh = coupled_mesh(n_around=10, n_axial=6)
    ports = {"inlet": BLOCK, "outer_wall": OPEN, "outlet": BLOCK}
    return build_model(mesh, ports, wall=coupled_model(mesh).wall)


@pytest.fixture(scope="module")
def factors(model):
    return preconditioner(DT, model, METHOD, dtype=np.float64)


@pytest.fixture(scope="module")
def ports(factors):
    return with_resistance(factors.ports, Z, factors.inverse_diagonal)


@pytest.fixture(scope="module")
def area(model):
    """Flow of the two openings by the velocity of the blood's own nodes."""
    own = model.in_fluid & ~model.in_solid & ~model.prescribed
    slopes = [
        jax.grad(lambda u, f=model.port_faces[i]: flux(u, model.x, f))(jnp.zeros_like(model.x))
        for i in (0, 2)
    ]
    return jnp.where(own, jnp.stack(slopes), 0.0)


@pytest.fixture(scope="module")
def pressure_columns(model, area):
    """g of each opening, and aᵀ y a, from the matrices of the step."""
    shape = host_geometry(np.asarray(model.x).T, np.asarray(model.fluid_tets).T)
    blocks = step_blocks(DT, model, METHOD, shape)
    y = 1.0 / (blocks.diagonal + SMOOTH * blocks.lumped_mass[:, None])
    a = np.moveaxis(np.asarray(area), 1, 2)
    weak = [(blocks.G[i].T - blocks.D[i]) @ (y * v)[:, i] for v in a for i in range(3)]
    g = 0.5 * np.sum(np.reshape(weak, (2, 3, -1)), axis=1)[:, np.asarray(model.in_fluid)]
    return g, np.einsum("kni,ni,lni->kl", a, y, a)


@pytest.fixture(scope="module")
def S(factors):
    """The Schur complement without resistance, from its factor."""
    eye = jnp.eye(len(factors.pressure_nodes))
    return np.linalg.inv(jax.vmap(lambda e: nested_solve(factors.pressure, e))(eye))


def test_vectors_are_those_of_the_step(ports, area, pressure_columns, S):
    g, flow = pressure_columns
    assert ports.port == (0, 2)
    np.testing.assert_array_equal(ports.nodes, np.flatnonzero(np.any(area, axis=(0, 1))))
    np.testing.assert_allclose(ports.area, area[:, :, ports.nodes], rtol=1e-12)
    np.testing.assert_allclose(ports.pressure @ S, g, atol=1e-9 * np.abs(g).max())
    expected = flow - g @ np.linalg.solve(S, g.T)
    np.testing.assert_allclose(ports.conductance, expected, atol=1e-9 * np.abs(flow).max())


def test_velocity_is_that_of_the_resisted_block(factors, ports, area):
    inverse = factors.inverse_diagonal
    r = jnp.where(inverse > 0.0, jax.random.normal(jax.random.key(0), inverse.shape), 0.0)
    u = resisted_velocity(ports, inverse, inverse * r)
    flow = jnp.sum(area * u, (1, 2))
    resisted = jnp.einsum("k,kin->in", Z[np.array([0, 2])] * flow, area)
    diagonal = 1.0 / jnp.where(inverse > 0.0, inverse, 1.0)
    np.testing.assert_allclose(diagonal * u + resisted, r, atol=1e-10 * np.abs(r).max())


def test_velocity_has_its_transpose(factors, ports):
    v, w = jax.random.normal(jax.random.key(1), (2, *factors.inverse_diagonal.shape))
    forward = jnp.vdot(w, resisted_velocity(ports, factors.inverse_diagonal, v))
    backward = jnp.vdot(resisted_velocity_transposed(ports, factors.inverse_diagonal, w), v)
    assert float(forward) == pytest.approx(float(backward), rel=1e-12)


def test_pressure_is_that_of_the_resisted_complement(ports, pressure_columns, S):
    g, flow = pressure_columns
    resisted = S - g.T @ np.linalg.solve(np.diag(1.0 / Z[np.array([0, 2])]) + flow, g)
    r = np.asarray(jax.random.normal(jax.random.key(2), (len(S),)))
    p = resisted_pressure(ports, jnp.asarray(np.linalg.solve(S, r)), jnp.asarray(r))
    np.testing.assert_allclose(resisted @ p, r, atol=1e-9 * np.abs(r).max())


@pytest.mark.parametrize("resistance", [0.0, -1e3])
def test_ports_without_resistance_change_nothing(factors, resistance):
    none = with_resistance(factors.ports, jnp.full(3, resistance), factors.inverse_diagonal)
    v = jax.random.normal(jax.random.key(3), factors.inverse_diagonal.shape)
    np.testing.assert_array_equal(resisted_velocity(none, factors.inverse_diagonal, v), v)
    p = jax.random.normal(jax.random.key(4), factors.pressure_nodes.shape)
    np.testing.assert_array_equal(resisted_pressure(none, p, p), p)


def test_one_resistance_beside_none(factors):
    one = with_resistance(factors.ports, jnp.array([0.0, 0.0, 1e4]), factors.inverse_diagonal)
    for matrix in (one.of_velocity, one.of_pressure):
        np.testing.assert_array_equal(matrix[0], 0.0)
        np.testing.assert_allclose(matrix[:, 0], 0.0, atol=1e-9 * float(matrix[1, 1]))
    conductance = float(factors.ports.conductance[1, 1])
    assert float(one.of_pressure[1, 1]) == pytest.approx(1.0 / (1e-4 + conductance), rel=1e-12)


def test_only_ports_whose_pressure_follows_the_flow_take_part(model):
    given = dataclasses.replace(model, ports=(OPEN, OPEN, OPEN))
    assert preconditioner(DT, given, METHOD).ports is None
    mixed = dataclasses.replace(model, ports=(OPEN, BLOCK, BLOCK))
    found = preconditioner(DT, mixed, METHOD).ports
    assert found is not None
    assert found.port == (1, 2)
    assert not np.any(found.area[0])  # its nodes are the wall's


def _iterations(model):
    report = march(model, initial_state(model), prepare(DT, model), 12).history.report
    return np.max(np.asarray(report.n_gmres) / np.asarray(report.n_newton))


def test_a_resistance_takes_no_more_iterations_than_an_open_end():
    mesh = coupled_mesh(n_around=16, n_axial=32)
    push = PressurePort(Ramp(0.0, 1e6))

    def iterations(outlet):
        ports = {"inlet": push, "outlet": outlet}
        return _iterations(build_model(mesh, ports, wall=coupled_model(mesh).wall))

    most = iterations(OPEN)
    for R in (1e2, 1e4, 1e6):
        assert iterations(BlockPort(Resistance(R))) <= most, R


def test_iterations_of_a_rigid_vessel_do_not_depend_on_the_resistance_of_its_ends():
    """A uniform pressure drives no flow there: the conductance is singular."""
    mesh = tube(radius=0.5, length=4.0, thickness=0.1, n_around=12, n_axial=16, n_layers=0)

    def iterations(R):
        inlet, outlet = Resistance(R, 1e4), Resistance(R)
        return _iterations(
            build_model(mesh, {"inlet": BlockPort(inlet), "outlet": BlockPort(outlet)})
        )

    most = iterations(1.0)
    for R in (1e2, 1e4, 1e6):
        assert iterations(R) <= most + 1.0, R
