"""What moves the pressure ratio of a 3D run: parameters, and every piece of the lumen.

One sweep in reverse mode through the run (`calibration.ratio_gradient`) gives the derivative by
each number of model and start. What a parameter does to those is differentiated forwards, and the
two are multiplied::

    dr/dp = ∂r/∂model · dmodel/dp + ∂r/∂start · dstart/dp

| parameter | acts on |
|---|---|
| alpha, stress factors, pressures | boundary blocks, their periodic start, aortic pressure |
| E, nu, density and viscosity of the blood | the model |
| pressure in the image | the prestress of the wall, see `jaxfsi.core.statics.prestress` |
| thickness | the outside of the wall, shifted along its normal; the prestress with it |
| lumen | all nodes, see `calibration.lumen_shape`; the prestress with them |

Node positions move on a fixed mesh. α is held: what is found is the effect of an error of the
parameter on a calibrated model; where the run at rest is differentiated as well, that of α tuned
again follows (implicit function theorem, as in `calibration.sensitivity`).
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.lumen_shape import (
    LumenSurface,
    density,
    lumen_spread,
    lumen_surface,
    thickness_field,
)
from calibration.ratio_gradient import RatioGradient, Reading, ratio_gradient
from jaxfsi.core.laws.viscosity import AbstractViscosity, CarreauYasuda, Newtonian
from jaxfsi.core.ports.port import AbstractPort
from jaxfsi.core.statics.equilibrium import Loads, pressure_load, static_factor
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import Stepper, prepare
from jaxfsi.mesh import OUTER_WALL, Mesh
from lumped import StressRule
from lumped.parameters import Parameter
from study.case.model import Case
from study.run.openings import INLET, distal_name
from study.run.patient import stress_rules
from study.run.progress import Progress
from study.run.run_3d import Bench, RunName, run_key, setup_of
from study.run.setup import (
    Setup,
    aortic_pressure,
    image_pressure,
    outlets_of,
)
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


def boundary_of(case: Case, name: RunName) -> Boundary:
    """The numbers of a run."""
    entry = case.conditions[name.condition]
    rule = None if name.rule is None else stress_rules(case)[name.rule]
    return Boundary(name.alpha, entry.P_systolic, entry.P_diastolic, rule)


def under(
    boundary: Boundary, case: Case, condition: str, model: Model, mesh: Mesh
) -> tuple[tuple[AbstractPort, ...], State]:
    """Ports and start of a model under a boundary; its numbers may be traced."""
    entry = dataclasses.replace(
        case.conditions[condition],
        P_systolic=boundary.P_systolic,
        P_diastolic=boundary.P_diastolic,
    )
    case = dataclasses.replace(case, conditions={**case.conditions, condition: entry})
    outlets = outlets_of(case, condition, mesh, boundary.alpha, boundary.rule)
    inlet = aortic_pressure(entry)
    made = outlets.ports(inlet, mesh.openings)
    ports = tuple(made.get(name, port) for name, port in zip(model.names, model.ports, strict=True))
    model = eqx.tree_at(lambda m: m.ports, model, ports)
    return ports, initial_state(model, p=inlet(0.0), blocks=outlets.starts_of(model.names))


class Sensitivity(NamedTuple):
    """What moves the ratio of a run.

    Attributes:
        ratio: of the run, pressures read in every step [-].
        relative: ∂ log ratio / ∂ log parameter, by name [-].
        lumen: derivative of the ratio per shift outwards and area at each node of the lumen,
            smoothed [1/cm³].
        raw: the same without smoothing.
        seconds: that the sweep took [s].
    """

    ratio: float
    relative: dict[str, float]
    lumen: Float[np.ndarray, " nodes"]
    raw: Float[np.ndarray, " nodes"]
    seconds: float


def run_sensitivity(bench: Bench, name: RunName) -> Sensitivity:
    """What moves the ratio of a run that starts from its own periodic state in 0D.

    Raises:
        RuntimeError: a step failed, or a transposed system was not solved.
    """
    key = stage_key("derivatives", run_key(bench, name), bench.site)
    stage = f"sensitivity-{name.folder}"

    def compute() -> dict[str, np.ndarray]:
        begun = time.monotonic()
        setup = setup_of(bench, name)
        kept = PartOfStage(bench.stages, f"{stage}-part", key)
        swept = swept_gradient(bench.case, setup, bench.site, kept, bench.progress)
        bench.progress.tell("derivatives by parameters", 10.0)
        relative, nodes = by_parameters(swept, bench.case, name, setup)
        surface = lumen_surface(bench.mesh)
        g = lumen_spread(bench.mesh, surface).gathered(nodes)
        arrays = {f"by {k}": np.array(v) for k, v in relative.items()}
        arrays |= {"lumen": density(g, surface), "raw": density(g, surface, length=0.0)}
        seconds = np.array(time.monotonic() - begun)
        kept.drop()
        return {**arrays, "ratio": np.array(swept.ratio), "seconds": seconds}

    found = bench.stages.arrays(stage, key, compute)
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
        max_linear=max(MOST_ITERATIONS, case.solver.max_iterations),
        max_nonlinear=case.solver.max_systems,
    )


def reading_of(setup: Setup, site: np.ndarray | None) -> Reading:
    """Where the ratio of a run is read."""
    names = setup.model.names
    distal = distal_name(names)
    assert distal is not None, "checked by check_openings"
    nodes = None if site is None else jnp.asarray(site)
    return Reading(nodes, names.index(distal), names.index(INLET))


def by_parameters(
    swept: RatioGradient, case: Case, name: RunName, setup: Setup
) -> tuple[dict[str, float], Float[np.ndarray, "nodes 3"]]:
    """Derivatives by parameters, ∂ log ratio / ∂ log p, and that of the ratio by all nodes.

    Args:
        swept: see `swept_gradient`.
        case: the case.
        name: the run.
        setup: the run as it was differentiated.
    """
    model, P_image = setup.model, image_pressure(case, name.condition)
    total = _boundary_part(swept, case, name, setup)
    by_x, by_E, by_nu, by_image = _prestress_part(swept.model, model, setup.mesh, P_image)
    by: Any = swept.model  # a derivative in each number's place
    elastic, by_elastic = _elastic(model), _elastic(by)
    total["E"] = float(elastic.E * (by_elastic.E + by_E))
    total["nu"] = float(elastic.nu * (by_elastic.nu + by_nu))
    total["P_image"] = float(P_image * (by.P_ambient + by_image))
    total["rho_f"] = float(model.blood.rho_f * by.blood.rho_f)
    total["mu"] = _by_viscosity(model.blood.viscosity, by.blood.viscosity)
    nodes = np.asarray(by.x + by_x)[:, : model.n_vertices].T
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
    swept: RatioGradient, case: Case, name: RunName, setup: Setup
) -> dict[str, float]:
    """Derivatives by the logarithms of the numbers of the boundary."""
    boundary = jax.tree.map(lambda v: jnp.asarray(v, float), boundary_of(case, name))

    @eqx.filter_jit
    def along(direction: Boundary) -> Float[Array, ""]:
        def made(boundary: Boundary):
            found = under(boundary, case, name.condition, setup.model, setup.mesh)
            return eqx.filter(found, eqx.is_inexact_array)

        change = jax.jvp(made, (boundary,), (direction,))[1]
        products = jax.tree.map(
            lambda g, d: jnp.sum(g * d), (swept.model.ports, swept.state), change
        )
        return sum(jax.tree.leaves(products), jnp.zeros(()))

    leaves, tree = jax.tree.flatten(boundary)
    paths = [path for path, _ in jax.tree_util.tree_flatten_with_path(boundary)[0]]
    found = {}
    for i, path in enumerate(paths):
        only = [v if k == i else jnp.zeros_like(v) for k, v in enumerate(leaves)]
        label = path[-1].name
        label = f"stress_{label}" if len(path) > 1 else label
        found[label] = float(along(jax.tree.unflatten(tree, only)))
    return found


def _elastic(model: Any) -> Any:
    """Material of the wall, which has E and nu whatever its law."""
    return model.wall.material


def _prestress_part(
    by_model: Model, model: Model, mesh: Mesh, P_image: float
) -> tuple[Any, Any, Any, Any]:
    """What nodes, E, nu and the pressure in the image do through the prestress."""
    if model.prestress is None:
        return jnp.zeros_like(model.x), 0.0, 0.0, 0.0
    factor = static_factor(model)

    def stress(numbers: tuple[Array, ...]) -> Array:
        x, E, nu, P = numbers
        free = eqx.tree_at(
            lambda m: (m.x, _elastic(m).E, _elastic(m).nu, m.P_ambient, m.prestress),
            model,
            (x, E, nu, P, None),
            is_leaf=lambda leaf: leaf is None,
        )
        pull = pressure_load(mesh, OUTER_WALL, -P, free)
        found = prestressed(free, Loads((pull,)), factor, throw=False).model.prestress
        assert found is not None
        return found

    @eqx.filter_jit
    def pulled(numbers, cotangent):
        return jax.vjp(stress, numbers)[1](cotangent)[0]

    elastic = _elastic(model)
    numbers = (model.x, *(jnp.asarray(v, float) for v in (elastic.E, elastic.nu, P_image)))
    return pulled(numbers, by_model.prestress)


def recalibrated(
    stress: dict[str, float], rest: dict[str, float], shared: Callable[[str], bool] = lambda _: True
) -> dict[str, float]:
    """The same derivatives with α tuned so that the resting ratio is met anew.

    Args:
        stress: ∂ log ratio / ∂ log p under stress.
        rest: the same at rest.
        shared: which parameters the run at rest has as well.
    """
    gain = stress["alpha"] / rest["alpha"]
    return {
        name: value - (gain * rest.get(name, 0.0) if shared(name) else 0.0)
        for name, value in stress.items()
        if name != "alpha"
    }


def widening(q: Float[np.ndarray, " nodes"], surface: LumenSurface, chosen: np.ndarray) -> float:
    """Change of the ratio when part of the lumen is shifted outwards by 0.1 mm."""
    return float(0.01 * np.sum(q[chosen] * surface.area[chosen]))
