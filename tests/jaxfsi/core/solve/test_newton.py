"""A step begins where the last one points; where it begins does not move its solution."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from jaxfsi import core
from jaxfsi.core.step.state import Start, initial_state
from jaxfsi.core.step.step import advance_step
from jaxfsi.core.step.stepper import prepare
from jaxfsi.meshing import tube
from lumped import Constant

stepped = eqx.filter_jit(advance_step)
PORTS = {
    "inlet": core.PressurePort(Constant(2e3)),
    "outlet": core.PressurePort(Constant(0.0)),
}


@pytest.fixture(scope="module")
def flow():
    """Blood that a constant pressure drives faster and faster through an elastic tube."""
    mesh = tube(radius=0.2, length=1.0, thickness=0.04, n_around=8, n_axial=6, n_layers=1)
    model = core.build_model(mesh, PORTS, wall=core.Wall(core.LinearElastic(3e6, 0.3)))
    stepper = prepare(1e-3, model, tolerance=1e-4)
    state = initial_state(model)
    for _ in range(20):
        state, _ = stepped(model, state, stepper)
    return model, stepper, state


def _elsewhere(state):
    start = jax.tree.map(jnp.zeros_like, state.start)
    return state._replace(start=start)


def _apart(a, b):
    return float(jnp.linalg.norm(a - b) / jnp.linalg.norm(b))


def test_start_saves_iterations_and_not_accuracy(flow):
    model, stepper, state = flow
    along, report = stepped(model, state, stepper)
    plain, before = stepped(model, _elsewhere(state), stepper)
    assert int(report.n_gmres) < int(before.n_gmres)
    tight = prepare(1e-3, model, tolerance=1e-8)
    exact, _ = stepped(model, state, tight)
    change = _apart(exact.u, state.u)
    assert _apart(along.u, exact.u) <= 2.0 * max(_apart(plain.u, exact.u), 1e-5 * change)
    assert _apart(along.u, exact.u) < 1e-4


@pytest.mark.parametrize("remainder", [0.0, 0.05, 10.0])
def test_wrong_start_is_not_believed(flow, remainder):
    model, stepper, state = flow
    exact, _ = stepped(model, state, stepper)
    u, p = state.start.u, state.start.p
    wrong = Start(-50.0 * u, 3.0 * jnp.flip(p), jnp.full_like(state.start.remainder, remainder))
    found, report = stepped(model, state._replace(start=wrong), stepper)
    assert not bool(core.RESULTS[report.result])
    assert _apart(found.u, exact.u) < 1e-4
    assert _apart(found.p, exact.p) < 1e-4


def test_solution_has_no_derivative_by_its_start():
    """In a rigid tube: the start enters before the wall does, and its programs are smaller."""
    mesh = tube(radius=0.2, length=1.0, thickness=0.04, n_around=8, n_axial=6, n_layers=0)
    model = core.build_model(mesh, PORTS)
    stepper = prepare(1e-3, model, tolerance=1e-4)
    state = initial_state(model)
    state = state._replace(start=jax.tree.map(lambda a: 1e-3 + a, state.start))
    tangent = jax.tree.map(jnp.zeros_like, state)._replace(
        start=jax.tree.map(jnp.ones_like, state.start)
    )

    @eqx.filter_jit
    def slope(model, stepper, state, tangent):
        return jax.jvp(lambda s: advance_step(model, s, stepper)[0], (state,), (tangent,))[1]

    change = slope(model, stepper, state, tangent)
    for name in ("u", "p", "a", "d"):
        assert not jnp.any(getattr(change, name)), name
