"""Stiffness of the wall of a case from the lumens that ultrasound measured in several states.

The first state of the contours is the image: its mesh carries the pressure of its condition and
phase by prestress. Each other state has the aortic pressure of its own; in the anomalous artery the
pressure falls linearly over the course that is compared, to the measured mean ratio of the
condition (`ffr`), or not at all where none was measured. The wall bends, whatever the case says;
beside it stands the same mesh with linear elements.
"""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from calibration import Fit, FreeParameter, LumenProfile, lumen_change
from calibration.found_motion import found_motion
from calibration.loaded_wall import LoadedWall, WallStiffness, loaded_wall
from calibration.lumen_record import CONTOUR_ERROR
from calibration.wall_stiffness import (
    MotionData,
    fit_stiffness,
    free_stiffness,
    known,
    learned,
    misfit,
    stiffness_interval,
)
from jaxfsi import Mesh
from jaxfsi.adjoint.lumen_shape import lumen_surface, thickness_field, vessel_nodes
from jaxfsi.anatomy import Anatomy
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.fields.lumen_rings import lumen_rings
from jaxfsi.fields.lumen_sections import artery_planes
from jaxfsi.fields.wall_regions import wall_regions
from jaxfsi.opening import ANOMALOUS
from lumped.waveforms import Constant
from study.case.model import Case, require
from study.run.anatomy_source import case_anatomy
from study.run.case_model import case_model
from study.run.measured_states import (
    MeasuredState,
    check_compared,
    fitted_names,
    measured_states,
    state_profile,
)
from study.run.mesh import mesh_state
from study.run.progress import Progress

COURSE = 1.0
"""Length from the ostium that is compared where nothing is said [cm]: an intramural course."""

SUPPORT = 1e4
"""Support at which a fit starts where the case has none [dyn/cm³]."""

MOST_STEPS = 25

_MODULI = free_stiffness(("aorta",))
"""By what the lumen of linear elements is differentiated; the derivative is not used."""


@dataclasses.dataclass(frozen=True)
class StateMotion:
    """Lumen of a state, measured and predicted, along the distance from the ostium.

    Attributes:
        state: the state.
        fitted: whether the fit knew it.
        measured: its lumen there.
        predicted: logarithms of area and minor axis over those of the image, by model: ``linear``,
            ``literature`` and ``fitted``.
    """

    state: MeasuredState
    fitted: bool
    measured: LumenProfile
    predicted: dict[str, tuple[Float[np.ndarray, " places"], Float[np.ndarray, " places"]]]


@dataclasses.dataclass(frozen=True)
class WallFit:
    """What was found.

    Attributes:
        s: distances from the ostium [cm].
        image: the state whose shape the mesh has.
        image_profile: its lumen there.
        states: the others.
        start: stiffness that the case gives.
        found: stiffness that explains the fitted states best.
        names: what was fitted.
        interval: of 95 % of each, widened by the misfit.
        misfit: root of χ² over its degrees of freedom, at least 1 [-].
        messages: what the lumens say of each number, see `learned`.
        evaluations: how often the motion was computed for the fit.
    """

    s: Float[np.ndarray, " places"]
    image: MeasuredState
    image_profile: LumenProfile
    states: tuple[StateMotion, ...]
    start: WallStiffness
    found: WallStiffness
    names: tuple[str, ...]
    interval: Float[np.ndarray, "names 2"]
    misfit: float
    messages: tuple[str, ...]
    evaluations: int


def calibrate_wall(
    case: Case,
    *,
    fitted: Sequence[str] | None = None,
    free: Sequence[str] | None = None,
    course: float = COURSE,
    contour_error: float = CONTOUR_ERROR,
    progress: Progress | None = None,
) -> WallFit:
    """Find the stiffness of the wall that explains the measured lumens of a case.

    Args:
        case: a case with an ivus anatomy of several states.
        fitted: names of the states to fit; None: the first two after the image.
        free: what is fitted, see `WallStiffness`; None: all moduli and the support.
        course: length from the ostium that is compared [cm].
        contour_error: relative standard deviation of a contour's area and minor axis [-].
        progress: told of each step.

    Raises:
        CaseError: the case lacks something, or its states contradict each other.
        ValueError: something that cannot be fitted is to be.
        RuntimeError: the mesh or the fit failed.
    """
    require(case, "calibrate-wall")
    parameters = free_stiffness() if free is None else free_stiffness(free)
    progress = progress or Progress()
    image, *others = states = measured_states(case)
    check_compared(case, states, course)
    chosen = fitted_names(case, [state.name for state in others], fitted)
    case = _bending(case)
    anatomy = case_anatomy(case, image.name)
    mesh = mesh_state(case, image.name, progress).mesh
    progress.step("preparing the wall")
    thickens, start = any(p.name == "thickness" for p in parameters), _start(case)
    wall = _wall(case, mesh, anatomy, image, start, course, "bending", thickens=thickens)
    s = np.asarray(wall.rings.s)
    profiles = {
        state.name: state_profile(case, state, s, contour_error) for state in (image, *others)
    }
    P = _pressures(mesh, anatomy, wall, image, others, course)
    data = _data(wall, P, profiles, image, others, chosen)
    progress.step("fitting the stiffness")
    parameters = known(parameters, start)
    found, evaluations = _fitted(data, start, parameters, progress)
    progress.step("predicting all states")
    linear = _wall(case, mesh, anatomy, image, start, course, "linear", thickens=False)
    named = list(zip([state.name for state in others], P, strict=True))
    vertices = [(name, pressure[: linear.model.n_nodes]) for name, pressure in named]
    motion = {
        "linear": _motion(linear, start, _MODULI, vertices),
        "literature": _motion(wall, start, parameters, named),
        "fitted": _motion(wall, found.model, parameters, named),
    }
    courses = [
        {m: (area[k], minor[k]) for m, (area, minor) in motion.items()} for k in range(len(P))
    ]
    states = tuple(
        StateMotion(state, state.name in chosen, profiles[state.name], moved)
        for state, moved in zip(others, courses, strict=True)
    )
    return WallFit(
        s=s,
        image=image,
        image_profile=profiles[image.name],
        states=states,
        start=start,
        found=found.model,
        names=found.names,
        interval=np.asarray(stiffness_interval(found)),
        misfit=misfit(found),
        messages=learned(found),
        evaluations=evaluations,
    )


