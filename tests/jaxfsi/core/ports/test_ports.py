"""Every port of the registry through everything that a port must do; a new one takes one line."""

import dataclasses
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core import (
    AbstractVelocity,
    BlockPort,
    FlowPort,
    PlugPort,
    PressurePort,
    RampedPort,
    ResistanceInertancePort,
    VelocityPort,
    build_model,
    generalized_alpha,
    initial_state,
    prepare,
)
from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.port import PortMotion
from jaxfsi.core.step.equations import begin_step, extrapolated
from jaxfsi.core.step.step import RESULTS, advance_step
from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import tube
from jaxfsi.verification.volume_balance import balance, wet_wall
from lumped import RCR, Ramp, Sinusoid
from lumped.parameters import Parameter, parameter

RADIUS, DT, N_STEPS = 0.5, 1e-3, 4
METHOD = generalized_alpha(0.5)


class Paraboloid(AbstractVelocity):
    """A steady profile along the tube, with its peak on the axis."""

    peak: Parameter = parameter()

    def __call__(self, t, x):
        share = jnp.maximum(1.0 - (x[0] ** 2 + x[1] ** 2) / RADIUS**2, 0.0)
        return jnp.stack([jnp.zeros_like(share), jnp.zeros_like(share), self.peak * share])


_BLOCK = BlockPort(RCR(R_proximal=200.0, C=1e-5, R_distal=2e3, P_ref=100.0))

PORTS = {
    "pressure": PressurePort(Sinusoid(500.0, 300.0, 0.01)),
    "flow": FlowPort(Sinusoid(2.0, 1.0, 0.01)),
    "plug": PlugPort(Sinusoid(3.0, 2.0, 0.01)),
    "velocity": VelocityPort(Paraboloid(5.0)),
    "block": _BLOCK,
    "resistance and inertance": ResistanceInertancePort(R=200.0, L=5.0, P_ref=100.0),
    "ramped": RampedPort(_BLOCK, Ramp(500.0, 3e4), jnp.asarray(True)),
    "ramped, off": RampedPort(_BLOCK, Ramp(500.0, 3e4), jnp.asarray(False)),
}

NONLINEAR: frozenset[str] = frozenset()
"""Those of `PORTS` whose P_offset and Z depend on the flow at which they are linearised."""


class Case:
    """A rigid tube with the port at its inlet and a pulsating pressure at its outlet."""

    def __init__(self, port, *, linear=True):
        self.linear = linear
        self.mesh = tube(
            radius=RADIUS, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=0
        )
        outlet = PressurePort(Sinusoid(1000.0, 800.0, 0.02))
        self.model = build_model(self.mesh, {"inlet": port, "outlet": outlet})
        self.stepper = prepare(DT, self.model, tolerance=1e-6, max_iterations=100)
        self.start = initial_state(self.model, p=1000.0)
        self.step = eqx.filter_jit(advance_step)

    def after(self, n_steps, state):
        for _ in range(n_steps):
            state, report = self.step(self.model, state, self.stepper)
            assert report.result == RESULTS.successful
        return state


@pytest.fixture(scope="module", params=sorted(PORTS))
def case(request):
    return Case(PORTS[request.param], linear=request.param not in NONLINEAR)


@pytest.fixture(scope="module")
def end(case):
    return case.after(N_STEPS, case.start)


def _views(port, state, u, p, v, step, surface, model):
    """What a port says in a step, as arrays: velocity, displacement, load, its change, its end."""
    before, Z = state.port_states[0], step.Z[0]
    motion = PortMotion(u, step.coefficients.c, step.x, model.blood.rho_f)
    along = motion._replace(u=v)
    zero = jnp.zeros_like(u)
    traction = port.linearise(state.t, DT, before, u, step.x, surface, METHOD)
    P = traction.P_offset + traction.Z * flux(u, step.x, surface.faces)
    Q = flux(u, step.x, surface.faces)
    return (
        port.add_velocity(state.t, zero, model.x, surface),
        port.add_displacement(state.t, DT, zero, before, surface),
        port.add_load(zero, jnp.asarray(P, float), motion, surface),
        port.add_load_tangent(zero, Z, METHOD.alpha_f, along, surface),
        port.end_step(state.t, DT, before, Q, p, step.x, surface, METHOD),
    )


def _in_a_step(case, state):
    model = case.model
    step = begin_step(jnp.asarray(DT), model, state, METHOD, case.stepper.motion)
    rng = np.random.default_rng(0)
    u = state.u + 5.0 * jnp.asarray(rng.standard_normal(state.u.shape))
    v = jnp.asarray(rng.standard_normal(state.u.shape))
    c = 5.0 * jnp.asarray(rng.standard_normal(state.u.shape))  # inwards on some faces
    return eqx.tree_at(lambda s: s.coefficients.c, step, c), u, v


