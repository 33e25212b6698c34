"""From the anatomy of a case to an anatomy that can be meshed, or to the mesh that it names.

Nothing is computed here: each kind is handed to its source in `jaxfsi`, and what that refuses
becomes a fault of the case file.
"""

import dataclasses
import math
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np

import jaxfsi.anatomy as sources
from jaxfsi import Mesh, Region
from jaxfsi.anatomy import Anatomy, Cut, IvusOptions, SurfaceOptions
from jaxfsi.anatomy import SyntheticParameters as Parameters
from jaxfsi.measures import triangle_areas
from jaxfsi.mesh_files import read_mesh, read_mesh_complete, stated_axes
from jaxfsi.mesh_parts import canonically_labelled
from lumped.units import MM
from study.case.anatomy import IvusAnatomy, MeshAnatomy, SurfaceAnatomy, SyntheticAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.operation import Operation
from study.case.parameters import WallParameters
from study.run.refusal import refusing

_AORTA_RADIUS = (0.3, 4.0)
"""Radius of an opening of the aorta, from a newborn's to an aneurysm's [cm]."""

_SMALLEST_RADIUS = 0.05
"""Radius of the largest opening of a coronary alone [cm]."""

_CLINICAL = {"cm": ("mm", 1.0 / MM), "rad": ("deg", 180.0 / math.pi)}


def states_of(case: Case) -> tuple[str, ...]:
    """Names of the states that can be meshed: those of the contours, else the kind alone.

    Files are named after states, and mesh.json holds the numbers of the command: a mesh that
    exists already is `finished`.
    """
    if case.anatomy is None:
        return ()
    if isinstance(case.anatomy, IvusAnatomy):
        return tuple(case.anatomy.states)
    if isinstance(case.anatomy, MeshAnatomy):
        return ("finished",)
    return (case.anatomy.kind,)


def case_anatomy(case: Case, state: str | None = None) -> Anatomy:
    """The anatomy of a case in one state, ready to be meshed.

    Args:
        case: a case with an anatomy of kind ivus, synthetic or surface.
        state: one of `states_of`; None is the first.

    Raises:
        CaseError: the source refuses its input; the fault names file, cause and cure.
        ValueError: the case has nothing to mesh, or no such state.
    """
    state = _known_state(case, state)
    match case.anatomy:
        case IvusAnatomy():
            anatomy = _ivus(case, case.anatomy, state)
        case SyntheticAnatomy():
            anatomy = _synthetic(case, case.anatomy)
        case SurfaceAnatomy():
            anatomy = _surface(case, case.anatomy)
        case _:
            raise ValueError("the case names a finished mesh. Read it with case_mesh.")
    anatomy = _operated(case, anatomy)
    _check_thickness(case, anatomy)
    return anatomy


def _operated(case: Case, anatomy: Anatomy) -> Anatomy:
    """The anatomy after the operation of the case, if there is one."""
    if case.operation is None:
        return anatomy
    with refusing(case.path):
        match case.operation:
            case Operation(kind="unroof"):
                return sources.unroofed(anatomy)
            case Operation(kind="reimplant"):
                return sources.reimplanted(anatomy)
            case Operation(diameter=diameter):
                return sources.stented(anatomy, diameter)


def case_mesh(case: Case) -> Mesh:
    """The finished mesh that a case names, its labels in one order whatever that of the file.

    Raises:
        CaseError: the mesh cannot be read, has faults, or holds no blood; the fault names file,
            cause and cure.
        ValueError: the case names no mesh.
    """
    anatomy = case.anatomy
    if not isinstance(anatomy, MeshAnatomy):
        raise ValueError("the case names no finished mesh. Build one from case_anatomy.")
    with refusing(anatomy.places[0]):
        if anatomy.path is not None and not anatomy.path.is_dir():
            mesh = read_mesh(anatomy.path, unit=anatomy.unit, labels=anatomy.labels)
        else:
            fluid, solid = _folders(anatomy)
            mesh = read_mesh_complete(fluid, solid, unit=anatomy.unit, labels=anatomy.labels)
        if not np.any(mesh.region == Region.FLUID):
            raise ValueError(
                f"all {len(mesh.tets)} tetrahedra of the mesh are wall; none is blood. Mark the"
                " tetrahedra of the blood with region 0, or name the folder of the blood."
            )
        _check_size(mesh, anatomy.unit)
    return canonically_labelled(mesh)


def _check_size(mesh: Mesh, unit: str) -> None:
    """Refuse a mesh whose openings are not those of a vessel in its unit.

    Raises:
        ValueError: names the largest opening and its radius.
    """
    radius = {
        name: math.sqrt(triangle_areas(mesh.points, mesh.labelled(name)).sum() / math.pi)
        for name in mesh.openings
    }
    aorta = {name: value for name, value in radius.items() if name.startswith("aorta")}
    chosen = aorta or radius
    if not chosen:
        return
    name = max(chosen, key=chosen.__getitem__)
    low, high = (_AORTA_RADIUS[0] if aorta else _SMALLEST_RADIUS), _AORTA_RADIUS[1]
    if not low <= chosen[name] <= high:
        raise ValueError(
            f"the largest opening, {name}, has a radius of {chosen[name]:.3g} cm, expected"
            f" {low:g}..{high:g} cm: the unit ({unit}) is probably wrong. Give the unit of the"
            " coordinates, or scale the mesh."
        )


def _known_state(case: Case, state: str | None) -> str:
    states = states_of(case)
    if not states or (state is not None and state not in states):
        known = ", ".join(states) or "none"
        raise ValueError(f"the case has no state {state!r} to mesh. Choose one of: {known}.")
    return states[0] if state is None else state


