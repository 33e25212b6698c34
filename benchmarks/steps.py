"""Steps of the coupled core: time, iterations, memory, where time goes, what a gradient costs.

The elastic tube under a burst of pressure on three meshes of one family; its parts timed one by one
on the middle mesh, with the bytes that each has to read and write against the bandwidth of a plain
triad measured in the same run; a gradient in reverse mode against its forward run; and what a first
and a second process compile.
"""

import concurrent.futures
import multiprocessing
import os
import pathlib
import resource
import tempfile
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.step_parts import step_parts, step_row
from benchmarks.timing import in_turn, timed
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, WallElement
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.mesh import Mesh
from jaxfsi.simulation.field_series import FieldSeries
from jaxfsi.verification.coupled_tube import (
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
    outlet_pressure_gradient,
)
from jaxfsi.verification.tube_wave import TUBE_WAVE, wave_mesh, wave_model
from study.store.cache_folder import VARIABLE, use_cache

DT = 1e-4
CHUNK = 10
_CASES: dict[str, tuple[tuple[int, int, int], WallElement, float]] = {
    "10k": ((16, 32, 2), "linear", 1e-3),
    "10k, quadratic wall": ((16, 32, 2), "quadratic", 1e-3),
    "60k": ((30, 60, 3), "linear", 1e-3),
    "60k, tolerance 1e-2": ((30, 60, 3), "linear", 1e-2),
    "300k": ((50, 100, 5), "linear", 1e-3),
    "300k, tolerance 1e-2": ((50, 100, 5), "linear", 1e-2),
}
_PROFILED = "60k"
_JUDGED = ("60k", "60k, tolerance 1e-2")
_TIGHT = 1e-7
_GRADIENTS = {"gradient, 7k": 24, "gradient, 62k": 72}
_GRADIENT_STEPS = 20
_LONG = 1000


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark, each case in a process of its own, whose peak of memory is its own."""
    rows = []
    spawn = multiprocessing.get_context("spawn")
    for part in (*_CASES, *_GRADIENTS, "reverse mode"):
        with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as process:
            rows += process.submit(_part, part, rounds).result()
    with tempfile.TemporaryDirectory() as folder:
        for start in ("first", "second"):
            with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as process:
                rows.append(process.submit(_start, f"{start} start, {_PROFILED}", folder).result())
    return {
        "name": "steps",
        "rows": rows,
        "notes": [
            f"dt {DT:g} s; tolerance: by how much a step reduces the residual it begins with.",
            "share: of the step, the part's warm time alone times its calls a step; parts that XLA"
            " computes once for all calls, and about 1 ms of dispatch a call, count here: on small"
            " meshes the shares add up to more than 1.",
            "GB_per_s: bytes of what a part reads and writes at least, over its time.",
            f"error: of pressure and wall displacement {CHUNK} steps later against steps solved to"
            f" {_TIGHT:g}, the larger of both, relative.",
            "first_s: of a call that compiles; of starts, what it takes longer than the next, in"
            " new processes that share a compilation cache.",
            "peak_GiB: of a process that does this alone; of the reverse mode, what the compiled"
            " program asks for, without running it.",
        ],
    }


def _part(name: str, rounds: int) -> list[dict[str, Any]]:
    if name in _GRADIENTS:
        return _gradient(_GRADIENTS[name], rounds)
    return _reverse_memory() if name == "reverse mode" else _case(name, rounds)


class TimedSteps(NamedTuple):
    """Steps of the tube, timed.

    Attributes:
        row: what was measured.
        model: the model.
        stepper: what was prepared.
        begun: the state before the steps, the start of the burst behind.
        end: the state after them.
    """

    row: dict[str, Any]
    model: Model
    stepper: Stepper
    begun: State
    end: State


def timed_steps(
    name: str, mesh: Mesh, rounds: int, *, wall_element: WallElement = "linear", tolerance: float
) -> TimedSteps:
    """Time `CHUNK` steps of the tube on a mesh, in a process that does this alone.

    Args:
        name: of the row.
        mesh: of the tube.
        rounds: calls timed.
        wall_element: elements of the wall.
        tolerance: of a step.
    """
    model = wave_model(mesh, TUBE_WAVE, wall_element=wall_element)
    stepper, prepare_s = timed(lambda: prepare(DT, model, tolerance=tolerance))
    state = initial_state(model)
    begun, first_s = timed(lambda: march(model, state, stepper, CHUNK))
    ends, times = in_turn({name: lambda: march(model, begun.state, stepper, CHUNK)}, rounds)
    row = {
        **step_row(name, model, ends[name].history.report, times[name], CHUNK),
        "tolerance": stepper.tolerance,
        "prepare_s": prepare_s,
        "first_s": first_s,
        "peak_GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }
    return TimedSteps(row, model, stepper, begun.state, ends[name].state)


def _case(name: str, rounds: int) -> list[dict[str, Any]]:
    size, wall_element, tolerance = _CASES[name]
    mesh = wave_mesh(*size)
    row, model, stepper, begun, found = timed_steps(
        name, mesh, rounds, wall_element=wall_element, tolerance=tolerance
    )
    if name in _JUDGED:
        tight = prepare(DT, model, tolerance=_TIGHT, max_iterations=100, max_systems=8)
        exact = march(model, begun, tight, CHUNK).state
        row["error"] = max(_difference(found.p, exact.p), _difference(found.d, exact.d))
    profile = _profile(mesh, model, begun, stepper, row, rounds) if name == _PROFILED else ()
    return [row, *profile]


def _difference(found: jax.Array, exact: jax.Array) -> float:
    return float(jnp.linalg.norm(found - exact) / jnp.linalg.norm(exact))


def _profile(
    mesh: Mesh, model: Model, state: State, stepper: Stepper, whole: dict[str, Any], rounds: int
) -> Iterator[dict[str, Any]]:
    parts = step_parts(model, state, stepper, whole)
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
    with tempfile.TemporaryDirectory() as folder:
        series = FieldSeries(pathlib.Path(folder), mesh, every=1)
        series.observe(0, model, state)
        _, seconds = timed(lambda: series.observe(1, model, state))
    yield {
        "what": "output of a frame of fields",
        "calls": 0.0,
        "median_s": seconds,
        "share": seconds / whole["median_s"],
    }


def _gradient(size: int, rounds: int) -> list[dict[str, Any]]:
    model = coupled_model(coupled_mesh(n_around=size, n_axial=size))
    stepper, state = prepare(1e-3, model), initial_state(model, p=500.0)
    parameters = TubeParameters(*(jnp.asarray(value) for value in TubeParameters()))
    arguments = (parameters, model, state, stepper, _GRADIENT_STEPS)
    results, times = in_turn(
        {
            "forward run": lambda: outlet_pressure(*arguments),
            "eight derivatives in reverse mode": lambda: outlet_pressure_gradient(*arguments),
        },
        rounds,
    )
    if not all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(results)):
        raise RuntimeError("a step of the timed run failed: its time means nothing.")
    forward = times["forward run"]["median_s"]
    return [
        {
            "what": f"{name}, {_GRADIENT_STEPS} steps",
            "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
            "first_s": found["first_s"],
            "median_s": found["median_s"] / _GRADIENT_STEPS,
            "share": found["median_s"] / forward,
        }
        for name, found in times.items()
    ]


def _start(name: str, folder: str) -> dict[str, Any]:
    """What the first steps of a process that keeps what it compiles take longer than later ones."""
    os.environ[VARIABLE] = folder
    assert use_cache() is not None, folder
    size, wall_element, tolerance = _CASES[_PROFILED]
    model = wave_model(wave_mesh(*size), TUBE_WAVE, wall_element=wall_element)
    stepper, prepare_s = timed(lambda: prepare(DT, model, tolerance=tolerance))
    begun, first = timed(lambda: march(model, initial_state(model), stepper, CHUNK))
    _, warm = timed(lambda: march(model, begun.state, stepper, CHUNK))
    return {"what": name, "prepare_s": prepare_s, "first_s": first - warm}


def _reverse_memory() -> list[dict[str, Any]]:
    model = coupled_model(coupled_mesh(n_around=72, n_axial=72))
    stepper, state = prepare(1e-3, model), initial_state(model, p=500.0)
    parameters = TubeParameters(*(jnp.asarray(value) for value in TubeParameters()))
    arrays, rest = eqx.partition((model, state, stepper), eqx.is_array)

    def gradient(parameters: TubeParameters, arrays: Any) -> TubeParameters:
        model, state, stepper = eqx.combine(arrays, rest)
        return outlet_pressure_gradient(parameters, model, state, stepper, _LONG)

    memory = jax.jit(gradient).lower(parameters, arrays).compile().memory_analysis()
    assert memory is not None, "known on CPU and GPU"
    return [
        {
            "what": f"reverse mode through {_LONG} steps",
            "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
            "peak_GiB": (memory.temp_size_in_bytes + memory.argument_size_in_bytes) / 2**30,
        }
    ]