def _fitted(
    data: MotionData,
    start: WallStiffness,
    parameters: Sequence[FreeParameter],
    progress: Progress,
) -> tuple[Fit, int]:
    """The fit, and how often it computed the motion."""
    count = 0

    def told(k: int, cost: float, found: bool) -> None:
        nonlocal count
        count = k
        short = "" if found else ", no equilibrium there: a shorter step"
        progress.tell(f"evaluation {k}, χ² with priors {cost:.4g}{short}")

    found = fit_stiffness(data, start, free=parameters, max_steps=MOST_STEPS, told=told)
    return found, count


def _bending(case: Case) -> Case:
    """The case with a wall that bends, in columns of at least one wedge."""
    layers = max(case.mesh.wedge_layers or 0, 1)
    return dataclasses.replace(
        case,
        wall=dataclasses.replace(case.wall, element="bending", prestress="diastole"),
        mesh=dataclasses.replace(case.mesh, wedge_layers=layers),
    )


def _start(case: Case) -> WallStiffness:
    return WallStiffness(*case.wall.part_moduli, case.wall.tissue.stiffness or SUPPORT)


def _wall(
    case: Case,
    mesh: Mesh,
    anatomy: Anatomy,
    image: MeasuredState,
    start: WallStiffness,
    course: float,
    element: str,
    *,
    thickens: bool,
) -> LoadedWall:
    own = dataclasses.replace(case, wall=dataclasses.replace(case.wall, element=element))
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    model = case_model(own, mesh, ports, image.P_aorta)
    planes = artery_planes(anatomy)
    assert planes is not None, "an ivus anatomy has an axis"
    near = planes.s <= course + 1e-9
    rings = lumen_rings(mesh, type(planes)(*(values[near] for values in planes)))
    field = thickness_field(mesh, lumen_surface(mesh)) if thickens else None
    region = wall_regions(mesh, anatomy)
    return loaded_wall(model, mesh, region, rings, image.P_aorta, start, thickening=field)


def _pressures(
    mesh: Mesh,
    anatomy: Anatomy,
    wall: LoadedWall,
    image: MeasuredState,
    states: Sequence[MeasuredState],
    course: float,
) -> Float[np.ndarray, "states nodes"]:
    """Pressure of each state less that of the image at all nodes [dyn/cm²]."""
    line, surface = anatomy.centerlines[ANOMALOUS], lumen_surface(mesh)
    own = vessel_nodes(surface, line.points)
    passed = np.zeros(wall.model.n_nodes)
    place = KDTree(line.points).query(surface.points[own])[1]
    passed[surface.nodes[own]] = np.clip(line.s[place] / course, 0.0, 1.0)
    return np.stack([state.pressure(passed) - image.pressure(passed) for state in states])


def _data(
    wall: LoadedWall,
    P: Float[np.ndarray, "states nodes"],
    profiles: dict[str, LumenProfile],
    image: MeasuredState,
    states: Sequence[MeasuredState],
    chosen: Sequence[str],
) -> MotionData:
    known = [k for k, state in enumerate(states) if state.name in chosen]
    changes = [lumen_change(profiles[states[k].name], profiles[image.name]) for k in known]
    return MotionData(
        wall,
        jnp.asarray(P[known]),
        jax.tree.map(lambda *parts: jnp.stack(parts), *changes),
    )


def _motion(
    wall: LoadedWall,
    stiffness: WallStiffness,
    free: tuple[FreeParameter, ...],
    states: Sequence[tuple[str, Float[np.ndarray, " nodes"]]],
) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the ratios of area and minor axis in all states.

    Raises:
        RuntimeError: a state has no equilibrium.
    """
    logarithms = []
    for name, P in states:
        found = found_motion(wall, stiffness, free, jnp.asarray(P))
        if found is None:
            given = ", ".join(f"{key} {float(v):.3g}" for key, v in vars(stiffness).items())
            raise RuntimeError(
                f"the wall has no equilibrium under the pressure of {name} ({given}). Fit this"
                " state as well (--fit), or hold some of the moduli (--free)."
            )
        logarithms.append(np.asarray(found.log))
    area, minor = np.moveaxis(np.array(logarithms), 1, 0)
    return area, minor
