"""Derivatives of stress FFR in 3D against runs with another wall and another lumen.

The bundled patient's coarse mesh under dobutamine, the first 30 steps of 2 ms, in which the aortic
pressure rises (the whole cycle with ``JAXFSI_SENSITIVITY=cycle``), α as its quick study finds it.
The ratio is that of the means over those steps. One sweep in reverse mode gives its derivative by
everything; three things are then changed and the whole run is made again, prestress included:
Young's modulus, and in the mesh itself the thickness of the wall and a smooth bulge of the lumen at
the narrowest place of its course. What lies behind the outlets stays as it was.
"""

import dataclasses
import os
import pathlib
import tempfile
import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from jaxfsi.adjoint.lumen_shape import (
    LumenSurface,
    lumen_spread,
    lumen_surface,
    thickness_field,
    vessel_nodes,
)
from jaxfsi.adjoint.ratio_gradient import advance_part
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields.aortic_site import aortic_site
from jaxfsi.fields.lumen_sections import artery_planes, lumen_at
from jaxfsi.meshing import build_mesh
from jaxfsi.opening import ANOMALOUS
from study import demo_case_path, read_case
from study.run.anatomy_source import case_anatomy, states_of
from study.run.progress import Progress
from study.run.results import PlannedRun, RunId
from study.run.run_3d import setup_of
from study.run.run_context import RunContext
from study.run.sensitivity import by_parameters, gradient_stepper, reading_of, swept_gradient
from study.run.simulation_data import Setup
from study.run.study_choice import RunChoice

_RUN = PlannedRun(RunId("sensitivity", "dobutamine", "printed"), 0.114)
_TOLERANCE, _STEP = 1e-3, 2e-3
"""Steps are all of one size, so that none may fail: with 3 ms some would."""

_THICKER = 0.05
"""Share by which the wall is made thicker and thinner."""

_STIFFER = 0.03
"""Share by which Young's modulus is raised and lowered."""

_BULGE, _WIDTH = 0.004, 0.15
"""Height and half width of the bulge of the lumen [cm]."""

