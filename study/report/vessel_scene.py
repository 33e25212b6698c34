"""The data of the page of a vessel, from the frames of its runs."""

import dataclasses
import pathlib
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from jaxfsi import Mesh
from jaxfsi.adjoint.lumen_shape import LumenSurface, lumen_surface
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import read_series
from jaxfsi.fields.lumen_cycle import LumenCycle, lumen_cycle, mean_pressure
from jaxfsi.fields.pullback import SectionSeries, pullback
from jaxfsi.opening import ANOMALOUS, INLET, OUTLET, distal_name, inlet_name
from jaxfsi.simulation.cycles import CycleMeans
from lumped import MM
from study.case.laws import FIBRES
from study.case.model import Case
from study.report.packed_array import PackedArray, pack, unpacked
from study.report.pictures import picture_text
from study.report.sensitivity_part import places_along
from study.report.vessel_data import (
    VESSEL_FORMAT,
    LumenShape,
    SectionCourse,
    VesselData,
    VesselSections,
    VesselView,
)
from study.report.vessel_picture import LookedAt, PulledBack, lumen_picture
from study.run.limits import FFR_THRESHOLD
from study.run.mesh_pictures import aortic_axis

_POINT_MM, _MOVED_MM, _PLACE_MM = 0.002, 0.001, 0.02
_P_MMHG, _RATIO, _AREA_MM2, _SHARE = 0.02, 1e-6, 1e-3, 1e-3
_WIDER_STEPS = 2**12
_STILL_MM = 1e-6
_MPA = 1e7  # dyn/cm²
_MATERIALS = {
    "linear": "linear",
    "saint_venant_kirchhoff": "St. Venant-Kirchhoff",
    "neo_hookean": "neo-Hookean",
    FIBRES: "fibres (Holzapfel-Gasser-Ogden)",
}
_ROOM = 1.0
"""Half of a view's height over the reach of what it shows."""


@dataclasses.dataclass(frozen=True)
class ShownRun:
    """A run that the page shows.

    Attributes:
        id: its id.
        condition: name of the condition.
        rule: stress rule; None where there is none.
        outlet: the scale of its resistances, in words.
        wall: the wall, in words.
        ratio_name: `ffr`, or `rest_ratio`.
        measured: measured ratio.
        cycle: the cycle that is shown.
        ratio: its ratio [-].
        period: length of a cycle [s].
        series: PVD file of its frames.
        site: times [s] and pressures [mmHg] at the ostium; None: not read.
        wider: change of the ratio per shift outwards and area of the lumen [1/cm³].
    """

    id: str
    condition: str
    rule: str | None
    outlet: str
    wall: str
    ratio_name: str
    measured: float | None
    cycle: CycleMeans
    ratio: float
    period: float
    series: pathlib.Path
    site: tuple[Float[np.ndarray, " frames"], Float[np.ndarray, " frames"]] | None = None
    wider: Float[np.ndarray, " nodes"] | None = None


def vessel_data(
    patient: str, mesh: Mesh, anatomy: Anatomy | None, runs: Iterable[ShownRun]
) -> VesselData | None:
    """The data of the page.

    Args:
        patient: name of the patient.
        mesh: the mesh of all runs.
        anatomy: its anatomy; None: the artery has no axis, so that there is no pull-back.
        runs: the runs, the one to be shown first last.

    Returns:
        None where no run has a frame of finite numbers.
    """
    shape, views = None, []
    for run in runs:
        entries = read_series(run.series)
        cycle = lumen_cycle(run.series.parent, entries, mesh, run.period)
        if cycle is None or not (np.isfinite(cycle.P).all() and np.isfinite(cycle.moved).all()):
            continue
        planes = None if anatomy is None else pullback(mesh, anatomy, cycle)
        if shape is None:
            shape = vessel_shape(mesh, anatomy, planes)
        begin = entries[-1].t - cycle.t[-1]
        views.append(vessel_view(run, cycle, planes, mesh, anatomy, begin, shape))
    if shape is None:
        return None
    return VesselData(VESSEL_FORMAT, patient, FFR_THRESHOLD, [shape], views)


