"""From a case to the meshes of its states, checked, measured and drawn."""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from jaxfsi import Mesh, Region
from jaxfsi.anatomy import Anatomy, centerline_point, plane_axes
from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import check_topology, mesh_quality, tet_quality, wall_thickness
from jaxfsi.meshing.build import build_mesh
from jaxfsi.meshing.check.section_areas import SectionAreas, section_areas
from jaxfsi.meshing.isolate import threads_of_children
from lumped.units import MM
from study.case.advice import nearest
from study.case.anatomy import MeshAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case, require
from study.run.anatomy_source import case_anatomy, case_mesh, states_of
from study.run.expected_times import MESH_SECONDS
from study.run.limits import AREA_BOUND, SEPTUM_BOUND
from study.run.mesh_pictures import aortic_axis, draw_mesh, label_colours
from study.run.progress import Progress
from study.run.refusal import file_fault
from study.store.json_form import ABSENT, from_json
from study.store.mesh_parts import (
    Histogram,
    LabelFaces,
    MeshFailure,
    MeshFidelity,
    MeshNote,
    MeshPart,
    MeshQuality,
    MeshSettings,
    Outlines,
    StateReport,
    Topology,
    VesselAreas,
)
from study.store.meshes import StateMesh, entry_key, load_mesh, store_mesh
from study.store.provenance import made_now

_Part = TypeVar("_Part")

_OUTLINES = 8
_ANGLE_EDGES = np.linspace(0.0, 90.0, 31)
_THICKNESS_BINS = 30


def planned_steps(case: Case, states: Sequence[str]) -> dict[str, float]:
    """Steps of meshing some states with the seconds that each usually takes."""
    return {
        f"{stage}, {state}": seconds[case.mesh.preset]
        for state in states
        for stage, seconds in MESH_SECONDS.items()
    }


def chosen_states(case: Case, names: Sequence[str] | None) -> list[str]:
    """States to mesh: the first where none is named, every one for `all`.

    Raises:
        CaseError: the case has no such state.
    """
    known = states_of(case)
    if not names:
        return list(known[:1])
    if "all" in names:
        return list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise CaseError([_unknown_state(case, unknown[0], "to mesh", ", or all")])
    return list(dict.fromkeys(names))


def chosen_state(case: Case, name: str | None) -> str:
    """The one state of a run: the first where none is named.

    Raises:
        CaseError: the case has no such state.
    """
    known = states_of(case)
    if name is None:
        return known[0]
    if name not in known:
        raise CaseError([_unknown_state(case, name, "to run; a run takes one state", "")])
    return name


def _unknown_state(case: Case, name: str, purpose: str, more: str) -> Fault:
    known = states_of(case)
    close, names = nearest(name, known), ", ".join(known)
    cure = f"write --state {close}" if close else f"choose from {names}{more}"
    return Fault(case.path, "", None, f"there is no state {name!r} {purpose}", names, cure)


def coarse(case: Case) -> Case:
    """The case with a coarse mesh, for a first look."""
    options = dataclasses.replace(case.mesh, preset="coarse", elements_across=None)
    return dataclasses.replace(case, mesh=options)


def coarse_mesh(
    case: Case, progress: Progress
) -> tuple[dict[str, StateMesh], MeshPart | MeshFailure]:
    """A coarse mesh of the first state and its part of a document.

    A mesh that cannot be made is no reason to lose what else was computed: the part then holds
    the reason. A finished mesh with faults is refused like any other input.

    Raises:
        CaseError: the case names a finished mesh that is refused.
    """
    case = coarse(case)
    try:
        require(case, "mesh")
        state = states_of(case)[0]
        meshes = {state: mesh_state(case, state, progress)}
    except (ValueError, RuntimeError, OSError) as error:
        if isinstance(error, CaseError) and isinstance(case.anatomy, MeshAnatomy):
            raise
        return {}, MeshFailure(" ".join(str(error).split()))
    return meshes, mesh_part(case, meshes)


def mesh_part(case: Case, states: Mapping[str, StateMesh]) -> MeshPart:
    """What stands in the document of any command that makes meshes."""
    reports = {name: made.report for name, made in states.items()}
    return MeshPart(case.mesh.preset, case.mesh.unit, mesh_notes(reports), reports)


def mesh_states(case: Case, states: Sequence[str], progress: Progress) -> dict[str, StateMesh]:
    """Mesh several states of a case, or take their meshes from the cache.

    Args:
        case: a case that fulfils the requirements of the command `mesh`.
        states: names out of `study.run.anatomy_source.states_of`.
        progress: told of each step.

    Raises:
        CaseError: the input is refused; nothing has been written.
        RuntimeError: a mesher failed on input that looked sound.
    """
    progress.plan(planned_steps(case, states))
    return {state: mesh_state(case, state, progress) for state in states}


