"""The lumen of the anomalous artery over a cycle: area and minor axis of planes across it.

Each plane is carried along by the wall around it and cuts the deformed interface. What the stress
of the wall is there, and where the lumen is narrowest, comes with it.
"""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy import Anatomy, centerline_point
from jaxfsi.anatomy.sections import surface_section
from jaxfsi.fields.frame_arrays import frame_arrays
from jaxfsi.fields.series import Entry
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.opening import ANOMALOUS

_PLACES = 16
_REACH = 1.3
"""Length of the looked-at course where the anatomy does not say it [cm]."""


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


def artery_planes(anatomy: Anatomy, *, n_places: int = _PLACES) -> Planes | None:
    """Planes from the ostium along the intramural course; at the frames where it has contours.

    None where the anatomy has no axis of the artery.
    """
    line = anatomy.centerlines.get(ANOMALOUS)
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


def section_near(
    mesh: Mesh,
    anatomy: Anatomy,
    place: Float[np.ndarray, " 3"],
    moved: Float[np.ndarray, "nodes 3"],
) -> tuple[float, float] | None:
    """Distance from the ostium [cm] of the section of the artery at a place, and what it kept.

    Args:
        mesh: the mesh in its reference shape.
        anatomy: its anatomy.
        place: a point in the lumen in the reference shape [cm].
        moved: displacement of the nodes [cm].

    Returns:
        Also the area of the section over that in the reference shape [-], nan where the deformed
        lumen has none; None where the anatomy has no axis of the artery or the place lies beyond
        its ends or outside of it.
    """
    line = anatomy.centerlines.get(ANOMALOUS)
    if line is None:
        return None
    nearest = int(np.argmin(np.linalg.norm(line.points - place, axis=1)))
    s = float(line.s[nearest])
    centre, normal = centerline_point(line, s)
    planes = Planes(np.array([s]), centre[None], normal[None])
    before, _ = lumen_at(mesh, planes, np.zeros_like(mesh.points))
    reach = float(np.sqrt(before[0]))
    if nearest in (0, len(line.s) - 1) or not np.linalg.norm(place - centre) < 2.0 * reach:
        return None
    after, _ = lumen_at(mesh, planes, moved)
    return s, float(after[0] / before[0])


@dataclasses.dataclass(frozen=True)
class LumenMotion:
    """Lumen and wall of an artery over the last cycle of a run.

    Attributes:
        t: times of the frames from the start of the cycle [s].
        s: distance of each plane from the ostium [cm].
        area_image: area of the lumen in the reference shape [cm²].
        minor_image: its minor axis there [cm].
        area: area in each frame [cm²]; nan where a plane finds no lumen.
        minor: minor axis in each frame [cm].
        narrowest: index of the plane with the least area.
        von_mises_p99: 99th percentile of the von Mises stress around the planes [dyn/cm²].
    """

    t: Float[np.ndarray, " frames"]
    s: Float[np.ndarray, " places"]
    area_image: Float[np.ndarray, " places"]
    minor_image: Float[np.ndarray, " places"]
    area: Float[np.ndarray, "frames places"]
    minor: Float[np.ndarray, "frames places"]
    narrowest: int
    von_mises_p99: Float[np.ndarray, " frames"]


def lumen_motion(
    folder: pathlib.Path, entries: Sequence[Entry], mesh: Mesh, anatomy: Anatomy, period: float
) -> LumenMotion | None:
    """Lumen and wall over the last cycle of a run.

    Args:
        folder: of the fields.
        entries: frames of the run.
        mesh: its mesh.
        anatomy: its anatomy.
        period: length of a cycle [s].

    Returns:
        None where there is no axis, no wall or no frame, or where no plane finds the lumen in
        every frame.
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
    areas = np.array(area)
    good = np.all(np.isfinite(areas), axis=0)
    if not np.any(good):
        return None
    narrowest = int(np.nanargmin(np.where(good, np.min(areas, axis=0), np.nan)))
    return LumenMotion(
        t=np.array([e.t - frames[0].t for e in frames]),
        s=planes.s,
        area_image=rest_area,
        minor_image=rest_minor,
        area=areas,
        minor=np.array(minor),
        narrowest=narrowest,
        von_mises_p99=np.array(stress),
    )


def _around(mesh: Mesh, planes: Planes) -> np.ndarray:
    """Which tetrahedra lie around the planes."""
    middle = mesh.points[mesh.tets].mean(axis=1)
    reach = 0.35  # cm
    found = np.zeros(len(middle), bool)
    for centre in planes.centre:
        found |= np.linalg.norm(middle - centre, axis=1) < reach
    return found
