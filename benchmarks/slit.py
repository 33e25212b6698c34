"""What the element of the wall does to a slit, and how far a slit may close.

The wall of the bundled patient's coarse mesh with columns, without blood, under a pulse pressure in
aorta and coronary alike: how much the lumen of the intramural course widens with linear, bending
and quadratic elements, section by section at the measured frames. Then a drawn slit whose wall
bends falls shut (`jaxfsi.verification.closing_slit`), without and with a least gap: the quality of
the blood's mesh when its area has fallen by half and by 70 %.
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np

from benchmarks.timing import timed
from jaxfsi import INTERFACE, Mesh, Region, submesh
from jaxfsi.anatomy import Anatomy
from jaxfsi.core.laws.contact import LeastGap
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.statics.equilibrium import Equilibrium, equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.meshing import build_mesh
from jaxfsi.meshing.check.section_areas import section_areas
from jaxfsi.simulation import AbstractObserver, SimulationError, simulate
from jaxfsi.verification import SlitShape, slit_mesh, slit_model, slit_shape
from jaxfsi.verification.closing_slit import STEP
from lumped.units import MMHG
from study import demo_case_path, read_case
from study.run.anatomy_source import case_anatomy

_PULSE = 40.0 * MMHG
_ELEMENTS: tuple[WallElement, ...] = ("linear", "bending", "quadratic")
_ALIKE = 0.1
"""Largest difference of bending from quadratic elements, over the latter, in mean and most."""
_LEAST_GAP_CM = 0.02
_STEPS = 60
_SLIT_CM = 1.5
"""Length of the course from the ostium in which sections count [cm]."""


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    case = read_case(demo_case_path())
    anatomy = case_anatomy(case, "rest_diastole")
    mesh = build_mesh(anatomy, preset="coarse", wedge_layers=1).mesh
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
                "case": "patient",
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
    closing = [_closing(None), _closing(LeastGap(gap=_LEAST_GAP_CM))]
    solved = all(row["residual"] < 1e-5 and row["sections"] >= 3 for row in rows)
    valid = all(row["quality_at_half_area"] > 0.0 for row in closing)
    return {
        "name": "slit",
        "rows": [*rows, *closing],
        "notes": [
            f"{_PULSE / MMHG:.0f} mmHg in all lumens, nothing outside; areas at the frames within"
            f" {_SLIT_CM} cm of the ostium. Seconds include compilation.",
            "closing slit: least scaled Jacobian of the blood's elements; it ends in a collapse"
            f" unless its sides keep {10.0 * _LEAST_GAP_CM} mm.",
        ],
        "passed": solved and valid and _alike(rows),
    }


def _alike(rows: list[dict[str, Any]]) -> bool:
    """Whether bending elements move the lumen as quadratic ones do."""
    by = {row["element"]: row for row in rows}
    return all(
        abs(by["bending"][key] / by["quadratic"][key] - 1.0) < _ALIKE
        for key in ("area_change_mean_%", "area_change_most_%")
    )


class _Shapes(AbstractObserver):
    """The shape of the closing slit after each step."""

    def __init__(self, mesh: Mesh):
        self._mesh = mesh
        self.found: list[SlitShape] = []

    @property
    def name(self) -> str:
        """Its name."""
        return "shapes"

    @property
    def every(self) -> int:
        """Each step."""
        return 1

    def observe(self, step: int, model: Model, state: State) -> None:
        """Keep the shape."""
        self.found.append(slit_shape(self._mesh, state))

    def saved_state(self) -> dict[str, np.ndarray]:
        """None."""
        return {}

    def restore(self, step: int, saved_state: dict[str, np.ndarray]) -> None:
        """Nothing to restore."""


def _closing(least_gap: LeastGap | None) -> dict[str, Any]:
    """How a slit falls shut."""
    mesh = slit_mesh()
    model, shapes, end = slit_model(mesh, least_gap=least_gap), _Shapes(mesh), "open"
    try:
        simulate(model, initial_state(model), dt=STEP, n_steps=_STEPS, chunk=2, observers=[shapes])
    except SimulationError as error:
        end = str(error)

    def quality(area: float) -> float:
        return next(shape.quality for shape in shapes.found if shape.area <= area)

    return {
        "case": "closing slit",
        "least_gap_cm": 0.0 if least_gap is None else float(least_gap.gap),
        "quality_at_start": shapes.found[0].quality,
        "quality_at_half_area": quality(0.5),
        "quality_at_30_%": quality(0.3),
        "least_quality": min(shape.quality for shape in shapes.found),
        "least_area_%": 100.0 * min(shape.area for shape in shapes.found),
        "end": end,
    }


def _widened(mesh: Mesh, wall: Wall, element: WallElement) -> tuple[np.ndarray, Equilibrium]:
    """Displacement of all nodes of a mesh under the pulse pressure; blood stays where it is."""
    part = submesh(mesh, Region.SOLID)
    model = build_model(part.mesh, {}, wall=wall, wall_element=element)
    loads = Loads((pressure_load(part.mesh, INTERFACE, jnp.asarray(_PULSE), model),))
    end = equilibrium(model, loads, static_factor(model), max_iterations=300, tolerance=1e-6)
    d = np.zeros_like(mesh.points)
    d[part.nodes] = np.asarray(end.d).T[: model.n_vertices]
    return d, end


def _areas(mesh: Mesh, anatomy: Anatomy) -> tuple[np.ndarray, np.ndarray]:
    found = section_areas(mesh, anatomy)
    return found.s - found.s[0], found.meshed
