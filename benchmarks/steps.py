"""Steps of the coupled core: time, iterations, memory, where time goes, what a gradient costs.

The elastic tube under a burst of pressure on three meshes of one family; its parts timed one by one
on the middle mesh, with the bytes that each has to read and write against the bandwidth of a plain
triad measured in the same run; and a gradient in reverse mode against its forward run.
"""

import resource
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import in_turn, timed
from jaxfsi.core.equations import Unknowns, begin_step, extrapolated, residual
from jaxfsi.core.march import march
from jaxfsi.core.mesh_motion import mesh_displacement
from jaxfsi.core.model import Model, WallElement
from jaxfsi.core.newton import single, tangent
from jaxfsi.core.preconditioner import precondition
from jaxfsi.core.state import State, initial_state
from jaxfsi.core.stepper import Stepper, prepare
from jaxfsi.verification.coupled_tube import (
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
    outlet_pressure_gradient,
)
from jaxfsi.verification.tube_wave import TUBE_WAVE, wave_mesh, wave_model

DT = 1e-4
CHUNK = 10
_CASES: dict[str, tuple[tuple[int, int, int], WallElement, float]] = {
    "10k": ((16, 32, 2), "linear", 1e-3),
    "10k, quadratic wall": ((16, 32, 2), "quadratic", 1e-3),
    "60k": ((30, 60, 3), "linear", 1e-3),
    "60k, tolerance 1e-2": ((30, 60, 3), "linear", 1e-2),
    "300k": ((50, 100, 5), "linear", 1e-3),
}
_PROFILED = "60k"
_GRADIENT_STEPS = 20


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark."""
    rows = []
    for name, (size, wall_element, tolerance) in _CASES.items():
        model = wave_model(wave_mesh(*size), TUBE_WAVE, wall_element=wall_element)
        stepper, prepare_s = timed(
            lambda model=model, tolerance=tolerance: prepare(DT, model, tolerance=tolerance)
        )
        state = initial_state(model)
        end, first_s = timed(lambda: march(model, state, stepper, CHUNK))  # noqa: B023
        # The start of the burst is behind.
        _, times = in_turn(
            {name: lambda: march(model, end.state, stepper, CHUNK)},  # noqa: B023
            rounds,
        )
        report = march(model, end.state, stepper, CHUNK).history.report
        step_s = times[name]["median_s"] / CHUNK
        rows.append(
            {
                "what": f"step, {name}",
                "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
                "tolerance": stepper.tolerance,
                "prepare_s": prepare_s,
                "first_s": first_s,
                "median_s": step_s,
                "min_s": times[name]["min_s"] / CHUNK,
                "iterations": float(np.mean(report.n_linear)),
                "systems": float(np.mean(report.n_nonlinear)),
                "peak_GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
            }
        )
        if name == _PROFILED:
            rows += _profile(model, end.state, stepper, rows[-1], rounds)
    rows += _gradient(rounds)
    return {
        "name": "steps",
        "rows": rows,
        "notes": [
            f"dt {DT:g} s; tolerance: by how much a step reduces the residual that it begins with;"
            " after 60 steps the fields at 1e-2 differ by 3e-4 from those at 1e-3.",
            "share: of the step, the part's warm time alone times its calls a step; parts that XLA"
            " computes once for all calls, and about 1 ms of dispatch a call, count here: on small"
            " meshes the shares add up to more than 1.",
            "GB_per_s: bytes of what a part reads and writes at least, over its time.",
            "peak_GiB is of the whole process so far.",
        ],
    }


def _profile(
    model: Model, state: State, stepper: Stepper, whole: dict[str, Any], rounds: int
) -> Iterator[dict[str, Any]]:
    method = stepper.method
    step = eqx.filter_jit(begin_step)(stepper.dt, model, state, method, stepper.motion)
    y = extrapolated(state.t + stepper.dt, model, state)
    y_single = single(y)
    flat = jnp.concatenate([y_single.u.reshape(-1), y_single.p])
    a, b = (jnp.arange(8e6) + i for i in range(2))
    n, systems = whole["iterations"], whole["systems"]

    def product(y: Unknowns, model: Model, step: Any, flat: Any) -> Any:
        return tangent(y, model, step, stepper)(flat)

    parts: dict[str, tuple[float, Callable[..., Any], tuple[Any, ...]]] = {
        "mesh motion": (1.0, mesh_displacement, (stepper.motion, state.d)),
        "geometry, motion and coefficients": (
            1.0,
            lambda model, state: begin_step(stepper.dt, model, state, method, stepper.motion),
            (model, state),
        ),
        "residual": (
            1.0 + systems,
            lambda y, model, step: residual(y, model, step, method),
            (y, model, step),
        ),
        "product with the tangent": (n, product, (y, model, step, flat)),
        "preconditioner": (n, precondition, (stepper.preconditioner, *y_single)),
        "triad a + 3 b, 8 million": (0.0, lambda a, b: a + 3.0 * b, (a, b)),
    }
    calls = {}
    for name, (_, function, arguments) in parts.items():
        compiled = eqx.filter_jit(function)
        calls[name] = lambda compiled=compiled, arguments=arguments: compiled(*arguments)
    results, times = in_turn(calls, max(rounds, 20))
    for name, (per_step, _, arguments) in parts.items():
        seconds = times[name]["median_s"]
        moved = sum(leaf.nbytes for leaf in jax.tree.leaves((arguments, results[name])))
        yield {
            "what": name,
            "calls": per_step,
            "median_s": seconds,
            "share": per_step * seconds / whole["median_s"],
            "GB_per_s": moved / seconds / 1e9,
        }


def _gradient(rounds: int) -> list[dict[str, Any]]:
    model = coupled_model(coupled_mesh(n_around=24, n_axial=24))
    stepper, state = prepare(1e-3, model), initial_state(model, p=500.0)
    parameters = TubeParameters(*(jnp.asarray(value) for value in TubeParameters()))
    arguments = (parameters, model, state, stepper, _GRADIENT_STEPS)
    _, times = in_turn(
        {
            "forward run": lambda: outlet_pressure(*arguments),
            "eight derivatives in reverse mode": lambda: outlet_pressure_gradient(*arguments),
        },
        rounds,
    )
    forward = times["forward run"]["median_s"]
    return [
        {
            "what": name,
            "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
            "first_s": found["first_s"],
            "median_s": found["median_s"] / _GRADIENT_STEPS,
            "share": found["median_s"] / forward,
        }
        for name, found in times.items()
    ]
