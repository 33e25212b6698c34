"""What the element of the wall does to the slit of the real patient.

The wall of the bundled patient's coarse mesh, without blood, under a pulse pressure in aorta and
coronary alike: how much the lumen of the intramural course widens with linear and with quadratic
elements, section by section at the measured frames.
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np

from benchmarks.timing import timed
from jaxfsi import INTERFACE, Mesh, Region, submesh
from jaxfsi.anatomy import Anatomy
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.statics.equilibrium import (
    Equilibrium,
    Loads,
    equilibrium,
    pressure_load,
    static_factor,
)
from jaxfsi.core.step.model import WallElement, build_model
from jaxfsi.meshing import build_mesh
from jaxfsi.meshing.check.section_areas import section_areas
from lumped.units import MMHG
from study import demo_case_path, read_case
from study.run.anatomy_source import case_anatomy

_PULSE = 40.0 * MMHG
_ELEMENTS: tuple[WallElement, ...] = ("linear", "quadratic")
_SLIT_CM = 1.5
"""Length of the course from the ostium in which sections count [cm]."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    case = read_case(demo_case_path())
    anatomy = case_anatomy(case, "rest_diastole")
    mesh = build_mesh(anatomy, preset="coarse").mesh
    wall = Wall(SaintVenantKirchhoff(case.wall.E, case.wall.nu), rho_s=case.wall.rho_s)
    s, before = _areas(mesh, anatomy)
    rows = []
    for element in _ELEMENTS:
        (d, end), seconds = timed(lambda element=element: _widened(mesh, wall, element))
        moved = dataclasses.replace(mesh, points=mesh.points + d)
        change = 100.0 * (_areas(moved, anatomy)[1] / before - 1.0)
        known = np.isfinite(change) & (s < _SLIT_CM)
        rows.append(
            {
                "element": element,
                "sections": int(np.sum(known)),
                "area_change_mean_%": float(np.mean(change[known])),
                "area_change_least_%": float(np.min(change[known])),
                "area_change_most_%": float(np.max(change[known])),
                "largest_d_cm": float(np.max(np.linalg.norm(d, axis=1))),
                "newton": int(end.n_newton),
                "gmres": int(end.n_gmres),
                "residual": float(end.residual),
                "seconds": seconds,
            }
        )
    return {
        "name": "slit",
        "rows": rows,
        "notes": [
            f"{_PULSE / MMHG:.0f} mmHg in all lumens, nothing outside; areas at the frames within"
            f" {_SLIT_CM} cm of the ostium. Seconds include compilation."
        ],
        "passed": all(row["residual"] < 1e-5 and row["sections"] >= 3 for row in rows),
    }


def _widened(mesh: Mesh, wall: Wall, element: WallElement) -> tuple[np.ndarray, Equilibrium]:
    """Displacement of all nodes of a mesh under the pulse pressure; blood stays where it is."""
    part = submesh(mesh, Region.SOLID)
    model = build_model(part.mesh, {}, wall=wall, wall_element=element)
    loads = Loads((pressure_load(part.mesh, INTERFACE, jnp.asarray(_PULSE), model),))
    end = equilibrium(model, loads, static_factor(model), max_linear=300, tolerance=1e-6)
    d = np.zeros_like(mesh.points)
    d[part.nodes] = np.asarray(end.d).T[: model.n_vertices]
    return d, end


def _areas(mesh: Mesh, anatomy: Anatomy) -> tuple[np.ndarray, np.ndarray]:
    found = section_areas(mesh, anatomy)
    return found.s - found.s[0], found.meshed
