"""Steps with linear, bending and quadratic elements of the wall, in turn in one process.

The elastic tube of 10 752 elements under a burst of pressure (it has no columns of wedges), and the
bundled patient's coarse and medium meshes over the start of its beat at rest (α = 0.114, steps of
about 2 ms, prestressed wall). The walls of a patient stand on the same nodes, those of a mesh with
columns, which walls that bend get; linear elements are also timed on the mesh that they get, which
has no columns and more nodes. That is the comparison of a user who changes `element` in a case.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.steps import CHUNK, DT
from benchmarks.timing import in_turn, timed
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, WallElement
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import Mesh
from jaxfsi.meshing import build_mesh
from jaxfsi.verification.tube_wave import TUBE_WAVE, wave_mesh, wave_model
from study import demo_case_path, read_case
from study.case.model import Case
from study.case.parameters import SurrogateParameters
from study.run.anatomy_source import case_anatomy
from study.run.setup import plan_steps, prepare_simulation

_TUBE: tuple[WallElement, ...] = ("linear", "quadratic")
_PATIENT: dict[str, tuple[WallElement, ...]] = {
    "coarse": ("linear", "bending", "quadratic"),
    "medium": ("linear", "bending", "quadratic"),
}
_OWN = "linear on its own mesh"
_PATIENT_DT = 2e-3
_ALPHA = 0.114
CURVE = SurrogateParameters(R0=580.0, K=1010.0, law="quadratic")
"""Curve of the coarse ramp: only the start of a run depends on it."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark."""
    case = dataclasses.replace(read_case(demo_case_path()), surrogate=CURVE)
    tube = wave_mesh(16, 32, 2)
    rows = _rows("tube", DT, {e: _tube(tube, e) for e in _TUBE}, rounds)
    dt = plan_steps(case, "rest", dt=_PATIENT_DT).dt
    anatomy = case_anatomy(case, "rest_diastole")
    for preset, elements in _PATIENT.items():
        mesh = build_mesh(anatomy, preset=preset, wedge_layers=1).mesh
        starts: dict[str, tuple[Model, State]] = {e: _patient(case, mesh, e) for e in elements}
        own = build_mesh(anatomy, preset=preset).mesh
        starts[_OWN] = _patient(case, own, "linear")
        rows += _rows(f"patient, {preset}", dt, starts, rounds)
    return {
        "name": "wall_steps",
        "rows": rows,
        "notes": [
            f"{CHUNK} steps a call, each call from the end of the one before, tolerance 1e-3;"
            " iterations and systems a step.",
            "ratio: of the least times of a step, and of the iterations, to linear elements on the"
            " same nodes; for_user: to linear elements on the mesh that they get.",
        ],
    }


def _tube(mesh: Mesh, element: WallElement) -> tuple[Model, State]:
    model = wave_model(mesh, TUBE_WAVE, wall_element=element)
    return model, initial_state(model)


def _patient(case: Case, mesh: Mesh, element: WallElement) -> tuple[Model, State]:
    case = dataclasses.replace(case, wall=dataclasses.replace(case.wall, element=element))
    plan = plan_steps(case, "rest", dt=_PATIENT_DT)
    setup = prepare_simulation(case, mesh, "rest", plan, alpha=_ALPHA)
    return setup.model, setup.state


def _rows(
    name: str, dt: float, starts: Mapping[str, tuple[Model, State]], rounds: int
) -> list[dict[str, Any]]:
    steppers, reports, ends, calls = {}, {}, {}, {}
    prepared = {}
    for element, (model, state) in starts.items():
        steppers[element], prepared[element] = timed(lambda model=model: prepare(dt, model))
        reports[element], ends[element] = [], state

        def advance(element: str = element, model: Model = model) -> State:
            end = march(model, ends[element], steppers[element], CHUNK)
            reports[element].append(end.history.report)
            ends[element] = end.state
            return end.state

        calls[element] = advance
    _, times = in_turn(calls, rounds)
    rows = []
    for element, (model, _) in starts.items():
        row = {
            "what": f"{name}, {element}",
            "nodes": model.n_vertices,
            "prepare_s": prepared[element],
            "median_s": times[element]["median_s"] / CHUNK,
            "min_s": times[element]["min_s"] / CHUNK,
            "iterations": float(np.mean([np.mean(r.n_gmres) for r in reports[element]])),
            "systems": float(np.mean([np.mean(r.n_newton) for r in reports[element]])),
        }
        first = rows[0] if rows else row
        row["ratio"] = row["min_s"] / first["min_s"]
        row["iteration_ratio"] = row["iterations"] / first["iterations"]
        rows.append(row)
    if _OWN in starts:
        own = rows[list(starts).index(_OWN)]
        for row in rows:
            row["ratio_for_user"] = row["min_s"] / own["min_s"]
            row["iteration_ratio_for_user"] = row["iterations"] / own["iterations"]
    return rows
