"""The coupled step, batches of runs and sweeps on an accelerator, beside the processor's cores.

Meshes are those of the benchmark `steps`. Beside each step stands what it reads and writes at least
over the bandwidth of a triad measured in the same run. Answers are checked against the CPU: the
fields of the 60k mesh some steps after the start of the burst, a batch against the same runs one by
one, and a million patients against the divider rule.

    python -m benchmarks --only gpu          # needs a JAX with an accelerator, as by jax[cuda13]
"""

import concurrent.futures
import functools
import multiprocessing
import os
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.step_parts import moved_bytes, step_parts, step_row
from benchmarks.steps import CHUNK, DT
from benchmarks.surrogate import PATIENT, REST
from benchmarks.timing import in_turn, timed
from calibration import sweep_alpha
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.verification.coupled_tube import (
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
)
from jaxfsi.verification.tube_wave import TUBE_WAVE, wave_mesh, wave_model
from lumped import ffr_divider

MESHES = {"60k": (30, 60, 3), "300k": (50, 100, 5), "1M": (77, 152, 7)}
ON_CPU = ("60k", "300k")
BATCH, BATCH_STEPS = 32, 20
PATIENTS, SAMPLES = 1_000_000, (64, 256)
TRIAD = 64_000_000
FIELDS_APART = 5e-3
"""Of the fields on two devices at most: each step is solved to 1e-3."""

BATCH_APART = 1e-3
"""Of the pressures of a batch and of single runs at most, likewise."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark on the first device of JAX, and its CPU rows in processes of their own."""
    device = jax.devices()[0]
    if device.platform == "cpu":
        return {
            "name": "gpu",
            "rows": [{"what": "accelerator", "device": "none"}],
            "notes": ["JAX sees no accelerator here; with one, pip install 'jax[cuda13]'."],
            "passed": False,
        }
    bandwidth = _bandwidth(rounds)
    rows: list[dict[str, Any]] = [{"what": "triad", "GB_per_s": bandwidth / 1e9}]
    passed = True
    on_cpu = {name: _on_cpu(_step_row, name, rounds) for name in ON_CPU}
    for name in MESHES:
        row, fields = _step_row(name, rounds)
        row["bound_s"] = row.pop("bytes") / bandwidth
        if name in on_cpu:
            other, expected = on_cpu[name]
            row["cpu_s"] = other["median_s"]
            row["apart"] = max(map(_apart, fields, expected))
            passed &= row["apart"] <= FIELDS_APART
        rows.append(row)
    for part in (_batch_rows, _sweep_rows):
        expected = {row["what"]: row for row in _on_cpu(part, rounds)}
        for row in part(rounds):
            other = expected[row["what"]]
            row["cpu_s"] = other["median_s"]
            row["apart"] = max(row["apart"], _apart(row.pop("values"), other["values"]))
            limit = BATCH_APART if part is _batch_rows else 1e-11
            passed &= row["apart"] <= limit
            rows.append(row)
    return {
        "name": f"gpu: {device.device_kind}, against {os.cpu_count()} cores of its machine",
        "rows": rows,
        "notes": [
            f"dt {DT:g} s, tolerance 1e-3; median_s and cpu_s: of a step, of a step of one run of"
            " the batch, and of a whole sweep; first_s includes compilation.",
            "bound_s: what a step reads and writes at least, over the triad's bandwidth.",
            f"apart: of fields {2 * CHUNK} steps after the start (at most {FIELDS_APART:g}), of the"
            f" pressures of a batch and of single runs ({BATCH_APART:g}), and of a sweep from the"
            " closed form and from the CPU (1e-11); relative.",
            "repeats: difference of two runs of the same program, relative; sums over elements come"
            " in any order on a GPU.",
        ],
        "passed": bool(passed),
    }


def _on_cpu(part, *arguments) -> Any:
    """A part of the benchmark in a process that sees the CPU alone."""
    before = os.environ.get("JAX_PLATFORMS")
    os.environ["JAX_PLATFORMS"] = "cpu"
    try:
        spawn = multiprocessing.get_context("spawn")
        with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as process:
            return process.submit(part, *arguments).result()
    finally:
        if before is None:
            del os.environ["JAX_PLATFORMS"]
        else:
            os.environ["JAX_PLATFORMS"] = before


