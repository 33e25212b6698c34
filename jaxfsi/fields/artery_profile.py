"""Pressure and lumen along the anomalous artery, averaged over the last cycle of a run.

A plane across the artery is carried along by the wall. It cuts the tetrahedra of the blood in
triangles and quadrilaterals, on which the pressure is linear; the mean over those within the
outline of the lumen is

    P(s) = Σ A_i p̄_i / Σ A_i,

with p̄_i the mean of the corners of a triangle. Means over time are by the trapezoidal rule.
"""

import dataclasses
import pathlib
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy import Anatomy, centerline_point
from jaxfsi.anatomy.sections import measured_section, plane_axes, surface_ring
from jaxfsi.fields.frame_arrays import frame_arrays
from jaxfsi.fields.lumen_sections import Planes
from jaxfsi.fields.series import Entry
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.opening import ANOMALOUS
from jaxfsi.polygons import inside_polygon

PLACES, MOST_FRAMES = 40, 21
_NEAR = 24


@dataclasses.dataclass(frozen=True)
class ArteryProfile:
    """What a catheter that is pulled back would show, from the ostium on.

    Attributes:
        s: distance from the ostium along the axis [cm].
        points: the axis in the reference shape [cm].
        P: mean pressure over section and cycle [mmHg]; nan where a plane finds no lumen.
        P_aorta: mean aortic pressure over the same times [mmHg].
        area: mean area of the lumen [cm²].
        least_area: least area in the cycle [cm²].
        least_minor: least minor axis in the cycle [cm].
        image_area: area in the reference shape [cm²].
        image_minor: minor axis there [cm].
        moved: mean displacement of the nodes of the mesh [cm].
        P_nodes: mean pressure at the nodes of the mesh [mmHg]; nan within the wall.
    """

    s: Float[np.ndarray, " places"]
    points: Float[np.ndarray, "places 3"]
    P: Float[np.ndarray, " places"]
    P_aorta: float
    area: Float[np.ndarray, " places"]
    least_area: Float[np.ndarray, " places"]
    least_minor: Float[np.ndarray, " places"]
    image_area: Float[np.ndarray, " places"]
    image_minor: Float[np.ndarray, " places"]
    moved: Float[np.ndarray, "nodes 3"]
    P_nodes: Float[np.ndarray, " nodes"]

    @property
    def ratio(self) -> Float[np.ndarray, " places"]:
        """Mean pressure over the mean aortic pressure [-]."""
        return self.P / self.P_aorta


def course_planes(anatomy: Anatomy, n_places: int = PLACES) -> Planes | None:
    """Planes across the artery from its ostium to near its end; None where it has no axis."""
    line = anatomy.centerlines.get(ANOMALOUS)
    if line is None:
        return None
    s = np.linspace(0.01, 0.99, n_places) * float(line.s[-1])
    places = [centerline_point(line, float(x)) for x in s]
    return Planes(s, np.array([p for p, _ in places]), np.array([t for _, t in places]))


def section_values(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    tets: Int[np.ndarray, "tets 4"],
    values: Float[np.ndarray, " nodes"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> tuple[float, float, float]:
    """Mean of a linear field over a section of the lumen, its area [cm²] and minor axis [cm].

    Args:
        points: nodes [cm].
        triangles: of the surface of the lumen, all with the same sense.
        tets: tetrahedra of the blood near the plane.
        values: of the field at the nodes.
        centre: point of the plane within the lumen [cm].
        normal: of the plane.

    Raises:
        ValueError: no part of the surface closes round the centre.
    """
    ring = surface_ring(points, triangles, centre, normal)
    low, high = points[ring.low], points[ring.high]
    first, second = plane_axes(normal)
    across = np.stack([first, second], axis=1)
    outline = (low + ring.share[:, None] * (high - low) - centre) @ across
    section = measured_section(np.stack([outline, np.roll(outline, -1, axis=0)], axis=1))
    corners, found = _cut(points, tets, values, centre, normal)
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    inside = inside_polygon((corners.mean(axis=1) - centre) @ across, outline)
    total = float(area[inside].sum())
    if total <= 0.0:
        raise ValueError("the plane cuts no blood within the lumen. Move its centre inside.")
    mean = float((area * found.mean(axis=1))[inside].sum() / total)
    return mean, section.area, section.minor


def _cut(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    values: Float[np.ndarray, " nodes"],
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "pieces 3 3"], Float[np.ndarray, "pieces 3"]]:
    """Triangles in which a plane cuts tetrahedra, and the field at their corners."""
    height = (points - centre) @ (normal / np.linalg.norm(normal))
    height = np.where(height == 0.0, np.finfo(float).tiny, height)
    above = height[tets] > 0.0
    count = above.sum(axis=1)
    # nodes above the plane first; a single one of its side leads
    order = np.argsort(~above, axis=1, kind="stable")
    nodes = np.take_along_axis(tets, order, axis=1)
    pieces = []
    for number, edges in (
        (1, ((0, 1), (0, 2), (0, 3))),
        (3, ((3, 0), (3, 1), (3, 2))),
        (2, ((0, 2), (0, 3), (1, 3))),
        (2, ((0, 2), (1, 3), (1, 2))),
    ):
        own = nodes[count == number]
        ends = np.array([[own[:, a], own[:, b]] for a, b in edges])  # edges, ends, tets
        share = height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]])
        where = points[ends[:, 0]] + share[..., None] * (points[ends[:, 1]] - points[ends[:, 0]])
        field = values[ends[:, 0]] + share * (values[ends[:, 1]] - values[ends[:, 0]])
        pieces.append((where.transpose(1, 0, 2), field.T))
    return np.concatenate([p for p, _ in pieces]), np.concatenate([f for _, f in pieces])