def vessel_shape(mesh: Mesh, anatomy: Anatomy | None, planes: SectionSeries | None) -> LumenShape:
    """The lumen in the reference shape, and how it is looked at first."""
    surface = lumen_surface(mesh)
    s = _node_places(surface, anatomy)
    chosen = surface.points[s >= 0.0] if np.any(s >= 0.0) else surface.points
    low, high = chosen.min(axis=0), chosen.max(axis=0)
    focus = 0.5 * (low + high)
    up = _upright(mesh)
    middle = 0.5 * (surface.points.min(axis=0) + surface.points.max(axis=0))
    toward = focus - aortic_axis(anatomy, focus, middle)
    toward = _unit(toward - (toward @ up) * up, np.cross(up, [0.6, 0.8, 0.0]))
    return LumenShape(
        points_mm=pack(surface.points / MM, _POINT_MM),
        triangles=pack(surface.triangles, 1.0),
        node_s_mm=pack(s, _PLACE_MM),
        sections=None if planes is None else _sections(planes),
        focus_mm=_rounded(focus / MM, 3),
        toward=_rounded(toward, 4),
        up=_rounded(up, 4),
        half_mm=round(_ROOM * float(np.linalg.norm(chosen - focus, axis=1).max()) / MM, 2),
    )


def vessel_view(
    run: ShownRun,
    cycle: LumenCycle,
    planes: SectionSeries | None,
    mesh: Mesh,
    anatomy: Anatomy | None,
    begin: float,
    shape: LumenShape,
) -> VesselView:
    """What happens on the lumen over the cycle of a run.

    Args:
        run: the run.
        cycle: the lumen over it.
        planes: across the artery.
        mesh: its mesh.
        anatomy: its anatomy.
        begin: start of the cycle [s].
        shape: the lumen, for the picture.
    """
    names = tuple(run.cycle.ports)
    inlet, distal = inlet_name(names), distal_name(names)
    assert distal is not None, "a run with a ratio has a distal outlet"
    ends = [(name, run.cycle.ports[name].mean_P_mmHg) for name in (inlet, distal)]
    P_distal = ends[1][1]
    P_aorta = P_distal / run.ratio
    ratio = mean_pressure(cycle, *ends) / P_aorta
    aortic = cycle.P_openings[inlet]
    if run.site is not None:
        aortic = np.interp(begin + cycle.t, *run.site)
    moves = float(np.abs(cycle.moved).max()) / MM > _STILL_MM
    along = None if planes is None else planes.read(ratio, cycle.points)
    return VesselView(
        id=run.id,
        shape=0,
        condition=run.condition,
        rule=run.rule,
        outlet=run.outlet,
        wall=run.wall,
        ratio_name=run.ratio_name,
        ratio=run.ratio if run.cycle.complete else None,
        measured=run.measured,
        whole=cycle.whole,
        period_s=run.period,
        P_aorta_mean_mmHg=P_aorta,
        P_distal_mean_mmHg=P_distal,
        distal_s_mm=_distal_place(mesh, anatomy, distal),
        t_s=_rounded(cycle.t, 6),
        P_aorta_mmHg=_rounded(aortic, 3),
        P_distal_mmHg=_rounded(cycle.P_openings[distal], 3),
        node_ratio=pack(ratio, _RATIO),
        least_ratio=round(float(ratio.min()), 6),
        node_P_mmHg=pack(cycle.P, _P_MMHG),
        moved_mm=pack(cycle.moved / MM, _MOVED_MM) if moves else None,
        sections=None if planes is None or along is None else _course(planes, cycle, along),
        wider_per_mm3=None if run.wider is None else _packed_density(run.wider * MM**3),
        picture=picture_text(_picture(run, cycle, ratio, shape, planes, along)),
    )