def test_compiled_and_eager_agree(case, end):
    step, u, v = _in_a_step(case, end)
    surface = case.model.surfaces[0]
    arguments = (case.model.ports[0], end, u, end.p, v, step, surface, case.model)
    eager, compiled = _views(*arguments), eqx.filter_jit(_views)(*arguments)
    for a, b in zip(jax.tree.leaves(eager), jax.tree.leaves(compiled), strict=True):
        # Sums over some twenty faces, in another order.
        size = np.max(np.abs(b), initial=0.0)
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * size)


def test_tangent_is_the_derivative_of_the_load(case, end):
    """Along a change of the new velocity, whose flow changes the pressure."""
    step, u, v = _in_a_step(case, end)
    model, port, surface = case.model, case.model.ports[0], case.model.surfaces[0]

    def load(new):
        middle = end.u + METHOD.alpha_f * (new - end.u)
        motion = PortMotion(middle, step.coefficients.c, step.x, model.blood.rho_f)
        P = step.P_offset[0] + step.Z[0] * flux(new, step.x, surface.faces)
        return port.add_load(jnp.zeros_like(new), P, motion, surface)

    _, exact = jax.jvp(load, (u,), (v,))
    along = PortMotion(v, step.coefficients.c, step.x, model.blood.rho_f)
    zero = jnp.zeros_like(v)
    found = port.add_load_tangent(zero, step.Z[0], METHOD.alpha_f, along, surface)
    size = float(jnp.max(jnp.abs(exact)))
    assert (size == 0.0) == port.prescribes_velocity
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * size)
    difference = (load(u + v) - load(u - v)) / 2.0  # the load is linear: no truncation
    np.testing.assert_allclose(found, difference, rtol=0, atol=1e-10 * size)


def test_pressure_is_tangent_to_the_law_at_the_flow_where_it_is_linearised(case, end):
    """Z is dP/dQ of P = P_offset + Z Q, each taken at that flow; of linear laws at every flow."""
    step, u, v = _in_a_step(case, end)
    port, surface = case.model.ports[0], case.model.surfaces[0]
    before = end.port_states[0]

    def pressure(field):
        found = port.linearise(end.t, DT, before, field, step.x, surface, METHOD)
        P = found.P_offset + found.Z * flux(field, step.x, surface.faces)
        return jnp.asarray(P, float), found.Z

    (_, Z), (change, _) = jax.jvp(pressure, (u,), (v,))
    wanted = float(Z * flux(v, step.x, surface.faces))
    np.testing.assert_allclose(float(change), wanted, rtol=1e-12, atol=1e-12 * abs(float(Z)))
    for field in (u, v) if case.linear else ():
        found = port.linearise(end.t, DT, before, field, step.x, surface, METHOD)
        np.testing.assert_allclose(float(found.P_offset), float(step.P_offset[0]), rtol=1e-12)
        np.testing.assert_allclose(float(found.Z), float(step.Z[0]), rtol=1e-12)


def test_prescribed_velocity_is_held_and_leaves_the_rest_alone(case, end):
    model, port = case.model, case.model.ports[0]
    on_port = np.zeros(model.n_nodes, bool)
    on_port[np.asarray(model.port_faces[0])] = True
    guess = extrapolated(end.t, model, end)
    given = port.add_velocity(end.t, jnp.zeros_like(end.u), model.x, model.surfaces[0])
    if port.prescribes_velocity:
        assert np.all(np.asarray(model.prescribed)[on_port])
        np.testing.assert_array_equal(guess.u[:, on_port], given[:, on_port])
        # The step solves these rows in single precision, with the others.
        np.testing.assert_allclose(end.u[:, on_port], given[:, on_port], atol=1e-5)
        assert float(jnp.max(jnp.abs(given))) > 0.0
    else:
        wall = np.zeros(model.n_nodes, bool)
        wall[case.mesh.labelled(INTERFACE)] = True
        assert not np.any(np.asarray(model.prescribed)[on_port & ~wall])
    np.testing.assert_array_equal(given[:, ~on_port], 0.0)