def mesh_state(case: Case, state: str, progress: Progress) -> StateMesh:
    """Mesh one state of a case; see `mesh_states`."""
    key = entry_key(case, state)
    known = load_mesh(key)
    if known is not None:
        return known
    progress.step(f"reading the anatomy, {state}")
    anatomy: Anatomy | None = None
    if isinstance(case.anatomy, MeshAnatomy):
        mesh = case_mesh(case)
        progress.step(f"checking, {state}")
        report = _examined(mesh)
    else:
        anatomy = case_anatomy(case, state)
        mesh, report = _built(case, anatomy, state, progress)
    with threads_of_children(1) as pool:
        drawing = pool.submit(draw_mesh, mesh, anatomy)
        progress.step(f"measuring, {state}")
        sections, histograms = _sections(mesh, anatomy), _measured_histograms(case, mesh)
        progress.step(f"drawing, {state}")
        start = time.perf_counter()
        pictures, note = drawing.result()
        report["wall_time_s"]["drawing"] = time.perf_counter() - start
    found = StateReport(
        state=state,
        kind=case.anatomy.kind if case.anatomy is not None else "",
        settings=_known(MeshSettings, report["settings"]),
        topology=from_json(Topology, report["topology"]),
        quality=from_json(MeshQuality, report["quality"]),
        fidelity=_known(MeshFidelity, report["fidelity"]),
        wall_time_s=report["wall_time_s"],
        retries=report["retries"],
        openings=list(mesh.openings),
        labels=_labels(mesh),
        sections=sections,
        histograms=histograms,
        pictures=list(pictures),
        picture_note=note,
        notes=[*report["notes"], *_told(mesh)],
    )
    made = StateMesh(mesh, found, pictures, made_now())
    store_mesh(key, made)
    return made


def _told(mesh: Mesh) -> list[str]:
    """What reading its surface told of a mesh."""
    notes = mesh.meta.get("notes")
    return list(notes) if isinstance(notes, (list, tuple)) else []


def _known(kind: type[_Part], value: Any) -> _Part | None:
    """A part of a report; None where a finished mesh has none."""
    return None if value is None else from_json(kind, value)


def _built(
    case: Case, anatomy: Anatomy, state: str, progress: Progress
) -> tuple[Mesh, dict[str, Any]]:
    """Mesh an anatomy; a request that cannot be met is a fault of the case."""
    options = case.mesh
    try:
        result = build_mesh(
            anatomy,
            preset=options.preset,
            elements_across=options.elements_across,
            wall_layers=options.wall_layers,
            wedge_layers=options.wedge_layers,
            backend=options.backend,
            progress=lambda stage, _: progress.step(f"{stage}, {state}"),
        )
    except ValueError as error:
        raise CaseError([file_fault(case.path, error)]) from error
    return result.mesh, result.report.to_dict()


def _examined(mesh: Mesh) -> dict[str, Any]:
    """What a finished mesh is like; one with faults was refused on reading."""
    start = time.perf_counter()
    topology, quality = check_topology(mesh).to_dict(), mesh_quality(mesh).to_dict()
    return {
        "settings": None,
        "topology": topology,
        "quality": quality,
        "fidelity": None,
        "wall_time_s": {"checking": time.perf_counter() - start},
        "retries": [],
        "notes": [],
    }


def _labels(mesh: Mesh) -> dict[str, LabelFaces]:
    """Faces and colour in the pictures of each label."""
    colours = label_colours(mesh.label_names)
    return {
        name: LabelFaces(int(np.sum(mesh.face_label == i)), colours[name])
        for i, name in enumerate(mesh.label_names)
    }


def _sections(mesh: Mesh, anatomy: Anatomy | None) -> list[VesselAreas]:
    """Lumen areas along every vessel, asked for and meshed."""
    if anatomy is None or INTERFACE not in mesh.label_names:
        return []
    found = [section_areas(mesh, anatomy, vessel=vessel) for vessel in _vessels(anatomy)]
    found = [areas for areas in found if np.any(np.isfinite(areas.error))]
    return [_section(areas, anatomy, outlines=k == 0) for k, areas in enumerate(found)]


def _vessels(anatomy: Anatomy) -> list[str]:
    """Names of the vessels, the anomalous one first and the aorta last."""
    rank = {"anomalous": 0, "aorta": 2}
    return sorted(anatomy.centerlines, key=lambda name: rank.get(name, 1))


def _section(areas: SectionAreas, anatomy: Anatomy, *, outlines: bool) -> VesselAreas:
    """Areas along a vessel and, where asked for, the outlines at some places."""
    known = np.flatnonzero(np.isfinite(areas.error))
    places = np.linspace(0, len(known) - 1, _OUTLINES if outlines else 0)
    shown = known[np.unique(places.round().astype(int))]
    return VesselAreas(
        vessel=areas.vessel,
        s_mm=_list(areas.s[known] / MM),
        asked_mm2=_list(areas.asked[known] / MM**2),
        meshed_mm2=_list(areas.meshed[known] / MM**2),
        largest_error=float(areas.largest_error),
        open_places=int(len(areas.s) - len(known)),
        outlines=[_outlines(areas, anatomy, int(i)) for i in shown],
    )