def artery_profile(
    folder: pathlib.Path,
    entries: Sequence[Entry],
    mesh: Mesh,
    anatomy: Anatomy,
    period: float,
    aorta: tuple[Float[np.ndarray, " times"], Float[np.ndarray, " times"]],
) -> ArteryProfile | None:
    """Pressure and lumen along the artery over the last cycle of a run.

    Args:
        folder: of the fields.
        entries: frames of the run.
        mesh: its mesh.
        anatomy: its anatomy.
        period: length of a cycle [s].
        aorta: times [s] and aortic pressures [mmHg] of the run.

    Returns:
        None where there is no axis, or no frame.
    """
    planes = course_planes(anatomy)
    if planes is None or not entries or INTERFACE not in mesh.label_names:
        return None
    frames = [e for e in entries if e.t >= entries[-1].t - period * (1.0 + 1e-6)]
    chosen = np.unique(np.linspace(0, len(frames) - 1, MOST_FRAMES).round().astype(int))
    frames = [frames[k] for k in chosen]
    t = np.array([entry.t for entry in frames])
    weight = _weights(t)
    triangles = mesh.labelled(INTERFACE)
    surface = np.unique(triangles)
    fluid = mesh.tets[mesh.region == Region.FLUID]
    around = _around(mesh.points, fluid, surface, planes)
    still = np.zeros_like(mesh.points)
    image, _ = _sections(mesh.points, triangles, around, planes, still, np.zeros(len(still)))
    moved, P_nodes = still.copy(), np.zeros(len(still))
    found = []
    for entry, part in zip(frames, weight, strict=True):
        arrays = frame_arrays(folder / entry.file, ("displacement_cm", "pressure_mmHg"))
        shift = arrays["displacement_cm"].reshape(-1, 3).astype(float)
        P = arrays["pressure_mmHg"].astype(float)
        moved += part * shift
        P_nodes += part * P
        lumen, pressure = _sections(mesh.points, triangles, around, planes, shift, P)
        found.append((pressure, *lumen))
    P, area, minor = (np.array(values) for values in zip(*found, strict=True))
    return ArteryProfile(
        s=planes.s, points=planes.centre, P=weight @ P,
        P_aorta=float(weight @ np.interp(t, *aorta)),
        area=weight @ area, least_area=area.min(axis=0), least_minor=minor.min(axis=0),
        image_area=image[0], image_minor=image[1], moved=moved, P_nodes=P_nodes,
    )  # fmt: skip


def _weights(t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Weights of the trapezoidal rule, with sum one."""
    if t.size < 2:
        return np.ones(t.size)
    steps = np.diff(t)
    found = np.concatenate([steps, [0.0]]) + np.concatenate([[0.0], steps])
    return found / found.sum()


def _around(
    points: np.ndarray, fluid: np.ndarray, surface: np.ndarray, planes: Planes
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each plane, nodes of the lumen nearest to it and tetrahedra of the blood near it."""
    middle, found = points[fluid].mean(axis=1), []
    for centre in planes.centre:
        distance = np.linalg.norm(points[surface] - centre, axis=1)
        order = np.argsort(distance)
        reach = 4.0 * distance[order[min(_NEAR, order.size) - 1]] + 0.2
        near = np.linalg.norm(middle - centre, axis=1) < reach
        found.append((surface[order[:_NEAR]], fluid[near]))
    return found


def _sections(
    points: np.ndarray,
    triangles: np.ndarray,
    around: Sequence[tuple[np.ndarray, np.ndarray]],
    planes: Planes,
    moved: np.ndarray,
    values: np.ndarray,
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Area, minor axis, and mean of a field in each plane; nan where there is no lumen."""
    area, minor, mean = (np.full(len(planes.s), np.nan) for _ in range(3))
    now = points + moved
    for i, (centre, normal) in enumerate(zip(planes.centre, planes.normal, strict=True)):
        nodes, tets = around[i]
        try:
            mean[i], area[i], minor[i] = section_values(
                now, triangles, tets, values, centre + moved[nodes].mean(axis=0), normal
            )
        except ValueError:
            continue
    return (area, minor), mean
