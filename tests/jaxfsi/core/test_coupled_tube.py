"""What any coupled model must do: conserve volume, fail with a cause, run in a batch."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve import newton
from jaxfsi.core.step.equations import Unknowns, begin_step, extrapolated, relinearised, residual
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.step import RESULTS, advance_step
from jaxfsi.core.step.stepper import prepare
from jaxfsi.meshing import tube
from jaxfsi.verification.coupled_tube import (
    LENGTH,
    PERIOD,
    RADIUS,
    THICKNESS,
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
    with_parameters,
)
from jaxfsi.verification.volume_balance import keep_books, volume_errors, wet_wall
from lumped.waveforms import Constant

N_STEPS = 4
DT = 1e-3


@pytest.fixture(scope="module")
def mesh():
    return coupled_mesh()


@pytest.fixture(scope="module")
def model(mesh):
    return coupled_model(mesh)


@pytest.fixture(scope="module")
def stepper(model):
    return prepare(DT, model)


def test_volume_is_conserved_over_a_cycle(mesh, model):
    n_steps = 120
    stepper = prepare(PERIOD / n_steps, model)
    books = keep_books(model, initial_state(model), stepper, wet_wall(mesh), n_steps)
    assert np.all(books.report.result == RESULTS.successful)
    errors = volume_errors(books)
    # The sum of the continuity equations, solved to 1e-3 of what extrapolation leaves of them.
    assert errors.equation < 3e-5
    # The lumen's volume follows the flows with the order of the method: 8e-7 at 120 steps.
    assert errors.cycle < 1e-6


@pytest.mark.slow
def test_step_solves_the_equations_with_the_coefficients_of_its_solution(model):
    # Blood that carries itself over half an element in a step: its coefficients change in it.
    start = initial_state(model)
    n_before = 20
    stepper = prepare(DT, model, tolerance=1e-6, max_systems=12, max_iterations=200)
    state = march(model, start, stepper, n_before).state
    fast = state._replace(u=30.0 * state.u, u_before=20.0 * state.u)
    end, report = advance_step(model, fast, stepper)
    assert report.result == RESULTS.successful
    y, guess = Unknowns(end.u, end.p), extrapolated(fast.t + DT, model, fast)
    step = begin_step(stepper.dt, model, fast, stepper.method, stepper.motion)

    def left(y, step):
        r = residual(y, model, step, stepper.method)
        return float(jnp.linalg.norm(jnp.where(model.prescribed, 0.0, r.u)))

    own = left(y, relinearised(y, model, step, stepper.method))
    first = left(guess, step)
    assert own < 1e-4 * first
    # with those of the extrapolated state the same solution is none
    assert left(y, step) > 100.0 * own


@pytest.mark.slow
def test_pressures_that_rise_with_the_ambient_one_move_nothing(model, stepper):
    P = 1e5
    outlet = model.ports[1].block
    raised = dataclasses.replace(
        model,
        P_ambient=jnp.asarray(P),
        ports=(model.ports[0], BlockPort(dataclasses.replace(outlet, P_ref=outlet.P_ref + P))),
    )
    blocks = (None, jnp.asarray([P]))
    plain = march(model, initial_state(model), stepper, N_STEPS).state
    found = march(raised, initial_state(raised, p=P, blocks=blocks), stepper, N_STEPS).state
    # Forces are solved to 1e-3 of what extrapolation leaves; both runs take the same path but for
    # round-off of the pressure, a hundred times larger, in single precision.
    for name in ("u", "d", "a"):
        new, old = (np.asarray(getattr(state, name)) for state in (found, plain))
        np.testing.assert_allclose(new, old, rtol=0, atol=1e-5 * np.max(np.abs(old)))
    lift = np.asarray(found.p - plain.p)[np.asarray(model.in_fluid)]
    np.testing.assert_allclose(lift, P, rtol=1e-5)


def _failing(model, state, stepper):
    end = march(model, state, stepper, N_STEPS, throw=False)
    assert int(end.n_steps) == 0
    for new, old in zip(jax.tree.leaves(end.state), jax.tree.leaves(state), strict=True):
        np.testing.assert_array_equal(new, old)
    return end.result


def test_state_with_a_gap_is_reported_as_not_finite(model, stepper):
    state = initial_state(model)
    state = state._replace(p=state.p.at[5].set(jnp.nan))
    assert _failing(model, state, stepper) == RESULTS.not_finite


def test_mesh_turned_inside_out_is_reported(model, stepper):
    # The wall has gone beyond the axis.
    state = initial_state(model)
    inwards = jnp.where(model.in_solid & ~model.prescribed, -2.5, 0.0) * model.x
    d = inwards.at[2].set(0.0)
    state = state._replace(d=d, d_mesh=d)
    assert _failing(model, state, stepper) == RESULTS.inverted


def test_step_that_is_too_long_is_not_converged(model, stepper):
    # Factors made for steps of 1 ms, a wall under a load for which it would burst.
    state = initial_state(model, p=1e7)
    assert _failing(model, state, stepper) == RESULTS.not_converged


@pytest.mark.parametrize(("limit", "n_newton"), [(newton.DIVERGED, 4), (0.5, 0)])
def test_last_attempt_ends_where_its_residual_is_beyond_the_limit(
    monkeypatch, model, limit, n_newton
):
    """A tight step takes some systems; below one, the extrapolated state itself is beyond."""
    monkeypatch.setattr(newton, "DIVERGED", limit)
    monkeypatch.setattr(newton, "LAST_ATTEMPT", 0)
    stepper = prepare(DT, model, tolerance=1e-7, max_systems=4)
    _, report = advance_step(model, initial_state(model), stepper)
    assert int(report.n_newton) <= n_newton
    assert (report.result == RESULTS.not_converged) == (limit < 1.0)
    assert (float(report.residual) == 1.0) == (limit < 1.0)


def _scaled_derivative(monkeypatch, scale):
    """Replace the derivative by a multiple; what its products were about, once a step has run."""
    linearised, about = newton.linearised, []

    def scaled(y, model, step, stepper, kept=1.0):
        product, transposed, M = linearised(y, model, step, stepper, kept)
        factor = jnp.asarray(scale(kept), jnp.float32)
        jax.debug.callback(lambda kept, p: about.append((float(kept), float(np.sum(p)))), kept, y.p)
        return lambda v: factor * product(v), transposed, M

    monkeypatch.setattr(newton, "linearised", scaled)
    return about


def test_step_starts_anew_where_corrections_make_its_residual_grow(monkeypatch, model, stepper):
    """With a derivative that is wrong until the coefficients are held."""
    state = march(model, initial_state(model), stepper, 2).state
    right, report = advance_step(model, state, stepper)
    starts = _scaled_derivative(monkeypatch, lambda kept: jnp.where(kept > 0.0, -0.2, 1.0))
    found, slow = advance_step(model, state, stepper)
    assert slow.result == RESULTS.successful
    # two attempts of one system each, which do not start from the same state, and the last
    assert int(slow.n_newton) >= int(report.n_newton) + 2
    jax.effects_barrier()
    assert [kept for kept, _ in starts[:3]] == [1.0, 1.0, 0.0]
    assert starts[0][1] == starts[2][1] != starts[1][1]
    change = float(jnp.linalg.norm(right.u - state.u))
    assert float(jnp.linalg.norm(found.u - right.u)) < 0.01 * change


def test_correction_that_is_too_long_is_shortened(monkeypatch, model, stepper):
    """With a derivative that is a fifth of the true one, in the first attempt."""
    state = march(model, initial_state(model), stepper, 2).state
    right, report = advance_step(model, state, stepper)
    seen = _scaled_derivative(monkeypatch, lambda kept: 0.2)
    found, slow = advance_step(model, state, stepper)
    assert slow.result == RESULTS.successful
    jax.effects_barrier()
    assert {kept for kept, _ in seen} == {1.0}
    # a second attempt starts from the pressure of the state
    assert float(np.sum(np.asarray(state.p, np.float32))) not in {p for _, p in seen}
    assert int(report.n_newton) < len(seen) == int(slow.n_newton)
    change = float(jnp.linalg.norm(right.u - state.u))
    assert float(jnp.linalg.norm(found.u - right.u)) < 0.01 * change


def test_march_raises_with_the_step_and_the_cure(model, stepper):
    wild = with_parameters(model, TubeParameters(amplitude=1e6))
    with pytest.raises(RuntimeError, match=r"Step \d of 4 failed at t = .* Take a smaller dt"):
        march(wild, initial_state(wild), stepper, N_STEPS)


def test_a_model_at_rest_stays_there(model, stepper):
    still = with_parameters(model, TubeParameters(amplitude=0.0, P_ref=0.0))
    end = march(still, initial_state(still), stepper, N_STEPS)
    assert float(jnp.max(jnp.abs(end.state.u))) == 0.0


def _stacked_bytes(jaxpr, length):
    """Bytes a step that loops of a length keep of each step."""
    kept = 0
    for equation in jaxpr.eqns:
        if equation.primitive.name == "scan" and equation.params["length"] == length:
            stacked = equation.outvars[equation.params["num_carry"] :]
            kept += sum(v.aval.size * v.aval.dtype.itemsize for v in stacked) // length
        for inner in jax.core.jaxprs_in_params(equation.params):
            kept += _stacked_bytes(inner, length)
    return kept


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_reverse_mode_keeps_a_state_a_step_and_no_factors(model, stepper):
    state, n_steps = initial_state(model), 7

    def pressure(p):
        return outlet_pressure(p, model, state, stepper, n_steps)

    gradient = jax.make_jaxpr(jax.grad(pressure))(TubeParameters())
    size = sum(leaf.nbytes for leaf in jax.tree.leaves(state))
    factors = sum(leaf.nbytes for leaf in jax.tree.leaves(stepper))
    assert factors > 10 * size
    assert size / 2 < _stacked_bytes(gradient.jaxpr, n_steps) < 2 * size


@pytest.mark.slow
def test_recomputed_states_give_the_same_gradient(model, stepper):
    state = initial_state(model)

    def pressure(E, recompute):
        tube = with_parameters(model, TubeParameters(E=E))
        end = march(tube, state, stepper, N_STEPS, throw=False, recompute=recompute)
        return jnp.mean(end.history.P_port[:, 1])

    slope = jax.jit(jax.grad(pressure), static_argnums=1)
    # the same operations in another program; systems are solved to 5e-6
    np.testing.assert_allclose(slope(1.5e6, True), slope(1.5e6, False), rtol=1e-5)


@pytest.mark.slow
def test_jit_equals_eager(model, stepper):
    state = initial_state(model)
    compiled = march(model, state, stepper, N_STEPS).history
    for i in range(2):
        state, report = advance_step(model, state, stepper)
        assert int(report.n_gmres) == int(compiled.report.n_gmres[i])
        # The same operations in another order; GMRES carries the round-off on.
        np.testing.assert_allclose(state.P_port, compiled.P_port[i], rtol=1e-8)


@pytest.mark.slow
def test_a_batch_of_walls_equals_each_alone(model, stepper):
    state = initial_state(model)
    moduli = jnp.asarray([1e6, 1.5e6, 3e6])

    def pressure(E):
        return outlet_pressure(TubeParameters(E=E), model, state, stepper, N_STEPS)

    alone = [float(pressure(E)) for E in moduli]
    # The batch ends its iterations together: converged further, by less than the tolerance.
    np.testing.assert_allclose(jax.vmap(pressure)(moduli), alone, rtol=1e-4)
    assert alone[0] < alone[1] < alone[2] or alone[0] > alone[1] > alone[2]


def test_bad_input_is_refused(mesh, model):
    ports = {"inlet": FlowPort(Constant(1.0)), "outlet": PressurePort(Constant(0.0))}
    wall = model.wall
    with pytest.raises(ValueError, match=r"outlet have no port.*give each opening"):
        build_model(mesh, {"inlet": ports["inlet"]}, wall=wall)
    with pytest.raises(ValueError, match="no label 'side'"):
        build_model(mesh, ports | {"side": ports["outlet"]}, wall=wall)
    with pytest.raises(ValueError, match="has a wall but none is given"):
        build_model(mesh, ports)
    with pytest.raises(ValueError, match="no label 'rim'"):
        build_model(mesh, ports, wall=wall, clamped=("rim",))
    for dt, options, message in (
        (0.0, {}, "not positive"),
        (float("nan"), {}, "not positive"),
        (DT, {"tolerance": 1.0}, "tolerance"),
        (DT, {"rho_infinity": 1.5}, "rho_infinity"),
    ):
        with pytest.raises(ValueError, match=message):
            prepare(dt, model, **options)


@pytest.fixture(scope="module")
def bending(model):
    mesh = tube(
        radius=RADIUS,
        length=LENGTH,
        thickness=THICKNESS,
        n_around=8,
        n_axial=8,
        n_layers=1,
        n_rings=2,
        columns=True,
    )
    ports = dict(zip(model.names, model.ports, strict=True))
    return mesh, build_model(mesh, ports, wall=model.wall, wall_element="bending")


@pytest.mark.slow  # its twin with linear walls: test_volume_is_conserved_over_a_cycle
def test_wall_that_bends_conserves_volume(bending):
    mesh, model = bending
    stepper = prepare(DT, model)
    books = keep_books(model, initial_state(model), stepper, wet_wall(mesh), 20)
    assert np.all(books.report.result == RESULTS.successful)
    assert volume_errors(books).equation < 3e-5  # as linear walls


@pytest.mark.slow
@pytest.mark.parametrize("name", ["E", "outwards"])
def test_derivative_through_steps_of_a_wall_that_bends(bending, name):
    _, model = bending
    stepper = prepare(DT, model, tolerance=1e-10)
    start, base = initial_state(model), TubeParameters()

    def outlet(value):
        changed = base._replace(**{name: value})
        return outlet_pressure(changed, model, start, stepper, N_STEPS)

    at = jnp.asarray(getattr(base, name))
    slope = jax.grad(outlet)(at)
    h = 1e3 if name == "E" else 1e-5
    difference = (outlet(at + h) - outlet(at - h)) / (2.0 * h)
    np.testing.assert_allclose(slope, difference, rtol=1e-4)
