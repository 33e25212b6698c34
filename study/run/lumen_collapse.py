"""The collapse of a lumen in the words of a result: when, where along the artery, how narrow."""

import math

from jaxfsi import Mesh
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields.lumen_sections import section_near
from jaxfsi.simulation import Collapse
from lumped.units import MM
from study.case.anatomy import MeshAnatomy
from study.case.model import Case
from study.run.anatomy_source import case_anatomy
from study.run.simulation_data import LumenCollapse


def located(found: Collapse, mesh: Mesh, anatomy: Anatomy | None) -> LumenCollapse:
    """A collapse with its place along the artery.

    Args:
        found: the collapse.
        mesh: the mesh of the run.
        anatomy: what it was made of; None where that is not known.
    """
    section = None if anatomy is None else section_near(mesh, anatomy, found.place, found.d)
    s, share = (None, math.nan) if section is None else section
    return LumenCollapse(
        t_s=found.t,
        point_mm=[float(x) / MM for x in found.point],
        from_ostium_mm=None if s is None else s / MM,
        area_share=share if math.isfinite(share) else None,
        volume_share=found.volume_ratio,
    )


def anatomy_of(case: Case, state: str | None = None) -> Anatomy | None:
    """The anatomy of a case; None where it names a finished mesh or none."""
    if case.anatomy is None or isinstance(case.anatomy, MeshAnatomy):
        return None
    return case_anatomy(case, state)
