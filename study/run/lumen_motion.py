"""The lumen of the anomalous artery over a cycle: area and minor axis of planes across it.

Each plane is carried along by the wall around it and cuts the deformed interface. What the stress
of the wall is there, and where the lumen is narrowest, comes with it.
"""

import pathlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi import Mesh, read_ivus_contours
from jaxfsi.anatomy import Anatomy, centerline_point
from jaxfsi.anatomy.sections import surface_section
from jaxfsi.fields import Entry
from jaxfsi.mesh import INTERFACE, Region
from jaxfsi.mesh_files.vtk_xml import open_vtk_xml, read_array
from lumped import MM
from study.case.anatomy import IvusAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case

VESSEL = "anomalous"
_PLACES = 16
_REACH = 1.3
"""Length of the looked-at course where the anatomy does not say it [cm]."""
_MM2 = MM**2
_KPA = 1.0e4  # dyn/cm²


class Planes(NamedTuple):
    """Planes across the artery in the reference shape.

    Attributes:
        s: distance from the ostium along the axis [cm].
        centre: points [cm].
        normal: unit tangents of the axis.
    """

    s: Float[np.ndarray, " places"]
    centre: Float[np.ndarray, "places 3"]
    normal: Float[np.ndarray, "places 3"]


def frame_arrays(path: pathlib.Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Some arrays of a written frame, by name."""
    file = open_vtk_xml(path, "UnstructuredGrid")
    found = {}
    for element in file.root.iter("DataArray"):
        name = element.get("Name", "")
        if name in names:
            found[name] = read_array(file, element)
    return found


def artery_planes(anatomy: Anatomy, *, n_places: int = _PLACES) -> Planes | None:
    """Planes from the ostium along the intramural course; at the frames where it has contours.

    None where the anatomy has no axis of the artery.
    """
    line = anatomy.centerlines.get(VESSEL)
    if line is None:
        return None
    frames = anatomy.meta.get("s_frames")
    if frames is not None:
        s = np.asarray(frames, float)
    else:
        s = np.linspace(0.08, min(_REACH, float(line.s[-1]) * 0.9), n_places)
    places = [centerline_point(line, float(x)) for x in s]
    return Planes(s, np.array([p for p, _ in places]), np.array([t for _, t in places]))


def lumen_at(
    mesh: Mesh, planes: Planes, moved: Float[np.ndarray, "nodes 3"]
) -> tuple[Float[np.ndarray, " places"], Float[np.ndarray, " places"]]:
    """Area [cm²] and minor axis [cm] of the deformed lumen in each plane; nan where there is none.

    Args:
        mesh: the mesh in its reference shape.
        planes: the planes there.
        moved: displacement of the nodes [cm].
    """
    triangles = mesh.labelled(INTERFACE)
    nodes = np.unique(triangles)
    area, minor = np.full(len(planes.s), np.nan), np.full(len(planes.s), np.nan)
    for i, (centre, normal) in enumerate(zip(planes.centre, planes.normal, strict=True)):
        near = nodes[np.argsort(np.linalg.norm(mesh.points[nodes] - centre, axis=1))[:24]]
        shift = moved[near].mean(axis=0)
        try:
            found = surface_section(mesh.points + moved, triangles, centre + shift, normal)
        except ValueError:
            continue
        area[i], minor[i] = found.area, found.minor
    return area, minor


def lumen_motion(
    folder: pathlib.Path, entries: Sequence[Entry], mesh: Mesh, anatomy: Anatomy, period: float
) -> dict[str, Any] | None:
    """Lumen and wall over the last cycle of a run, as the document holds them.

    Args:
        folder: of the fields.
        entries: frames of the run.
        mesh: its mesh.
        anatomy: its anatomy.
        period: length of a cycle [s].

    Returns:
        None where there is no axis, no wall or no frame.
    """
    planes = artery_planes(anatomy)
    solid = mesh.region == Region.SOLID
    if planes is None or not entries or not np.any(solid):
        return None
    last = entries[-1].t
    frames = [e for e in entries if e.t >= last - period * (1.0 + 1e-6)]
    area, minor, stress = [], [], []
    around = _around(mesh, planes)[solid]
    rest_area, rest_minor = lumen_at(mesh, planes, np.zeros_like(mesh.points))
    for entry in frames:
        arrays = frame_arrays(folder / entry.file, ("displacement_cm", "von_mises_dyn_per_cm2"))
        found = lumen_at(mesh, planes, arrays["displacement_cm"].reshape(-1, 3).astype(float))
        area.append(found[0])
        minor.append(found[1])
        stress.append(float(np.percentile(arrays["von_mises_dyn_per_cm2"][solid][around], 99.0)))
    areas = np.array(area) / _MM2
    good = np.all(np.isfinite(areas), axis=0)
    if not np.any(good):
        return None
    narrowest = int(np.nanargmin(np.where(good, np.min(areas, axis=0), np.nan)))
    course = areas[:, narrowest]
    return {
        "t_s": [float(e.t - frames[0].t) for e in frames],
        "s_mm": _numbers(planes.s / MM),
        "area_image_mm2": _numbers(rest_area / _MM2),
        "minor_image_mm": _numbers(rest_minor / MM),
        "area_mm2": [_numbers(row) for row in areas],
        "minor_mm": [_numbers(row) for row in np.array(minor) / MM],
        "narrowest": narrowest,
        "narrowest_s_mm": float(planes.s[narrowest] / MM),
        "least_area_mm2": float(course.min()),
        "largest_area_mm2": float(course.max()),
        "area_change": float(1.0 - course.min() / course.max()),
        "von_mises_p99_kPa": [value / _KPA for value in stress],
    }


def _around(mesh: Mesh, planes: Planes) -> np.ndarray:
    """Which tetrahedra lie around the planes."""
    middle = mesh.points[mesh.tets].mean(axis=1)
    reach = 0.35  # cm
    found = np.zeros(len(middle), bool)
    for centre in planes.centre:
        found |= np.linalg.norm(middle - centre, axis=1) < reach
    return found


def _numbers(values: np.ndarray) -> list[float | None]:
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]


def measured_states(case: Case) -> dict[str, dict[str, Any]]:
    """Area and minor axis along the artery of every state that the case has contours of.

    Empty where the anatomy is no ultrasound record.

    Raises:
        CaseError: contours cannot be read.
    """
    if not isinstance(case.anatomy, IvusAnatomy):
        return {}
    found = {}
    for name, state in case.anatomy.states.items():
        try:
            lumen = read_ivus_contours(state.contours, frame_table=state.frame_table)
        except ValueError as error:
            problem = str(error).removeprefix(f"{state.contours}: ")
            raise CaseError([Fault(state.contours, "", None, problem, "", "correct it")]) from error
        found[name] = {
            "s_mm": _numbers(np.asarray(lumen.s) / MM),
            "area_mm2": _numbers(np.asarray(lumen.area) / _MM2),
            "minor_mm": _numbers(np.asarray(lumen.calipers.minor) / MM),
        }
    return found
