"""What to look at in a mesh, and its pictures; a machine that cannot draw still gets the rest."""

import importlib.util
import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi import Mesh
from jaxfsi.anatomy import Anatomy, Centerline, centerline_point
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Region
from jaxfsi.meshing import Exit, wall_thickness
from jaxfsi.meshing.isolate import MeshingError, NativeCall, run_isolated

LABEL_COLOURS = {
    INTERFACE: "#c8443a",
    OUTER_WALL: "#e6cfa8",
    "aorta_inlet": "#1f6fb2",
    "aorta_outlet": "#4aa3c7",
    "anomalous_outlet": "#5a8f3c",
    "normal_outlet": "#8e6bb5",
    f"aorta_inlet{RING_SUFFIX}": "#123f66",
    f"aorta_outlet{RING_SUFFIX}": "#27627a",
    f"anomalous_outlet{RING_SUFFIX}": "#2f4f1d",
    f"normal_outlet{RING_SUFFIX}": "#4d3670",
}
OTHER_COLOURS = ("#d9822b", "#7a8793", "#b8a12f", "#c76b98", "#2f8f83", "#6d5a45")
"""Colours of labels in pictures."""

_ADAPTER = pathlib.Path(__file__).parent / "mesh_rendering.py"
_TIMEOUT = 240.0
_TWO, _THREE = (1500, 700), (1500, 560)  # sizes of pictures of two and of three panels [pixels]
_LEAST_PATCH = 12  # interface triangles that make a septum
_PLACES = 3


def label_colours(names: Sequence[str]) -> dict[str, str]:
    """Colour of each label: its own, or the next free one."""
    free = iter(OTHER_COLOURS * len(names))
    return {name: LABEL_COLOURS.get(name) or next(free) for name in names}


class Place(NamedTuple):
    """The tissue between two lumens, and directions there.

    Attributes:
        focus: a point of it [cm].
        along: direction of the thinner vessel there.
        outward: across it, away from the wider vessel.
        extent: length of the tissue along the vessel [cm]; 0 where there is none.
    """

    focus: Float[np.ndarray, " 3"]
    along: Float[np.ndarray, " 3"]
    outward: Float[np.ndarray, " 3"]
    extent: float


def draw_mesh(mesh: Mesh, anatomy: Anatomy | None) -> tuple[dict[str, bytes], str | None]:
    """Pictures of a mesh as PNG files by name, and why there are none where that is so.

    ``outside``: the labels in their colours, and the lumen in a transparent wall. ``cut``: the
    tetrahedra behind a plane along the tissue between the lumens. ``slit``: sections across it.
    """
    if importlib.util.find_spec("pyvista") is None:
        return {}, "no pictures: pyvista is not installed; try pip install pyvista"
    place = septum_place(mesh, anatomy)
    arrays, options = _scene(mesh, anatomy, place)
    options["colours"] = label_colours(mesh.label_names)
    try:
        drawn = run_isolated(NativeCall(_ADAPTER, arrays, options, _TIMEOUT))
    except MeshingError as error:
        reason = str(error).split(". ")[0].removeprefix("mesh_rendering ")
        return {}, f"no pictures: this machine cannot draw off screen ({reason})"
    return {name: content.tobytes() for name, content in drawn.items()}, None


def septum_place(mesh: Mesh, anatomy: Anatomy | None) -> Place:
    """Where the wall parts two lumens; the middle of the mesh where it never does."""
    axes = _principal_axes(mesh.points)
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    patch = _patch(mesh)
    if len(patch) < _LEAST_PATCH:
        return Place(middle, axes[0], axes[2], 0.0)
    focus = patch[np.argmin(np.linalg.norm(patch - np.median(patch, axis=0), axis=1))]
    along = _principal_axes(patch)[0]
    line = _nearest_line(anatomy, focus)
    if line is not None:
        s = line.s[np.argmin(np.linalg.norm(line.points - focus, axis=1))]
        on_axis, along = centerline_point(line, float(s))
        outward = on_axis - aortic_axis(anatomy, on_axis, middle)
    else:
        outward = focus - middle
    outward = outward - (outward @ along) * along
    return Place(focus, along, _unit(outward), float(np.ptp((patch - focus) @ along)))


def _patch(mesh: Mesh) -> Float[np.ndarray, "points 3"]:
    """Points of the lumen where the tissue to the next lumen is thin."""
    if not np.any(mesh.region == Region.SOLID) or INTERFACE not in mesh.label_names:
        return np.zeros((0, 3))
    measured = wall_thickness(mesh)
    septum = measured.exit == Exit.LUMEN
    if not np.any(septum):
        return np.zeros((0, 3))
    thin = measured.thickness <= 1.5 * np.percentile(measured.thickness[septum], 30.0)
    return measured.points[septum & thin]


def _nearest_line(anatomy: Anatomy | None, point: Float[np.ndarray, " 3"]) -> Centerline | None:
    """Centerline of the branch nearest to a point."""
    lines = [] if anatomy is None else [v for k, v in anatomy.centerlines.items() if k != "aorta"]
    distances = [np.min(np.linalg.norm(line.points - point, axis=1)) for line in lines]
    return lines[int(np.argmin(distances))] if lines else None


