"""Relaxation of the blood's velocity against dense matrices, and in the system of a step."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve.krylov import euclidean_norm, fgmres
from jaxfsi.core.solve.linear_system import linearised
from jaxfsi.core.solve.preconditioner import precondition
from jaxfsi.core.solve.relaxation import CROSSED, relaxation, relaxed, renewed, transposed
from jaxfsi.core.step.equations import Unknowns, begin_step
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.meshing import tube
from lumped.waveforms import Constant

MOVING = jnp.asarray(2.0 * CROSSED)


@pytest.fixture(scope="module")
def operator():
    """A relaxation with random entries, D⁻¹ of its nodes, and D + N as a dense matrix of them."""
    tets = np.asarray(
        tube(radius=0.5, thickness=0.1, length=0.5, n_layers=0, n_around=6, n_axial=2).tets
    )
    n = int(tets.max()) + 1
    rng = np.random.default_rng(0)
    own = rng.uniform(size=n) < 0.7
    A = tuple(jnp.asarray(row) for row in rng.standard_normal((16, len(tets))))
    N = np.zeros((n, n))
    for a in range(4):
        for b in range(4):
            if a != b:
                np.add.at(N, (tets[:, a], tets[:, b]), np.asarray(A[4 * a + b]))
    N = N[own][:, own]
    D = 1.5 * np.maximum(np.sum(np.abs(N), axis=1), np.sum(np.abs(N), axis=0)) + 1.0
    inverse = np.zeros((3, n))
    inverse[:, own] = 1.0 / D
    known = relaxation(tets, own, dtype=np.float64)
    return known, A, jnp.asarray(inverse), N + np.diag(D), np.flatnonzero(own)


def test_many_sweeps_solve_the_operator_on_the_nodes_of_blood(operator):
    known, A, inverse, dense, own = operator
    r = np.random.default_rng(1).standard_normal(inverse.shape)
    v = np.asarray(relaxed(renewed(known, A, MOVING), inverse, jnp.asarray(r), sweeps=200))
    assert v[:, own] == pytest.approx(np.linalg.solve(dense, r[:, own].T).T, rel=1e-9, abs=1e-12)
    others = np.setdiff1d(np.arange(v.shape[1]), own)
    assert not v[:, others].any()


def test_transposed_relaxation_is_the_transpose(operator):
    known, A, inverse, _, _ = operator
    known = renewed(known, A, MOVING)
    assert bool(known.crosses)
    v, w = np.random.default_rng(2).standard_normal((2, *inverse.shape))
    forward = np.vdot(w, relaxed(known, inverse, jnp.asarray(v)))
    backward = np.vdot(relaxed(transposed(known), inverse, jnp.asarray(w)), v)
    assert forward == pytest.approx(backward, rel=1e-12)


def test_blood_that_crosses_no_element_has_the_diagonal_alone(operator):
    known, A, inverse, _, _ = operator
    r = jnp.asarray(np.random.default_rng(3).standard_normal(inverse.shape))
    still = renewed(known, A, jnp.asarray(CROSSED))
    assert jnp.array_equal(relaxed(still, inverse, r), inverse * r)
    assert jnp.array_equal(relaxed(known, inverse, r), inverse * r)


@pytest.mark.parametrize(("speed", "saves"), [(0.0, False), (300.0, True)])
def test_sweeps_save_iterations_where_flow_crosses_elements(speed, saves):
    """The system of a step of a rigid tube, with and without sweeps; 300 cm/s cross six elements.

    At most nine tenths of the iterations: a third of the worth that a patient's slit shows.
    """
    mesh = tube(radius=0.5, thickness=0.1, length=2.0, n_layers=0, n_around=12, n_axial=20)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    model = build_model(mesh, ports)
    stepper = prepare(2e-3, model)
    profile = 1.0 - (model.x[0] ** 2 + model.x[1] ** 2) / 0.25
    u = jnp.zeros_like(model.x).at[2].set(speed * jnp.maximum(profile, 0.0))
    state = initial_state(model)._replace(u=jnp.where(model.prescribed, 0.0, u))
    state = state._replace(u_before=state.u)
    step = begin_step(jnp.asarray(2e-3), model, state, stepper.method, stepper.motion)
    b = jnp.asarray(np.random.default_rng(0).standard_normal(4 * model.n_nodes), jnp.float32)
    fixed = jnp.concatenate([jnp.tile(model.prescribed, 3), ~model.in_fluid])
    M = stepper.preconditioner
    weight = jnp.concatenate([M.velocity_scale.reshape(-1), M.pressure_scale]).astype(jnp.float32)

    @jax.jit
    def iterations(sweeps: jax.Array) -> tuple[jax.Array, jax.Array]:
        product, _, M = linearised(Unknowns(state.u, state.p), model, step, stepper)
        crosses = M.relaxation.crosses
        M = eqx.tree_at(lambda m: m.relaxation.crosses, M, crosses & sweeps)

        def inverse(r: jax.Array) -> jax.Array:
            r = r / weight
            z = precondition(M, r[: 3 * model.n_nodes].reshape(3, -1), r[3 * model.n_nodes :])
            return jnp.where(fixed, r, ravel_pytree(z)[0])

        right = jnp.where(fixed, 0.0, b)
        found = fgmres(
            lambda v: weight * product(v), right, inverse,
            tolerance=1e-3 * euclidean_norm(right), max_iterations=60,
        )  # fmt: skip
        return found.n_iterations, crosses

    without, crosses = iterations(jnp.asarray(False))
    assert bool(crosses) == saves
    with_sweeps = int(iterations(jnp.asarray(True))[0])
    assert int(without) < 60
    assert with_sweeps <= 0.9 * int(without) if saves else with_sweeps == int(without)