_WINDOW, _CHUNK = 30, 6
VARIABLE = "JAXFSI_SENSITIVITY"
"""Environment variable: `cycle` takes the whole cycle, an hour on two cores."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    case = read_case(demo_case_path())
    case = dataclasses.replace(case, solver=dataclasses.replace(case.solver, tolerance=_TOLERANCE))
    anatomy = case_anatomy(case, states_of(case)[0])
    mesh = build_mesh(anatomy, preset="coarse", wedge_layers=1).mesh
    with tempfile.TemporaryDirectory() as folder, Progress() as progress:
        place = pathlib.Path(folder)
        site = aortic_site(mesh, anatomy)
        context = RunContext(case, mesh, "as it is", place, RunChoice(dt=_STEP), progress, site)
        setup = windowed(setup_of(context, _RUN))
        begun = time.perf_counter()
        swept = swept_gradient(case, setup, site, progress=progress)
        sweep_s = time.perf_counter() - begun
        relative, nodes = by_parameters(swept, case, _RUN, setup)
        trials = _trials(context, anatomy, nodes, relative["E"] * swept.ratio)
        rows = []
        for what, (predicted, trial) in trials.items():
            begun = time.perf_counter()
            more, less = (ratio_of(trial(sign), f"{what} {sign}", setup) for sign in (1, -1))
            found = (more - less) / 2.0
            rows.append(
                {
                    "what": what,
                    "by_derivative": predicted,
                    "by_two_runs": found,
                    "difference": abs(predicted - found) / abs(found),
                    "curvature": (more + less) / 2.0 - swept.ratio,
                    "two_runs_s": time.perf_counter() - begun,
                }
            )
    rows += [
        {"what": f"d log FFR / d log {name}", "by_derivative": v} for name, v in relative.items()
    ]
    rows.append({"what": "sweep", "by_derivative": swept.ratio, "two_runs_s": sweep_s})
    return {
        "name": "sensitivity",
        "rows": rows,
        "notes": [
            f"{len(mesh.tets)} tetrahedra, {setup.schedule.n_steps} steps of"
            f" {1e3 * setup.schedule.dt:.3g} ms, tolerance {_TOLERANCE:g}. by_two_runs: half the"
            " difference of the FFR of two runs; curvature: their mean less the FFR between them."
        ],
        "passed": all(row["difference"] < 0.1 for row in rows if "difference" in row),
    }


def _trials(
    context: RunContext, anatomy: Anatomy, by_nodes: np.ndarray, by_modulus: float
) -> dict[str, tuple[float, Callable[[int], RunContext]]]:
    """What is changed: the change of FFR by its derivative, and the case of either sign.

    Args:
        context: of the run that was differentiated.
        anatomy: its anatomy.
        by_nodes: derivative of FFR by the nodes [1/cm].
        by_modulus: and by the logarithm of Young's modulus.
    """
    surface = lumen_surface(context.mesh)
    bulge = lumen_spread(context.mesh, surface)(bulge_of(surface, anatomy, context))
    thicker = _THICKER * thickness_field(context.mesh, surface)
    return {
        "Young's modulus, ±3 %": (
            _STIFFER * by_modulus,
            lambda sign: stiffened(context, 1.0 + sign * _STIFFER),
        ),
        "thickness of the wall, ±5 %": (
            float(np.sum(by_nodes * thicker)),
            lambda sign: moved(context, sign * thicker),
        ),
        "lumen at the narrowest place, ±0.04 mm": (
            float(np.sum(by_nodes * bulge)),
            lambda sign: moved(context, sign * bulge),
        ),
    }


def windowed(setup: Setup) -> Setup:
    """The run over the steps that are looked at."""
    if os.environ.get(VARIABLE) == "cycle":
        return setup
    plan = dataclasses.replace(setup.schedule, n_steps=_WINDOW, per_cycle=_WINDOW, per_frame=_CHUNK)
    return dataclasses.replace(setup, schedule=plan)


def bulge_of(surface: LumenSurface, anatomy: Anatomy, context: RunContext) -> np.ndarray:
    """A smooth shift outwards of the lumen around the narrowest place [cm]."""
    planes = artery_planes(anatomy)
    assert planes is not None, "the bundled patient has an axis"
    area = lumen_at(context.mesh, planes, np.zeros_like(context.mesh.points))[0]
    centre = planes.centre[int(np.nanargmin(area))]
    chosen = vessel_nodes(surface, anatomy.centerlines[ANOMALOUS].points)
    height = np.exp(-(np.linalg.norm(surface.points - centre, axis=1) ** 2) / (2.0 * _WIDTH**2))
    return _BULGE * (height * chosen)[:, None] * surface.normal


def moved(context: RunContext, field: np.ndarray) -> RunContext:
    """With moved nodes."""
    mesh = dataclasses.replace(context.mesh, points=context.mesh.points + field)
    return dataclasses.replace(context, mesh=mesh)


def stiffened(context: RunContext, factor: float) -> RunContext:
    """With a multiple of Young's modulus."""
    wall = dataclasses.replace(context.case.wall, E=factor * context.case.wall.E)
    return dataclasses.replace(context, case=dataclasses.replace(context.case, wall=wall))


def ratio_of(context: RunContext, name: str, before: Setup) -> float:
    """Ratio of a whole new run in equal steps, behind the outlets of another one.

    The impedance of the aorta's outlet would follow the stiffness of its wall.
    """
    setup = windowed(setup_of(dataclasses.replace(context, mesh_key=name), _RUN))
    model = eqx.tree_at(lambda m: m.ports, setup.model, before.model.ports)
    setup = dataclasses.replace(setup, model=model, state=before.state)
    stepper, reading = gradient_stepper(context.case, setup), reading_of(setup, context.site)
    state, sums = setup.state, np.zeros(2)
    for _ in range(setup.schedule.n_steps // _CHUNK):
        part = advance_part(setup.model, state, stepper, reading, _CHUNK)
        state, sums = part.state, sums + np.asarray(part.sums)
    return float(sums[1] / sums[0])
