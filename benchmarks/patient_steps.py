"""Iterations of a step through a patient's stressed beat, where a slit and its jet decide.

The bundled patient's meshes, with its wall that bends, under dobutamine from the start of the beat
(α of the coarse mesh, tolerance 1e-3, steps of about 2.6 ms), phase by phase. A step in diastole
solves one linear system, in systole two or three; `iterations` counts those of one system.
"""

import dataclasses
import functools
from typing import Any

import numpy as np

from benchmarks.steps import CHUNK
from benchmarks.timing import timed
from benchmarks.wall_steps import CURVE
from jaxfsi.core.step.march import march
from jaxfsi.core.step.stepper import prepare
from jaxfsi.meshing import build_mesh
from study import demo_case_path, read_case
from study.run.anatomy_source import case_anatomy
from study.run.setup import plan_steps, prepare_simulation

PRESETS = ("coarse", "medium")
STEP, ALPHA = 3e-3, 0.1074
CHUNKS = 16
PHASES = {"onset": (1, 4), "rise and peak": (4, 9), "fall": (9, 13), "diastole": (13, 16)}
"""Chunks of steps, the first of which starts from a guess and is left out."""


def run(rounds: int) -> dict[str, Any]:
    """Run one beat of each mesh; `rounds` does not count."""
    del rounds
    case = dataclasses.replace(read_case(demo_case_path()), surrogate=CURVE)
    anatomy = case_anatomy(case, "rest_diastole")
    plan = plan_steps(case, "dobutamine", dt=STEP)
    rows = []
    for preset in PRESETS:
        mesh = build_mesh(anatomy, preset=preset, wedge_layers=case.mesh.wedge_layers).mesh
        setup = prepare_simulation(case, mesh, "dobutamine", plan, alpha=ALPHA)
        stepper, state, times, counts = prepare(plan.dt, setup.model), setup.state, [], []
        for _ in range(CHUNKS):
            end, seconds = timed(functools.partial(march, setup.model, state, stepper, CHUNK))
            state, report = end.state, end.history.report
            times.append(seconds / CHUNK)
            counts.append(np.stack([report.n_gmres, report.n_newton]))
        for phase, (first, last) in PHASES.items():
            n, systems = np.concatenate(counts[first:last], axis=1)
            rows.append(
                {
                    "mesh": preset,
                    "tets": setup.model.fluid_tets.shape[1] + setup.model.solid_tets.shape[1],
                    "phase": phase,
                    "iterations": float(np.sum(n) / np.sum(systems)),
                    "most": float(np.max(n / systems)),
                    "systems": float(np.mean(systems)),
                    "median_s": float(np.median(times[first:last])),
                }
            )
    return {
        "name": "patient_steps",
        "rows": rows,
        "notes": ["iterations: of one linear system, most: of the worst step; median_s: a step."],
    }