def _folders(anatomy: MeshAnatomy) -> tuple[pathlib.Path | None, pathlib.Path | None]:
    """Folders of blood and wall; a folder that holds neither is that of the blood."""
    if anatomy.path is None:
        return anatomy.fluid, anatomy.solid
    fluid, solid = (anatomy.path / name for name in ("fluid", "solid"))
    if not fluid.is_dir() and not solid.is_dir():
        return anatomy.path, None
    return (fluid if fluid.is_dir() else None), (solid if solid.is_dir() else None)


def _ivus(case: Case, anatomy: IvusAnatomy, state: str) -> Anatomy:
    files = anatomy.states[state]
    assert anatomy.centerline is not None
    angle = anatomy.take_off_angle
    given = {
        "aorta_below": anatomy.aorta_below,
        "aorta_above": anatomy.aorta_above,
        "take_off_angle_deg": None if angle is None else math.degrees(angle),
        "distal_extension": anatomy.distal_extension,
        "fillet": anatomy.fillet,
        "ostium_end": anatomy.ostium_end,
        "normal_length": anatomy.normal_length,
        **_thickness(case.wall),
    }
    if files.external_contours is not None:
        given["measured_minimum"] = case.wall.thickness_min
        given["measured_maximum"] = case.wall.thickness_max
    options = IvusOptions(**{name: value for name, value in given.items() if value is not None})
    radius = {} if anatomy.aorta_radius is None else {"aorta_radius": anatomy.aorta_radius}
    with refusing(files.contours, *anatomy.lines, *files.files[1:]):
        return sources.ivus_anatomy(
            files.contours,
            anatomy.centerline,
            frame_table=files.frame_table,
            reference=files.reference_point,
            state=state,
            **radius,
            aorta_centerline=anatomy.aorta_centerline,
            normal_centerline=anatomy.normal_centerline,
            septum=anatomy.septum,
            external=files.external_contours,
            options=options,
        )


def _synthetic(case: Case, anatomy: SyntheticAnatomy) -> Anatomy:
    usual = Parameters(side=anatomy.side)
    if anatomy.body_surface_area_m2 is not None:
        usual = sources.scaled_anatomy(usual, anatomy.body_surface_area_m2)
    given = {name: value for name, value in _thickness(case.wall).items() if value is not None}
    parameters = dataclasses.replace(usual, **{**given, **anatomy.given})
    faults = sources.parameter_faults(parameters)
    if faults:
        raise CaseError([_parameter_fault(case, fault) for fault in faults])
    with refusing(case.path):
        return sources.synthetic_anatomy(parameters)


def _parameter_fault(case: Case, fault: sources.ParameterFault) -> Fault:
    """A fault of the parameters, which are in cm and rad, as one of the file."""
    unit = sources.PARAMETER_RANGES.get(fault.name, (0.0, 0.0, ""))[2]
    clinical, factor = _CLINICAL.get(unit, ("", 1.0))
    key = f"{fault.name}_{clinical}" if clinical else fault.name
    table = "wall.thickness_per_radius" if fault.name.startswith("thickness_") else "anatomy"
    value = fault.value * factor if isinstance(fault.value, float) else fault.value
    problem = "does not fit the other parameters"
    return Fault(case.path, f"{table}.{key}", value, problem, fault.allowed, fault.cure)


def _surface(case: Case, anatomy: SurfaceAnatomy) -> Anatomy:
    given = {"smoothing_steps": anatomy.smoothing_steps, **_thickness(case.wall)}
    options = SurfaceOptions(**{name: value for name, value in given.items() if value is not None})
    cuts = {n: Cut(cut.centre, cut.normal, cut.radius) for n, cut in anatomy.cuts.items()}
    names = named_openings(anatomy)
    with refusing(*anatomy.files):
        return sources.surface_anatomy(
            anatomy.surface,
            unit=anatomy.unit,
            names=names or None,
            cuts=cuts or None,
            axes=anatomy.axes,
            options=options,
        )


def named_openings(anatomy: SurfaceAnatomy) -> Mapping[str, Sequence[float]]:
    """A point at each named end of a surface, in its unit; empty where sizes tell the names.

    Raises:
        CaseError: the file of the points is refused.
    """
    if anatomy.openings_file is None:
        return anatomy.openings
    with refusing(*anatomy.files):
        return sources.opening_points(
            anatomy.openings_file,
            unit=anatomy.unit,
            axes=anatomy.axes or stated_axes(anatomy.surface),
        )


def _thickness(wall: WallParameters) -> dict[str, float | None]:
    """Thickness of the wall as the sources name it; None where their own limit is meant."""
    return {
        "thickness_per_radius": wall.thickness_per_radius,
        "thickness_minimum": wall.thickness_min,
        "thickness_maximum": wall.thickness_max,
    }


def _check_thickness(case: Case, anatomy: Anatomy) -> None:
    """Refuse a wall that is thicker than the radius of the vessel at an opening."""
    centres = np.array([opening.centre for opening in anatomy.openings])
    thickness = np.asarray(anatomy.thickness(centres))
    radius = np.asarray(anatomy.local_radius(centres))
    faults = [
        Fault(
            case.path,
            "wall.thickness_per_radius",
            case.wall.thickness_per_radius,
            f"the wall would be {wall / MM:.3g} mm thick at {opening.name}, more than the radius"
            f" of the lumen there, {size / MM:.3g} mm",
            "",
            "lower the factor, or min_mm of the table thickness_per_radius",
        )
        for opening, wall, size in zip(anatomy.openings, thickness, radius, strict=True)
        if wall > size
    ]
    if faults:
        raise CaseError(faults[:1])
