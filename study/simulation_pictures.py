"""A strip of pictures of a run: instants of its last cycle side by side."""

import importlib.util
import pathlib
from collections.abc import Sequence

import numpy as np

from jaxfsi import Mesh
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import Entry, read_series
from jaxfsi.mesh import Region
from jaxfsi.meshing.isolate import MeshingError, NativeCall, run_isolated
from jaxfsi.simulation import Record
from lumped import MMHG
from study.mesh_pictures import septum_place
from study.simulation_case import INLET, OUTLET

PICTURES = {
    "pressure": "Pressure less that of the aortic inlet, in a plane along the anomalous artery;"
    " wall grey. The wall is shown where it is at that instant.",
    "speed": "Speed of the blood in the same plane.",
    "wall": "The wall from outside, coloured by its displacement (where it is rigid: the lumen,"
    " coloured by wall shear stress).",
}
"""What the pictures show, by name."""

_PHASES = (0.15, 0.3, 0.4, 0.6, 0.9)
_ADAPTER = pathlib.Path(__file__).parent / "simulation_rendering.py"
_TIMEOUT = 300.0


def chosen_frames(entries: Sequence[Entry], period: float) -> list[Entry]:
    """Frames at the phases of the strip: of the last whole cycle, or of what there is."""
    if not entries:
        return []
    last = entries[-1].t
    cycle = max(0.0, np.floor(last / period + 1e-6) - 1.0)
    begin = cycle * period if last >= period else 0.0
    span = period if last >= period else last
    times = np.array([entry.t for entry in entries])
    places = [int(np.argmin(np.abs(times - begin - phase * span))) for phase in _PHASES]
    return [entries[k] for k in dict.fromkeys(places)]


def draw_simulation(
    series: pathlib.Path, mesh: Mesh, anatomy: Anatomy | None, record: Record, period: float
) -> tuple[dict[str, bytes], list[float], str | None]:
    """Pictures of a run as PNG files by name, their times [s], and why there are none."""
    frames = chosen_frames(read_series(series), period)
    times = [frame.t for frame in frames]
    if importlib.util.find_spec("pyvista") is None:
        return {}, times, "no pictures: pyvista is not installed; try pip install pyvista"
    if not frames or not record.n_steps:
        return {}, times, "no pictures: there is no frame yet"
    arrays = _scene(mesh, anatomy)
    arrays["P_inlet_mmHg"] = np.interp(times, record.t, record.P_port[:, 0]) / MMHG
    options: dict[str, object] = {
        "files": [str(series.parent / frame.file) for frame in frames],
        "rigid": not np.any(mesh.region == Region.SOLID),
    }
    try:
        drawn = run_isolated(NativeCall(_ADAPTER, arrays, options, _TIMEOUT))
    except MeshingError as error:
        reason = str(error).split(". ")[0].removeprefix("simulation_rendering ")
        return {}, times, f"no pictures: this machine cannot draw off screen ({reason})"
    return {name: content.tobytes() for name, content in drawn.items()}, times, None


def _scene(mesh: Mesh, anatomy: Anatomy | None) -> dict[str, np.ndarray]:
    place = septum_place(mesh, anatomy)
    upright = np.array([0.0, 0.0, 1.0])
    if {INLET, OUTLET} <= set(mesh.label_names):
        below, above = (
            mesh.points[mesh.labelled(name)].mean(axis=(0, 1)) for name in (INLET, OUTLET)
        )
        upright = _unit(above - below)
    normal = _unit(np.cross(place.along, place.outward))
    normal = normal if normal @ upright > 0.0 else -normal
    centre = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    front = place.outward - (place.outward @ upright) * upright
    front = _unit(front) if np.linalg.norm(front) > 1e-6 else _unit(np.cross(upright, normal))
    reach = np.linalg.norm(mesh.points - centre, axis=1).max()
    near = 0.55 * place.extent + 0.35 if place.extent else 0.6 * reach
    return {
        "focus": place.focus,
        "normal": normal,
        "up": _unit(place.outward - (place.outward @ normal) * normal),
        "near_half": np.array(min(near, reach)),
        "centre": centre,
        "view": _unit(front + 0.4 * upright),
        "upright": upright,
        "whole_half": np.array(reach),
    }


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)