def _picture(
    run: ShownRun,
    cycle: LumenCycle,
    ratio: np.ndarray,
    shape: LumenShape,
    planes: SectionSeries | None,
    along: np.ndarray | None,
) -> bytes:
    """The lumen at the pressure of the image, as a picture."""
    focus, toward, up = (np.array(v) for v in (shape.focus_mm, shape.toward, shape.up))
    view = LookedAt(focus, toward, up, shape.half_mm)
    curve = None if planes is None or along is None else PulledBack(planes.s / MM, along)
    called = "FFR" if run.ratio_name == "ffr" else "resting Pd/Pa"
    title = f"{run.condition}, {run.outlet}, wall: {run.wall}; {called} {run.ratio:.3f}"
    beside = unpacked(shape.node_s_mm) < 0.0
    beside &= not np.all(beside)
    surface = (cycle.points / MM, cycle.triangles, ratio, beside)
    return lumen_picture(*surface, view, title, FFR_THRESHOLD, curve)


def wall_words(case: Case, *, rigid: bool) -> str:
    """The wall of a run in words."""
    if rigid:
        return "rigid"
    return f"{_MATERIALS[case.wall.material]}, {case.wall.E / _MPA:g} MPa"


def _sections(planes: SectionSeries) -> VesselSections:
    rings = planes.rings
    low, high, share = (np.concatenate([ring[i] for ring in rings]) for i in range(3))
    return VesselSections(
        s_mm=_rounded(planes.s / MM, 4),
        area_image_mm2=_rounded(np.nan_to_num(planes.area_image) / MM**2, 4),
        minor_image_mm=_rounded(np.nan_to_num(planes.minor_image) / MM, 4),
        ring_sizes=[len(ring.low) for ring in rings],
        ring_low=pack(low, 1.0),
        ring_high=pack(high, 1.0),
        ring_share=pack(share, _SHARE),
    )


def _course(planes: SectionSeries, cycle: LumenCycle, ratio: np.ndarray) -> SectionCourse:
    return SectionCourse(
        ratio=_rounded(ratio, 6),
        P_mmHg=pack(planes.read(cycle.P, cycle.points), _P_MMHG),
        area_mm2=pack(np.nan_to_num(planes.area) / MM**2, _AREA_MM2),
        minor_mm=pack(np.nan_to_num(planes.minor) / MM, _AREA_MM2),
    )


def _node_places(surface: LumenSurface, anatomy: Anatomy | None) -> Float[np.ndarray, " nodes"]:
    """Distance of each node from the ostium [mm]; -1 elsewhere."""
    s = np.full(len(surface.nodes), -1.0)
    found = None if anatomy is None else places_along(surface, anatomy)
    if found is not None:
        s[found[0]] = found[1]
    return s


def _distal_place(mesh: Mesh, anatomy: Anatomy | None, distal: str) -> float | None:
    line = None if anatomy is None else anatomy.centerlines.get(ANOMALOUS)
    if line is None:
        return None
    centre = mesh.points[mesh.labelled(distal)].mean(axis=(0, 1))
    nearest = np.argmin(np.linalg.norm(line.points - centre, axis=1))
    return float(line.s[nearest]) / MM


def _upright(mesh: Mesh) -> Float[np.ndarray, " 3"]:
    if not {INLET, OUTLET} <= set(mesh.label_names):
        return np.array([0.0, 0.0, 1.0])
    below, above = (mesh.points[mesh.labelled(n)].mean(axis=(0, 1)) for n in (INLET, OUTLET))
    return _unit(above - below, np.array([0.0, 0.0, 1.0]))


def _packed_density(values: Float[np.ndarray, " nodes"]) -> PackedArray:
    return pack(values, max(float(np.ptp(values)) / _WIDER_STEPS, 1e-12))


def _unit(vector: np.ndarray, fallback: np.ndarray) -> Float[np.ndarray, " 3"]:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-9 else fallback / np.linalg.norm(fallback)


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]
