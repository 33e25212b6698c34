"""What moves the pressure ratio of a 3D run: parameters, and every piece of the lumen.

One sweep in reverse mode through the run (`jaxfsi.adjoint.ratio_gradient`) gives the derivative by
each number of model and start. What a parameter does to those is differentiated forwards, and the
two are multiplied (`jaxfsi.adjoint.chain_rules`)::

    dr/dp = ∂r/∂model · dmodel/dp + ∂r/∂start · dstart/dp

| parameter | acts on |
|---|---|
| alpha, stress factors, pressures | boundary blocks, their periodic start, aortic pressure |
| E, nu, density and viscosity of the blood | the model |
| pressure in the image | the prestress of the wall, see `jaxfsi.core.statics.prestress` |
| thickness | the outside of the wall, shifted along its normal; the prestress with it |
| lumen | all nodes, see `jaxfsi.adjoint.lumen_shape`; the prestress with them |

Node positions move on a fixed mesh. α is held: what is found is the effect of an error of the
parameter on a calibrated model; where the run at rest is differentiated as well, that of α tuned
again follows (implicit function theorem, as in `calibration.sensitivity`).
"""

import dataclasses
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxfsi.adjoint.chain_rules import along_leaves, elastic, through_prestress
from jaxfsi.adjoint.lumen_shape import (
    density,
    lumen_spread,
    lumen_surface,
    thickness_field,
)
from jaxfsi.adjoint.ratio_gradient import RatioGradient, RatioSensors, ratio_gradient
from jaxfsi.core.laws.viscosity import AbstractViscosity, CarreauYasuda, Newtonian
from jaxfsi.core.ports.port import AbstractPort
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.mesh import Mesh
from jaxfsi.opening import distal_name, inlet_name
from lumped import StressRule
from lumped.parameters import Parameter
from study.case.model import Case
from study.run.patient import condition_of, moved_entry, stress_rules
from study.run.progress import Progress
from study.run.results import PlannedRun
from study.run.run_3d import run_key, setup_of
from study.run.run_context import RunContext
from study.run.setup import aortic_pressure, image_pressure, outlets_of
from study.run.simulation_data import Setup
from study.run.study_parts import Sensitivity
from study.store.stages import PartOfStage, stage_key

MOST_ITERATIONS = 80
"""Iterations of one solve of a transposed system, which is reduced further than a step's."""

_TOLERANCE = 1e-3


class Boundary(NamedTuple):
    """Numbers of the boundary that a run is differentiated by.

    Attributes:
        alpha: scale of the anomalous outlet.
        P_systolic: of the condition [dyn/cm²].
        P_diastolic: of the condition [dyn/cm²].
        rule: factors under stress; None at rest.
    """

    alpha: Parameter
    P_systolic: Parameter
    P_diastolic: Parameter
    rule: StressRule | None


def boundary_of(case: Case, run: PlannedRun) -> Boundary:
    """The numbers of a run."""
    entry = case.conditions[run.id.condition]
    rule = None if run.id.rule is None else stress_rules(case)[run.id.rule]
    return Boundary(run.alpha, entry.P_systolic, entry.P_diastolic, rule)


def under(
    boundary: Boundary, case: Case, condition: str, model: Model, mesh: Mesh
) -> tuple[tuple[AbstractPort, ...], State]:
    """Ports and start of a model under a boundary; its numbers may be traced."""
    known = case.conditions[condition]
    moved = condition_of(known).moved(
        P_systolic=boundary.P_systolic, P_diastolic=boundary.P_diastolic
    )
    entry = moved_entry(known, moved)
    case = dataclasses.replace(case, conditions={**case.conditions, condition: entry})
    outlets = outlets_of(case, condition, mesh, boundary.alpha, boundary.rule)
    inlet = aortic_pressure(entry)
    made = outlets.ports(inlet, mesh.openings)
    ports = tuple(made.get(name, port) for name, port in zip(model.names, model.ports, strict=True))
    model = eqx.tree_at(lambda m: m.ports, model, ports)
    return ports, initial_state(model, p=inlet(0.0), blocks=outlets.starts_of(model.names))


def run_sensitivity(context: RunContext, run: PlannedRun) -> Sensitivity:
    """What moves the ratio of a run that starts from its own periodic state in 0D.

    Raises:
        RuntimeError: a step failed, or a transposed system was not solved.
    """
    key = stage_key("derivatives", run_key(context, run), context.site)
    stage = f"sensitivity-{run.id.name}"

    def compute() -> dict[str, np.ndarray]:
        begun = time.monotonic()
        setup = setup_of(context, run)
        kept = PartOfStage(context.stages, f"{stage}-part", key)
        swept = swept_gradient(context.case, setup, context.site, kept, context.progress)
        context.progress.tell("derivatives by parameters", 10.0)
        relative, nodes = by_parameters(swept, context.case, run, setup)
        surface = lumen_surface(context.mesh)
        g = lumen_spread(context.mesh, surface).gathered(nodes)
        arrays = {f"by {k}": np.array(v) for k, v in relative.items()}
        arrays |= {"lumen": density(g, surface), "raw": density(g, surface, length=0.0)}
        seconds = np.array(time.monotonic() - begun)
        kept.drop()
        return {**arrays, "ratio": np.array(swept.ratio), "seconds": seconds}

    found = context.stages.arrays(stage, key, compute)
    relative = {k.removeprefix("by "): float(v) for k, v in found.items() if k.startswith("by ")}
    return Sensitivity(
        float(found["ratio"]), relative, found["lumen"], found["raw"], float(found["seconds"])
    )