def _outlines(areas: SectionAreas, anatomy: Anatomy, i: int) -> Outlines:
    """Both outlines of one place, turned so that the side away from the aorta is up."""
    point, tangent = centerline_point(anatomy.centerlines[areas.vessel], float(areas.s[i]))
    first, second = plane_axes(tangent)
    away = point - aortic_axis(anatomy, point, point - second)
    up = np.array([away @ first, away @ second])
    up /= max(float(np.linalg.norm(up)), 1e-12)
    turn = np.array([[up[1], up[0]], [-up[0], up[1]]])
    asked, meshed = (_pieces(outline @ turn) for outline in areas.outlines[i])
    return Outlines(float(areas.s[i] / MM), float(areas.error[i]), asked, meshed)


def _pieces(segments: np.ndarray) -> list[list[float]]:
    """Straight pieces as rows x0, y0, x1, y1 [mm]."""
    return [[float(f"{x:.4g}") for x in row] for row in (segments / MM).reshape(-1, 4)]


def _measured_histograms(case: Case, mesh: Mesh) -> dict[str, Histogram]:
    """The histograms of a mesh; a finished one whose wall cannot be measured is refused."""
    try:
        return _histograms(mesh)
    except ValueError as error:
        if isinstance(case.anatomy, MeshAnatomy):
            raise CaseError([file_fault(case.anatomy.places[0], error)]) from error
        raise


def _histograms(mesh: Mesh) -> dict[str, Histogram]:
    """Counts of the smallest dihedral angle by region, and of the thickness of the wall.

    Raises:
        ValueError: the wall has no thickness somewhere.
    """
    angles = {}
    for region in Region:
        tets = mesh.tets_of(region)
        if len(tets):
            values = tet_quality(mesh.points, tets).min_dihedral_deg
            counts, _ = np.histogram(values, _ANGLE_EDGES)
            angles[region.name.lower()] = counts.tolist()
    found = {"min_dihedral_deg": Histogram(_ANGLE_EDGES.tolist(), angles)}
    if np.any(mesh.region == Region.SOLID) and INTERFACE in mesh.label_names:
        measured = wall_thickness(mesh)
        parts = {"wall": measured.of_wall / MM, "septum": measured.of_septum / MM}
        parts = {name: values for name, values in parts.items() if len(values)}
        for name, values in parts.items():
            bad = ~(np.isfinite(values) & (values > 0.0))
            if np.any(bad):
                raise ValueError(
                    f"the {name} has no thickness at {np.sum(bad)} of {len(bad)} places. Check"
                    " that blood and wall are not exchanged, and mesh the wall anew."
                )
        top = max((np.percentile(values, 97.0) for values in parts.values()), default=1.0)
        edges = np.linspace(0.0, 1.1 * top, _THICKNESS_BINS + 1)
        found["thickness_mm"] = Histogram(
            _list(edges),
            {name: np.histogram(values, edges)[0].tolist() for name, values in parts.items()},
        )
    return found


def _list(values: np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]


def mesh_notes(states: Mapping[str, StateReport]) -> list[MeshNote]:
    """What looks wrong or needs care in some meshes, the warnings first."""
    notes = []
    for name, report in states.items():
        notes += [MeshNote(level, f"{name}: {text}") for level, text in _remarks(report)]
    return sorted(notes, key=lambda note: note.level != "warning")


def _remarks(report: StateReport) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for fault in report.topology.faults:
        found.append(("warning", f"{fault.where}: {fault.what}. {fault.cure}."))
    for section in report.sections:
        if section.largest_error > AREA_BOUND:
            found.append(
                (
                    "warning",
                    f"the lumen of {section.vessel} misses the area asked for by up to"
                    f" {100 * section.largest_error:.1f} %. Use a finer preset, or ask for more"
                    " elements across the lumen.",
                )
            )
    septum = report.fidelity and report.fidelity.septum_ratio
    if septum:
        worst = max(abs(septum.p1 - 1.0), abs(septum.p99 - 1.0))
        if worst > SEPTUM_BOUND:
            found.append(
                (
                    "warning",
                    f"the tissue between the lumens misses the thickness asked for by up to"
                    f" {100 * worst:.0f} % (98 % of places). Use a finer preset.",
                )
            )
    for why in report.retries:
        found.append(("info", f"meshed again with finer settings, because {why}"))
    if report.notes is not ABSENT:
        found += [("warning", note) for note in report.notes]
    if report.picture_note:
        found.append(("info", report.picture_note))
    return found
