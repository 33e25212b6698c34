"""A strip of pictures of a run: instants of its last cycle side by side."""

import importlib.util
import io
import pathlib
from collections.abc import Sequence

import numpy as np
from PIL import Image

from jaxfsi import Mesh
from jaxfsi.adjoint.lumen_shape import LumenSurface
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import Entry, read_series
from jaxfsi.mesh import Region
from jaxfsi.meshing.isolate import MeshingError, NativeCall, run_isolated
from jaxfsi.opening import INLET, OUTLET
from jaxfsi.simulation.cycles import Inlet
from study.run.mesh_pictures import septum_place

_PHASES = (0.15, 0.3, 0.4, 0.6, 0.9)
_ADAPTER = pathlib.Path(__file__).parent / "simulation_rendering.py"
_TIMEOUT = 300.0
_MOST_FILM_FRAMES = 24


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
    series: pathlib.Path, mesh: Mesh, anatomy: Anatomy | None, inlet: Inlet, period: float
) -> tuple[dict[str, bytes], list[float], str | None]:
    """Pictures of a run as PNG files by name, their times [s], and why there are none."""
    frames = chosen_frames(read_series(series), period)
    times = [frame.t for frame in frames]
    if importlib.util.find_spec("pyvista") is None:
        return {}, times, "no pictures: pyvista is not installed; try pip install pyvista"
    if not frames or not len(inlet.t):
        return {}, times, "no pictures: there is no frame yet"
    arrays = _scene(mesh, anatomy)
    arrays["P_inlet_mmHg"] = np.interp(times, *inlet)
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


def draw_film(
    series: pathlib.Path, mesh: Mesh, anatomy: Anatomy | None, inlet: Inlet, period: float
) -> bytes | None:
    """The slice of the pressure and the moving wall over the last cycle as an animated GIF.

    None where nothing can be drawn.
    """
    entries = read_series(series)
    if importlib.util.find_spec("pyvista") is None or not entries or not len(inlet.t):
        return None
    cycle = [e for e in entries if e.t > entries[-1].t - period * (1.0 - 1e-6)]
    cycle = cycle[:: max(1, -(-len(cycle) // _MOST_FILM_FRAMES))]
    arrays = _scene(mesh, anatomy)
    arrays["P_inlet_mmHg"] = np.interp([e.t for e in cycle], *inlet)
    files = [str(series.parent / e.file) for e in cycle]
    options: dict[str, object] = {"files": files, "rigid": False, "film": True}
    try:
        drawn = run_isolated(NativeCall(_ADAPTER, arrays, options, _TIMEOUT))
    except MeshingError:
        return None
    images = [Image.open(io.BytesIO(drawn[name].tobytes())) for name in sorted(drawn)]
    coloured = [image.convert("P", palette=Image.Palette.ADAPTIVE) for image in images]
    buffer = io.BytesIO()
    pause = max(20, round(4000.0 * period / len(coloured)))  # a quarter of the speed [ms]
    coloured[0].save(
        buffer, format="GIF", save_all=True, append_images=coloured[1:], duration=pause, loop=0
    )
    return buffer.getvalue()


def draw_lumen(
    mesh: Mesh, anatomy: Anatomy | None, surface: LumenSurface, values: np.ndarray
) -> dict[str, bytes]:
    """Picture of a value at each node of the lumen; none where nothing can be drawn."""
    if importlib.util.find_spec("pyvista") is None:
        return {}
    arrays = _scene(mesh, anatomy)
    arrays |= {"points": surface.points, "triangles": surface.triangles, "values": values}
    try:
        drawn = run_isolated(NativeCall(_ADAPTER, arrays, {"surface": True}, _TIMEOUT))
    except MeshingError:
        return {}
    return {name: content.tobytes() for name, content in drawn.items()}


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