def _bandwidth(rounds: int) -> float:
    """Bytes per second of a + 3 b in double precision."""
    a, b = (jnp.arange(float(TRIAD)) + i for i in range(2))
    triad = jax.jit(lambda a, b: a + 3.0 * b)
    _, times = in_turn({"triad": lambda: triad(a, b)}, max(rounds, 20))
    return 3.0 * a.nbytes / times["triad"]["median_s"]


def _step_row(name: str, rounds: int) -> tuple[dict[str, Any], tuple[np.ndarray, np.ndarray]]:
    """Times of a step, and pressure and displacement of the wall 20 steps after the start."""
    model = wave_model(wave_mesh(*MESHES[name]), TUBE_WAVE, wall_element="linear")
    stepper, prepare_s = timed(lambda: prepare(DT, model, tolerance=1e-3))
    begun, first_s = timed(lambda: march(model, initial_state(model), stepper, CHUNK))
    later = functools.partial(march, model, begun.state, stepper, CHUNK)
    first = later().state
    ends, times = in_turn({name: later}, rounds)
    state, report = ends[name].state, ends[name].history.report
    row = {
        **step_row(name, model, report, times[name], CHUNK),
        "prepare_s": prepare_s,
        "first_s": first_s,
        "repeats": max(_apart(first.p, state.p), _apart(first.d, state.d)),
    }
    row["bytes"] = moved_bytes(step_parts(model, state, stepper, row))
    return row, (np.asarray(state.p), np.asarray(state.d))


def _batch_rows(rounds: int) -> list[dict[str, Any]]:
    """Runs of one mesh with other outlets and walls, at once and one by one."""
    model = coupled_model(coupled_mesh(n_around=24, n_axial=24))
    stepper, state = prepare(1e-3, model), initial_state(model, p=500.0)
    share = jnp.linspace(0.7, 1.3, BATCH)
    default = TubeParameters(*(jnp.full(BATCH, float(value)) for value in TubeParameters()))
    batch = default._replace(R_distal=default.R_distal * share, E=default.E / share)
    calls = {
        "batch": lambda: _together(batch, model, state, stepper),
        "one by one": lambda: jnp.stack(
            [
                outlet_pressure(
                    jax.tree.map(lambda leaf, k=k: leaf[k], batch),
                    model,
                    state,
                    stepper,
                    BATCH_STEPS,
                )
                for k in range(BATCH)
            ]
        ),
    }
    results, times = in_turn(calls, rounds)
    apart = _apart(results["batch"], results["one by one"])
    return [
        {
            "what": f"{BATCH} runs, {name}",
            "tets": model.fluid_tets.shape[1] + model.solid_tets.shape[1],
            "first_s": times[name]["first_s"],
            "median_s": times[name]["median_s"] / (BATCH * BATCH_STEPS),
            "min_s": times[name]["min_s"] / (BATCH * BATCH_STEPS),
            "apart": apart,
            "values": np.asarray(results[name]),
        }
        for name in calls
    ]


@eqx.filter_jit
def _together(batch: TubeParameters, model: Model, state: Any, stepper: Stepper) -> jax.Array:
    return jax.vmap(lambda p: outlet_pressure(p, model, state, stepper, BATCH_STEPS))(batch)


def _sweep_rows(rounds: int) -> list[dict[str, Any]]:
    """A million patients of different α, metrics alone."""
    alphas = jnp.linspace(0.05, 2.0, PATIENTS)
    exact = ffr_divider(PATIENT.R0, alphas * PATIENT.coronary.R_total)
    sweeps, times = in_turn(
        {
            str(n): lambda n=n: sweep_alpha(PATIENT, REST, alphas, n_samples=n, waveforms=False)
            for n in SAMPLES
        },
        rounds,
    )
    return [
        {
            "what": f"{PATIENTS} patients, {name} samples",
            **{key: times[name][key] for key in ("first_s", "median_s", "min_s")},
            "apart": float(jnp.max(jnp.abs(sweep.metrics.ratio / exact - 1.0))),
            "values": np.asarray(sweep.metrics.ifr[:: PATIENTS // 1000]),
        }
        for name, sweep in sweeps.items()
    ]


def _apart(found: Any, expected: Any) -> float:
    found, expected = np.asarray(found), np.asarray(expected)
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))
