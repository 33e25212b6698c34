"""One step in time: solve the coupled equations, then bring state and ports up to date."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.linear import flux
from jaxfsi.core.ports.port import PortState
from jaxfsi.core.solve.newton import SLACK, solve_step
from jaxfsi.core.solve.solution_derivative import with_derivative
from jaxfsi.core.step.equations import Step, Unknowns, begin_step, extrapolated
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import Start, State
from jaxfsi.core.step.stepper import Stepper


class RESULTS(eqx.Enumeration):
    """How a step ended."""

    successful = ""
    not_converged = (
        "The equations of a step were not solved to the tolerance. Take a smaller dt; check the"
        " pressures and resistances at the openings."
    )
    inverted = (
        "An element of the blood's mesh has turned inside out. Take a smaller dt, a finer mesh"
        " where the lumen is narrow, or a stiffer wall."
    )
    not_finite = (
        "The state is no longer finite. Take a smaller dt and check the units of pressures, flows"
        " and moduli."
    )


class StepReport(NamedTuple):
    """How a step went.

    Attributes:
        result: see `RESULTS`.
        n_gmres: see `Convergence`.
        n_newton: see `Convergence`.
        residual: see `Convergence`.
        min_volume_ratio: minimum volume ratio of the fluid elements, to the reference mesh.
    """

    result: RESULTS
    n_gmres: Int[Array, ""]
    n_newton: Int[Array, ""]
    residual: Float[Array, ""]
    min_volume_ratio: Float[Array, ""]


def no_report() -> StepReport:
    """Placeholder report for a skipped step."""
    zero = jnp.zeros((), int)
    return StepReport(RESULTS.successful, zero, zero, jnp.zeros(()), jnp.ones(()))


def advance_step(
    model: Model, state: State, stepper: Stepper, wanted: Bool[Array, ""] | None = None
) -> tuple[State, StepReport]:
    """Advance a state by one step.

    Derivatives are those of the new state with respect to model, state and dt. They take the
    solution from the step itself, so that reverse mode solves nothing twice: it keeps the states
    before and after, and computes again what lies between.

    Args:
        model: the model.
        state: state at the start of the step.
        stepper: see `prepare`.
        wanted: where false, nothing is done; None: always. A condition round the whole step
            would do the same, but in a loop reverse mode would then keep the factors of the stepper
            once a step.
    """
    return _advance(model, state, stepper, wanted)


@eqx.filter_custom_jvp
def _advance(
    model: Model, state: State, stepper: Stepper, wanted: Bool[Array, ""] | None
) -> tuple[State, StepReport]:
    if wanted is None:
        return _solved(model, state, stepper)
    return jax.lax.cond(
        wanted, lambda: _solved(model, state, stepper), lambda: (state, no_report())
    )


def _solved(model: Model, state: State, stepper: Stepper) -> tuple[State, StepReport]:
    step = _begun(model, state, stepper)
    guess = extrapolated(state.t + stepper.dt, model, state)
    y, start, convergence = solve_step(guess, state.start, model, step, stepper)
    with jax.named_scope("update"):
        new = _updated(y, start, model, step, stepper.method)
    least = jnp.ones(())
    if stepper.motion is not None:
        least = jnp.min(step.fluid_shape.volume / stepper.motion.volume)
    finite = jnp.all(jnp.isfinite(y.u)) & jnp.all(jnp.isfinite(y.p))
    result = RESULTS.where(
        convergence.residual <= SLACK * stepper.tolerance,
        RESULTS.successful,
        RESULTS.not_converged,
    )
    result = RESULTS.where(least > 0.0, result, RESULTS.inverted)
    result = RESULTS.where(finite, result, RESULTS.not_finite)
    return new, StepReport(result, *convergence, least)


@_advance.def_jvp
def _(primals, tangents):
    model, state, stepper, wanted = primals
    model_change, state_change, stepper_change, _ = tangents
    new, report = _advance(model, state, stepper, wanted)

    @eqx.filter_checkpoint
    def again(model: Model, state: State, dt: Float[Array, ""]) -> State:
        timed = eqx.tree_at(lambda s: s.dt, stepper, dt)
        step = _begun(model, state, timed)
        y = with_derivative(Unknowns(new.u, new.p), model, step, timed)
        return _updated(y, new.start, model, step, timed.method)

    _, change = eqx.filter_jvp(
        again, (model, state, stepper.dt), (model_change, state_change, stepper_change.dt)
    )
    if wanted is not None:
        change = jax.tree.map(
            lambda new, old: (
                new if new is None else jnp.where(wanted, new, 0.0 if old is None else old)
            ),
            change,
            state_change,
            is_leaf=lambda leaf: leaf is None,
        )
    return (new, report), (change, jax.tree.map(lambda _: None, report))


def _begun(model: Model, state: State, stepper: Stepper) -> Step:
    return begin_step(stepper.dt, model, state, stepper.method, stepper.motion)


def _updated(
    y: Unknowns, start: Start, model: Model, step: Step, method: GeneralizedAlpha
) -> State:
    dt, old = step.dt, step.state
    a = method.acceleration(dt, old.u, old.a, y.u)
    d = method.displacement(dt, old.d, old.u, old.a, a)
    ports = at_ports(y, model, step, method)
    return State(
        old.t + dt,
        y.u,
        a,
        jnp.where(model.in_solid, d, 0.0),
        y.p,
        step.d_mesh,
        old.u,
        old.p,
        old.d,
        start,
        tuple(port.x for port in ports),
        jnp.array([port.P for port in ports], float),
        jnp.array([port.Q for port in ports], float),
    )


def at_ports(
    y: Unknowns, model: Model, step: Step, method: GeneralizedAlpha
) -> tuple[PortState, ...]:
    """The ports at the end of a step, of its solution."""
    old, ends = step.state, []
    for port, before, surface in zip(model.ports, old.port_states, model.surfaces, strict=True):
        Q = flux(y.u, step.x, surface.faces)
        ends.append(port.end_step(old.t, step.dt, before, Q, y.p, step.x, surface, method))
    return tuple(ends)
