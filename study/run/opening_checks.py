"""Whether the openings of a case fit a command: its names before, its mesh after meshing."""

import numpy as np

from jaxfsi import Mesh, Region
from jaxfsi.opening import INLET, OUTLET, SEGMENT_INLET, is_segment
from study.case.anatomy import MeshAnatomy, SurfaceAnatomy
from study.case.faults import CaseError, Fault, shown_key
from study.case.model import Case
from study.run.anatomy_source import case_mesh, named_openings

_ENDS = (
    f"{INLET}, {OUTLET} and a coronary outlet, or of a vessel without the aorta {SEGMENT_INLET}"
    " and its outlets"
)


def names_segment(case: Case) -> bool:
    """Whether the case, or the mesh that it names, has the ends of a vessel without the aorta.

    Raises:
        CaseError: a file that names them is refused.
    """
    if isinstance(case.anatomy, MeshAnatomy):
        return is_segment(case_mesh(case).openings)
    return is_segment(_given(case))


def check_names(case: Case, *, segment: bool) -> None:
    """Refuse names of vessel ends that a command cannot use, before anything is meshed.

    Args:
        case: the case; only a surface with named ends is looked at.
        segment: whether the command runs a vessel without the aorta.

    Raises:
        CaseError: an opening of the aorta is missing, or there is no outlet.
    """
    names = _given(case)
    if names:
        _check(case, names, segment=segment)


def check_openings(case: Case, mesh: Mesh, *, rigid: bool, segment: bool = False) -> None:
    """Refuse a mesh whose openings do not say which is which.

    Args:
        case: the case.
        mesh: its mesh.
        rigid: whether the wall is left out.
        segment: whether the command runs a vessel without the aorta.

    Raises:
        CaseError: an opening of the aorta is missing, or there is no outlet or no wall.
    """
    _check(case, mesh.openings, segment=segment)
    if not rigid and not np.any(mesh.region == Region.SOLID):
        problem = "the mesh has no wall, so simulate can run it only with --rigid"
        raise CaseError([Fault(case.path, "anatomy", None, problem, "", "use --rigid")])


def _given(case: Case) -> tuple[str, ...]:
    if not isinstance(case.anatomy, SurfaceAnatomy):
        return ()
    names = named_openings(case.anatomy)
    return (*names, *case.anatomy.cuts) if names else ()


def _check(case: Case, names: tuple[str, ...], *, segment: bool) -> None:
    place, cure = "anatomy", f"name the ends of the vessels in the anatomy: {_ENDS}"
    match case.anatomy:
        case MeshAnatomy():
            old = min(names, key=lambda name: "inlet" not in name, default="NAME")
            place = "anatomy.labels"
            cure = f'name them below [anatomy.labels], such as {shown_key(old)} = "{INLET}"'
        case SurfaceAnatomy():
            place = "anatomy.openings"
            cure = f"name them below [anatomy.openings], such as {INLET} = [x, y, z]: {_ENDS}"
        case _:
            pass
    problem = ""
    missing = [name for name in (INLET, OUTLET) if name not in names]
    if is_segment(names):
        if not segment:
            problem = "the vessel has no aorta, to which the ratios of this command are taken"
            cure = f"use jaxfsi simulate, which runs a vessel alone, or {cure}"
        elif len(names) < 2:
            problem = "the vessel has no outlet"
    elif missing:
        problem = f"there is no opening named {' or '.join(missing)}"
    elif len(names) < 3:
        problem, cure = "there is no coronary outlet", "use an anatomy with a coronary artery"
    if problem:
        problem += f"; the openings are {', '.join(names)}"
        raise CaseError([Fault(case.path, place, None, problem, "", cure)])