def swept_gradient(
    case: Case,
    setup: Setup,
    site: np.ndarray | None,
    kept: PartOfStage | None = None,
    progress: Progress | None = None,
) -> RatioGradient:
    """Derivative of the ratio of a run by model and start.

    Args:
        case: the case, for its tolerance.
        setup: the run.
        site: nodes where the aortic pressure is read; None: at the inlet.
        kept: where what is gathered is kept.
        progress: told of each chunk.

    Raises:
        RuntimeError: a step failed, or a transposed system was not solved.
    """
    plan, begun = setup.schedule, time.monotonic()

    def tell(sweep: str, done: int, of: int) -> None:
        if progress is not None:
            share = 0.2 * done / of if sweep == "forwards" else 0.2 + 0.8 * done / of
            spent = time.monotonic() - begun
            progress.tell(f"derivatives, {sweep}, {done} of {of}", spent * (1.0 / share - 1.0))

    return ratio_gradient(
        setup.model,
        setup.state,
        gradient_stepper(case, setup),
        reading_of(setup, site),
        n_steps=plan.n_steps,
        per_cycle=plan.per_cycle,
        chunk=plan.per_frame,
        kept=kept,
        tell=tell,
    )


def gradient_stepper(case: Case, setup: Setup, *, tolerance: float | None = None) -> Stepper:
    """What is prepared for the steps of a run and their transposed systems."""
    return prepare(
        setup.schedule.dt,
        setup.model,
        rho_infinity=case.solver.rho_infinity,
        tolerance=tolerance or case.solver.tolerance or _TOLERANCE,
        max_iterations=max(MOST_ITERATIONS, case.solver.max_iterations),
        max_systems=case.solver.max_systems,
    )


def reading_of(setup: Setup, site: np.ndarray | None) -> RatioSensors:
    """Where the ratio of a run is read."""
    names = setup.model.names
    distal = distal_name(names)
    assert distal is not None, "checked by check_openings"
    nodes = None if site is None else jnp.asarray(site)
    return RatioSensors(nodes, names.index(distal), names.index(inlet_name(names)))


def by_parameters(
    swept: RatioGradient, case: Case, run: PlannedRun, setup: Setup
) -> tuple[dict[str, float], Float[np.ndarray, "nodes 3"]]:
    """Derivatives by parameters, ∂ log ratio / ∂ log p, and that of the ratio by all nodes.

    Args:
        swept: see `swept_gradient`.
        case: the case.
        run: which run.
        setup: the run as it was differentiated.
    """
    model, P_image = setup.model, image_pressure(case, run.id.condition)
    total = _boundary_part(swept, case, run, setup)
    through = through_prestress(swept.model, model, setup.mesh, P_image)
    by: Any = swept.model  # a derivative in each number's place
    law, by_law = elastic(model), elastic(by)
    total["E"] = float(jnp.sum(law.E * (by_law.E + through.E)))
    total["nu"] = float(law.nu * (by_law.nu + through.nu))
    total["P_image"] = float(P_image * (by.P_ambient + through.P_image))
    total["rho_f"] = float(model.blood.rho_f * by.blood.rho_f)
    total["mu"] = _by_viscosity(model.blood.viscosity, by.blood.viscosity)
    nodes = np.asarray(by.x + through.x)[:, : model.n_vertices].T
    surface = lumen_surface(setup.mesh)
    total["thickness"] = float(np.sum(nodes * thickness_field(setup.mesh, surface)))
    return {key: value / swept.ratio for key, value in total.items()}, nodes


def _by_viscosity(law: AbstractViscosity, by: Any) -> float:
    """Derivative by the logarithm of the viscosity, at every shear rate alike."""
    if isinstance(law, CarreauYasuda):
        return float(law.mu_zero * by.mu_zero + law.mu_infinite * by.mu_infinite)
    assert isinstance(law, Newtonian)
    return float(law.mu * by.mu)


def _boundary_part(
    swept: RatioGradient, case: Case, run: PlannedRun, setup: Setup
) -> dict[str, float]:
    """Derivatives by the logarithms of the numbers of the boundary."""
    boundary = jax.tree.map(lambda v: jnp.asarray(v, float), boundary_of(case, run))

    def made(boundary: Boundary) -> tuple[tuple[AbstractPort, ...], State]:
        return under(boundary, case, run.id.condition, setup.model, setup.mesh)

    found = along_leaves(made, boundary, (swept.model.ports, swept.state))
    return {
        f"stress_{last.name}" if owners else last.name: value for (*owners, last), value in found
    }
