"""R0 and FFR of the bundled patient over meshes and steps.

The ramp of the pressure drop (tangent at 40 mmHg, secant at 8 mmHg, a, b) and one cycle under
dobutamine with one α, on the presets' meshes and with steps halved. Every run is kept below
``results/convergence`` and found again: what is ended goes on.
"""

import dataclasses
import os
import pathlib
from typing import Any

from jaxfsi.fields.aortic_site import aortic_site
from lumped import MMHG
from study import demo_case_path, read_case
from study.case.model import Case
from study.case.parameters import SurrogateParameters
from study.run.anatomy_source import case_anatomy, states_of
from study.run.fitted_ramp import fitted
from study.run.mesh import mesh_state
from study.run.progress import Progress
from study.run.ramp import ramp_record
from study.run.results import PlannedRun, RunId
from study.run.run_3d import fsi_run
from study.run.run_context import RunContext
from study.run.study_choice import RampChoice, RunChoice
from study.run.study_options import QUICK_RATE, QUICK_TOLERANCE
from study.store.meshes import mesh_key

_RUN = PlannedRun(RunId("convergence", "dobutamine", "printed"), 0.114)
_CURVE = SurrogateParameters(R0=580.0, K=1010.0, law="quadratic")
"""Curve of the coarse ramp: only the start of a run depends on it."""

_SETTINGS = (("coarse", 4e-3), ("coarse", 2e-3), ("coarse", 1e-3), ("medium", 2e-3))
_ALL = (*_SETTINGS, ("coarse", 5e-4), ("fine", 2e-3))
FOLDER = pathlib.Path("results/convergence")
VARIABLE = "JAXFSI_CONVERGENCE"
"""Environment variable: `all` adds steps of 0.5 ms and the fine mesh, which take hours on two
cores; or settings such as ``coarse:4e-3,coarse:2e-3``."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    case = read_case(demo_case_path())
    solver = dataclasses.replace(case.solver, tolerance=QUICK_TOLERANCE)
    case = dataclasses.replace(case, solver=solver, surrogate=_CURVE)
    with Progress() as progress:
        rows = [setting_row(case, preset, dt, progress) for preset, dt in chosen_settings()]
    return {
        "name": "convergence",
        "rows": rows,
        "notes": [
            f"Bundled patient; ramp at {QUICK_RATE / MMHG:.0f} mmHg/s; one cycle under dobutamine,"
            f" rule printed, alpha = {_RUN.alpha}. Resistances in dyn s/cm5, b in dyn s2/cm8.",
            f"Not run here: {', '.join(f'{p} at {1e3 * dt:g} ms' for p, dt in _left_out()) or '-'}"
            f" (set {VARIABLE}=all).",
        ],
    }


def chosen_settings() -> tuple[tuple[str, float], ...]:
    """Meshes and steps to run."""
    text = os.environ.get(VARIABLE, "")
    if text == "all":
        return _ALL
    if not text:
        return _SETTINGS
    pairs = [part.split(":") for part in text.split(",")]
    return tuple((preset, float(dt)) for preset, dt in pairs)


def _left_out() -> list[tuple[str, float]]:
    return [setting for setting in _ALL if setting not in chosen_settings()]


def setting_row(case: Case, preset: str, dt: float, progress: Progress) -> dict[str, Any]:
    """Ramp and run on one mesh with one step."""
    case = dataclasses.replace(case, mesh=dataclasses.replace(case.mesh, preset=preset))
    state = states_of(case)[0]
    mesh = mesh_state(case, state, progress).mesh
    site = aortic_site(mesh, case_anatomy(case, state))
    folder = FOLDER / f"{preset}-{1e3 * dt:g}ms"
    key = mesh_key(case, state)
    context = RunContext(case, mesh, key, folder, RunChoice(dt=dt), progress, site)
    choice = RampChoice(rate=QUICK_RATE)
    progress.step(f"ramp, {folder.name}")
    fit = fitted(ramp_record(context, choice), choice).fit
    progress.step(f"dobutamine, {folder.name}")
    run = fsi_run(context, _RUN)
    return {
        "mesh": preset,
        "tets": len(mesh.tets),
        "dt_ms": 1e3 * run.dt_s,
        "tangent_40": round(float(fit.tangent()[0])),
        "secant_8": round(float(fit.secant(8.0 * MMHG)[0])),
        "a": round(float(fit.law.R0)),
        "b": round(float(fit.law.K)),
        "FFR": f"{run.ratio:.4f}",
        "steps": run.steps,
        "repeated": run.repeated,
        "iterations": run.mean_iterations,
    }