def aortic_axis(
    anatomy: Anatomy | None, point: Float[np.ndarray, " 3"], middle: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Nearest point of the aorta's axis; the middle of the mesh where it has none."""
    if anatomy is None or "aorta" not in anatomy.centerlines:
        return middle
    points = anatomy.centerlines["aorta"].points
    return points[np.argmin(np.linalg.norm(points - point, axis=1))]


def _scene(
    mesh: Mesh, anatomy: Anatomy | None, place: Place
) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    """Arrays and options of the rendering."""
    up = _upward(mesh)
    front = _unit(place.outward - (place.outward @ up) * up)
    views = np.array([_unit(front + 0.4 * up), _unit(_lower_front(mesh, front, up) - 0.5 * up)])
    normal = _unit(np.cross(place.along, place.outward))
    normal = normal if normal @ up > 0.0 else -normal
    outside = [_frame(mesh, view, up, _THREE, 3) for view in views]
    cut = _frame(mesh, normal, place.outward, _TWO, 2)
    origins, normals, outwards, slit_half = _slit_places(mesh, anatomy, place)
    shape = _TWO[0] / _TWO[1] / 2.0
    arrays = {
        "points": mesh.points,
        "tets": mesh.tets,
        "region": mesh.region,
        "faces": mesh.faces,
        "face_label": mesh.face_label,
        "views": views,
        "view_centres": np.array([frame[0] for frame in outside]),
        "up": up,
        "focus": place.focus,
        "outward": place.outward,
        "cut_normal": normal,
        "cut_centre": cut[0],
        "slit_origin": origins,
        "slit_normal": normals,
        "slit_outward": outwards,
    }
    options: dict[str, object] = {
        "two": list(_TWO),
        "three": list(_THREE),
        "n_tets": len(mesh.tets),
        "view_halves": [frame[1] for frame in outside],
        "cut_half": cut[1],
        "near_half": max(0.6 * place.extent / shape, 0.25) if place.extent else 0.3 * cut[1],
        "has_slit": place.extent > 0.0,
        "slit_places": len(origins),
        "slit_half": slit_half,
    }
    return arrays, options


def _lower_front(
    mesh: Mesh, front: Float[np.ndarray, " 3"], up: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """Horizontal direction that shows the smallest opening."""
    ends = {name: mesh.points[mesh.labelled(name)] for name in mesh.openings}
    if not ends:
        return -front
    smallest = ends[min(ends, key=lambda name: np.ptp(ends[name].reshape(-1, 3), axis=0).max())]
    area = np.cross(smallest[:, 1] - smallest[:, 0], smallest[:, 2] - smallest[:, 0]).sum(axis=0)
    out = _unit(area - (area @ up) * up)
    return _unit(out + 0.5 * front)


def _frame(
    mesh: Mesh,
    view: Float[np.ndarray, " 3"],
    up: Float[np.ndarray, " 3"],
    size: tuple[int, int],
    columns: int,
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Middle of the mesh as seen from a direction, and half the height that shows all of it."""
    side = _unit(np.cross(up, view))
    axes = np.array([side, np.cross(view, side), view])
    seen = mesh.points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    shape = size[0] / columns / size[1]
    half = 0.53 * max(high[1] - low[1], (high[0] - low[0]) / shape)
    return 0.5 * (low + high) @ axes, float(half)


def _slit_places(
    mesh: Mesh, anatomy: Anatomy | None, place: Place
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Origins, normals and outward directions of the sections across, and their half height."""
    line = _nearest_line(anatomy, place.focus)
    if line is None or anatomy is None or not place.extent:
        return place.focus[None], place.along[None], place.outward[None], 0.3
    middle = line.s[np.argmin(np.linalg.norm(line.points - place.focus, axis=1))]
    reach = 0.35 * place.extent
    lines = []
    for s in np.clip(middle + np.linspace(-reach, reach, _PLACES), line.s[0], line.s[-1]):
        point, along = centerline_point(line, float(s))
        outward = point - aortic_axis(anatomy, point, mesh.points.mean(axis=0))
        outward = _unit(outward - (outward @ along) * along)
        lines.append((point, along, outward))
    origins, normals, outwards = (np.array(part) for part in zip(*lines, strict=True))
    widest = float(np.max(anatomy.local_radius(origins)))
    return origins, normals, outwards, 4.0 * widest


def _upward(mesh: Mesh) -> Float[np.ndarray, " 3"]:
    """Along the aorta downstream where it is labelled, else the longest direction."""
    ends = [name for name in ("aorta_inlet", "aorta_outlet") if name in mesh.label_names]
    if len(ends) == 2:
        below, above = (mesh.points[mesh.labelled(name)].mean(axis=(0, 1)) for name in ends)
        return _unit(above - below)
    return _principal_axes(mesh.points)[0]


def _principal_axes(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "3 3"]:
    """Directions of a cloud of points, the longest first."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    return axes


def _unit(vector: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
