"""The second mesh, beside a case's own, that tells the mesh error."""

import dataclasses

from jaxfsi.meshing import PRESETS
from study.case.anatomy import MeshAnatomy
from study.case.faults import Fault
from study.case.model import Case

SECOND_RAMP = "ramp, second mesh"
"""Name of its step."""

SECOND = "second-mesh"
"""Folder of its ramp, below that of the study."""

FINER, LEAST_HALVED = 4, 4
"""Elements across the lumen of the second mesh of a coarse one; least number that is halved."""


def has_second(case: Case) -> bool:
    """Whether the lumen is meshed here, so that another mesh can be made."""
    return not isinstance(case.anatomy, MeshAnatomy)


def second(case: Case) -> Case:
    """The case with half the elements across the lumen, or more where these are few already."""
    options = case.mesh
    across = options.elements_across or PRESETS[options.preset].across
    halved = across is not None and across >= LEAST_HALVED
    other = across // 2 if halved and across else 2 * (across or FINER // 2)
    mesh = dataclasses.replace(options, preset="coarse", elements_across=other)
    return dataclasses.replace(case, mesh=mesh)


def second_faults(case: Case) -> list[Fault]:
    """Why a case has no second mesh."""
    if has_second(case):
        return []
    problem = "a finished mesh has no second one that would tell the mesh error"
    allowed = "a lumen that is meshed by jaxfsi"
    cure = "leave --mesh-error out"
    return [Fault(case.path, "anatomy.kind", "mesh", problem, allowed, cure)]
