"""The parts of a coupled step: how often each runs, and what it reads and writes at least."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxfsi.core.laws.mesh_motion import mesh_displacement
from jaxfsi.core.solve.linear_system import single
from jaxfsi.core.solve.preconditioner import precondition
from jaxfsi.core.solve.tangent import apply_elements, step_tangent
from jaxfsi.core.step.equations import begin_step, extrapolated, relinearised, residual
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.core.step.step import StepReport, at_ports
from jaxfsi.core.step.stepper import Stepper

Parts = dict[str, tuple[float, Callable[..., Any], tuple[Any, ...]]]
"""Calls a step, function and arguments, by name."""


def step_parts(model: Model, state: State, stepper: Stepper, whole: dict[str, Any]) -> Parts:
    """The parts of a step, in the state where it begins.

    Args:
        model: the model.
        state: where the step begins.
        stepper: see `prepare`.
        whole: `iterations` and `systems` of a step.
    """
    method = stepper.method
    step = eqx.filter_jit(begin_step)(stepper.dt, model, state, method, stepper.motion)
    y = extrapolated(state.t + stepper.dt, model, state)
    y_single, model_single, step_single = single((y, model, step))
    about = eqx.filter_jit(step_tangent)(y_single, model_single, step_single, method)
    a, b = (jnp.arange(8e6) + i for i in range(2))
    n, systems = whole["iterations"], whole["systems"]

    return {
        "mesh motion": (1.0, mesh_displacement, (stepper.motion, state.d)),
        "geometry, motion and coefficients": (
            1.0,
            lambda model, state: begin_step(stepper.dt, model, state, method, stepper.motion),
            (model, state),
        ),
        "residual with its coefficients": (
            1.0 + systems,
            lambda y, model, step: residual(y, model, relinearised(y, model, step, method), method),
            (y, model, step),
        ),
        "tangent": (
            systems,
            lambda y, model, step: step_tangent(y, model, step, method),
            (y_single, model_single, step_single),
        ),
        "product with the tangent": (
            n,
            lambda about, v, model, step: apply_elements(about, v, model, step, method),
            (about, y_single, model_single, step_single),
        ),
        "preconditioner": (n, precondition, (stepper.preconditioner, *y_single)),
        "flows and pressures of ports": (
            1.0,
            lambda y, model, step: at_ports(y, model, step, method),
            (y, model, step),
        ),
        "triad a + 3 b, 8 million": (0.0, lambda a, b: a + 3.0 * b, (a, b)),
    }


def step_row(
    name: str, model: Model, report: StepReport, times: dict[str, float], n_steps: int
) -> dict[str, Any]:
    """Size of a model, and times and iterations of a step.

    Args:
        name: of the model.
        model: the model.
        report: of the steps of the last call.
        times: of a call, see `timing.in_turn`.
        n_steps: steps a call.
    """
    return {
        "what": f"step, {name}",
        "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
        "median_s": times["median_s"] / n_steps,
        "min_s": times["min_s"] / n_steps,
        "iterations": float(np.mean(report.n_gmres)),
        "systems": float(np.mean(report.n_newton)),
    }


def moved_bytes(parts: Parts) -> float:
    """Bytes that a step reads and writes at least: arguments and results of its parts."""
    total = 0.0
    for calls, function, arguments in parts.values():
        results = eqx.filter_eval_shape(function, *arguments)
        leaves = jax.tree.leaves(eqx.filter((arguments, results), _is_sized))
        total += calls * sum(leaf.size * leaf.dtype.itemsize for leaf in leaves)
    return total


def _is_sized(leaf: Any) -> bool:
    return hasattr(leaf, "dtype") and hasattr(leaf, "size")