def test_volume_is_conserved(case):
    """The balance of each step, as `keep_books` has it, of steps that the other tests compile."""
    wall, states = wet_wall(case.mesh), [case.start]
    for _ in range(N_STEPS):
        states.append(case.after(1, states[-1]))
    flows = [
        balance(before, after, case.model, case.stepper.method, wall)
        for before, after in itertools.pairwise(states)
    ]
    leak = max(abs(float(flow.ports + flow.wall)) for flow in flows)
    # The sum of the continuity equations, solved to 1e-6 of what extrapolation leaves of them.
    assert leak < 1e-5 * np.mean([float(flow.through) / 2.0 for flow in flows])


def test_state_holds_all_that_the_port_needs_to_go_on(case, end):
    """A run that is stored as arrays half-way reaches the same bits."""
    stored = [np.asarray(leaf) for leaf in jax.tree.leaves(case.after(2, case.start))]
    like, structure = jax.tree.flatten(case.start)
    assert [(a.shape, a.dtype) for a in stored] == [(a.shape, a.dtype) for a in like]
    state = jax.tree.unflatten(structure, [jnp.asarray(a) for a in stored])
    for found, wanted in zip(
        jax.tree.leaves(case.after(N_STEPS - 2, state)), jax.tree.leaves(end), strict=True
    ):
        np.testing.assert_array_equal(found, wanted)


def test_summary_names_the_kind(case):
    summary = case.model.ports[0].summary()
    assert isinstance(summary.pop("kind"), str)
    assert all(isinstance(value, float) for value in summary.values())


@pytest.mark.slow
def test_gradient_of_a_march_is_that_of_differences(case):
    """Of the pressure and flow at both ends, by each number of the port."""
    numbers, rest = eqx.partition(case.model.ports[0], eqx.is_inexact_array)
    values, unravel = jax.flatten_util.ravel_pytree(numbers)

    @eqx.filter_jit
    def result(values, model, state, stepper):
        port = eqx.combine(unravel(values), rest)
        model = eqx.tree_at(lambda m: m.ports[0], model, port)
        state, _ = jax.lax.scan(
            lambda s, _: (advance_step(model, s, stepper)[0], None), state, None, length=3
        )
        return jnp.sum(state.P_port) + 10.0 * jnp.sum(state.Q_port * jnp.asarray([1.0, -2.0]))

    arguments = (case.model, case.start, case.stepper)
    gradient = eqx.filter_jit(jax.grad(result))(values, *arguments)
    stepper = dataclasses.replace(case.stepper, tolerance=1e-11, max_systems=20)
    differences = []
    for i, value in enumerate(values):
        step = 1e-3 * (abs(float(value)) or 1.0)
        shift = jnp.zeros_like(values).at[i].set(step)
        up, down = (
            result(values + sign * shift, case.model, case.start, stepper) for sign in (1, -1)
        )
        differences.append(float(up - down) / (2.0 * step))
    # By the change that each number makes; the system of the derivative is solved to 1e-6.
    scale = np.abs(np.asarray(values))
    wanted = scale * np.asarray(differences)
    atol = 1e-5 * float(np.max(np.abs(wanted)))
    np.testing.assert_allclose(scale * gradient, wanted, rtol=1e-4, atol=atol)


@pytest.mark.parametrize("ramped", [True, False])
def test_a_ramped_port_is_the_pressure_or_its_own_port(ramped):
    """Both by one compiled step, to the last digits: the numbers are the same, their order not."""
    pressure = Ramp(1500.0, 3e5)
    switched = Case(RampedPort(_BLOCK, pressure, jnp.asarray(ramped)))
    plain = Case(PressurePort(pressure) if ramped else _BLOCK)
    blocks = switched.start.blocks[0]
    found, expected = switched.after(N_STEPS, switched.start), plain.after(N_STEPS, plain.start)
    for name in ("u", "p", "P_port", "Q_port"):
        a, b = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * float(jnp.max(jnp.abs(b))))
    assert float(jnp.max(jnp.abs(found.Q_port))) > 0.01
    kept = blocks if ramped else expected.blocks[0]
    np.testing.assert_allclose(found.blocks[0], kept, rtol=1e-9)


def test_one_step_serves_a_ramp_and_what_follows_it():
    """Whether the pressure is given is a number: nothing is compiled for the other."""
    case = Case(RampedPort(_BLOCK, Ramp(1500.0, 3e5), jnp.asarray(True)))
    state = case.after(1, case.start)
    other = RampedPort(_BLOCK, Ramp(0.0, 0.0), jnp.asarray(False))
    case.model = eqx.tree_at(lambda m: m.ports[0], case.model, other)
    with jax.no_tracing():
        end = case.after(1, state)
    # the block goes on from the state that the ramp left alone
    np.testing.assert_array_equal(state.blocks[0], case.start.blocks[0])
    assert not np.array_equal(end.blocks[0], state.blocks[0])
