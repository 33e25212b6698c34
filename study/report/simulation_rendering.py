"""Off-screen pictures of a 3D run by VTK; run in a child process, since VTK may end the process.

The child starts from this file and imports nothing of the package. It reads the frames themselves.
"""

import os
import tempfile
from typing import Any

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("PYVISTA_USERDATA_PATH", tempfile.gettempdir())

import numpy as np
import pyvista as pv

_WALL = "#cfc8bd"
_PRESSURE, _SPEED, _MOVED, _SHEAR = "RdYlBu_r", "viridis", "magma_r", "plasma"
_WIDTH, _HEIGHT, _SCALE = 330, 330, 110  # pixels


def run(arrays: dict[str, np.ndarray], options: dict) -> dict[str, np.ndarray]:
    """Draw one picture a row of the strip.

    Args:
        arrays: focus, normal, up: the plane of the slices and where up is; P_inlet_mmHg of each
            frame; view: direction from which the wall is seen; near_half, whole_half: half heights
            of the views [cm]; centre: middle of the mesh [cm].
        options: files: the frames; rigid: whether there is no wall.

    Returns:
        PNG files as bytes, by name.
    """
    if options.get("surface"):
        return {"lumen": np.frombuffer(_coloured(arrays), dtype=np.uint8)}
    grids = [_moved(pv.read(file)) for file in options["files"]]
    slices = [grid.slice(normal=arrays["normal"], origin=arrays["focus"]) for grid in grids]
    blood = [part.extract_cells(part.cell_data["region"] == 0) for part in slices]
    wall = [part.extract_cells(part.cell_data["region"] == 1) for part in slices]
    for part, P in zip(blood, arrays["P_inlet_mmHg"], strict=True):
        part["drop"] = part["pressure_mmHg"] - P
        part["speed"] = np.linalg.norm(part["velocity_cm_per_s"], axis=1)
    if options.get("film"):
        return _film(blood, wall, arrays)
    drawn = {
        "pressure": _slices(blood, wall, "drop", _PRESSURE, arrays, "near_half"),
        "speed": _slices(blood, wall, "speed", _SPEED, arrays, "near_half"),
        "wall": _surfaces(grids, arrays, options["rigid"]),
    }
    return {name: np.frombuffer(content, dtype=np.uint8) for name, content in drawn.items()}


def _moved(grid):
    return grid.warp_by_vector("displacement_cm")


def _range(parts, name: str, low: float, high: float) -> tuple[float, float]:
    values = np.concatenate([part[name] for part in parts])
    bottom, top = np.percentile(values, [low, high]) if len(values) else (0.0, 1.0)
    return float(bottom), float(max(top, bottom + 1e-9))


def _plotter(columns: int) -> pv.Plotter:
    """Panels of equal width, and a narrow one for the scale."""
    plotter = pv.Plotter(
        off_screen=True,
        shape=(1, columns + 1),
        window_size=[_WIDTH * columns + _SCALE, _HEIGHT],
        col_weights=[_WIDTH] * columns + [_SCALE],
        border=False,
    )
    plotter.set_background("white")  # pyright: ignore[reportArgumentType]  wrapped method
    return plotter


def _scale(plotter: pv.Plotter, columns: int, actor: Any, title: str) -> None:
    """The scale of colours, in the last panel."""
    plotter.subplot(0, columns)
    plotter.add_scalar_bar(  # pyright: ignore[reportCallIssue]  wrapped method
        title=title,
        mapper=actor.mapper,
        color="#1d2733",
        vertical=True,
        n_labels=4,
        fmt="%.3g",
        position_x=0.1,
        position_y=0.1,
        width=0.5,
        height=0.75,
        title_font_size=14,
        label_font_size=13,
        unconstrained_font_size=True,
    )


_TITLES = {
    "drop": "mmHg",
    "speed": "cm/s",
    "size": "mm",
    "shear": "dyn/cm2",
}


def _slices(
    blood, wall, name: str, colours: Any, arrays: dict, half: str, limits: Any = None
) -> bytes:
    low, high = limits or _range(blood, name, 0.5, 99.5)
    plotter, actor = _plotter(len(blood)), None
    for column, (inside, outside) in enumerate(zip(blood, wall, strict=True)):
        plotter.subplot(0, column)
        if outside.n_cells:
            plotter.add_mesh(outside, color=_WALL, lighting=False)
        actor = plotter.add_mesh(
            inside,
            scalars=name,
            cmap=colours,
            clim=(low, high),
            lighting=False,
            show_scalar_bar=False,
        )
        plotter.enable_anti_aliasing("ssaa")
        centre = arrays["focus"] - 0.2 * float(arrays[half]) * arrays["up"]
        _look(plotter, centre, arrays["normal"], arrays["up"], float(arrays[half]))
    _scale(plotter, len(blood), actor, _TITLES[name])
    return _png(plotter)


def _film(blood, wall, arrays: dict) -> dict[str, np.ndarray]:
    """One picture a frame, of the pressure; all with one scale."""
    low, high = _range(blood, "drop", 0.5, 99.5)
    pictures = {}
    for k, (inside, outside) in enumerate(zip(blood, wall, strict=True)):
        content = _slices([inside], [outside], "drop", _PRESSURE, arrays, "near_half", (low, high))
        pictures[f"frame-{k:03d}"] = np.frombuffer(content, dtype=np.uint8)
    return pictures


def _surfaces(grids, arrays: dict, rigid: bool) -> bytes:
    """The outside, coloured by how far the wall moved; shear on the lumen where it cannot move."""
    parts, name, colours = [], "size", _MOVED
    for grid in grids:
        surface = grid.extract_surface(algorithm="dataset_surface")
        surface["size"] = 10.0 * np.linalg.norm(surface["displacement_cm"], axis=1)
        surface["shear"] = np.linalg.norm(surface["wss_dyn_per_cm2"], axis=1)
        parts.append(surface)
    if rigid:
        name, colours = "shear", _SHEAR
    low, high = _range(parts, name, 0.0, 99.0)
    plotter, actor = _plotter(len(parts)), None
    for column, part in enumerate(parts):
        plotter.subplot(0, column)
        actor = plotter.add_mesh(
            part,
            scalars=name,
            cmap=colours,
            clim=(low, high),
            smooth_shading=True,
            specular=0.1,
            show_scalar_bar=False,
        )
        plotter.enable_anti_aliasing("ssaa")
        _look(
            plotter,
            arrays["centre"],
            arrays["view"],
            arrays["upright"],
            float(arrays["whole_half"]),
        )
    _scale(plotter, len(parts), actor, _TITLES[name])
    return _png(plotter)


def _coloured(arrays: dict) -> bytes:
    """A surface with a value at each of its points, from three sides around the focus."""
    triangles = arrays["triangles"]
    faces = np.concatenate([np.full((len(triangles), 1), 3), triangles], axis=1)
    surface = pv.PolyData(arrays["points"], faces.ravel())
    surface["value"] = arrays["values"]
    reach = max(float(np.percentile(np.abs(arrays["values"]), 99.7)), 1e-12)
    normal, up, half = arrays["normal"], arrays["up"], float(arrays["near_half"])
    views = (normal, up, -normal)
    plotter, actor = _plotter(len(views)), None
    for column, view in enumerate(views):
        plotter.subplot(0, column)
        actor = plotter.add_mesh(
            surface,
            scalars="value",
            cmap="RdBu",
            clim=(-reach, reach),
            specular=0.1,
            show_scalar_bar=False,
        )
        plotter.enable_anti_aliasing("ssaa")
        upright = up if abs(float(view @ up)) < 0.9 else np.cross(normal, up)
        _look(plotter, arrays["focus"], view, upright, half)
    _scale(plotter, len(views), actor, "1/mm3")
    return _png(plotter)


def _look(plotter: pv.Plotter, centre, towards, up, half: float) -> None:
    plotter.enable_parallel_projection()  # pyright: ignore[reportCallIssue]  wrapped method
    camera = plotter.camera
    camera.focal_point = tuple(centre)
    camera.position = tuple(centre + 40.0 * towards)
    camera.up = tuple(up)
    camera.parallel_scale = half
    camera.clipping_range = (1.0, 90.0)


def _png(plotter: pv.Plotter) -> bytes:
    with tempfile.TemporaryDirectory(prefix="picture-") as folder:
        path = os.path.join(folder, "picture.png")
        plotter.screenshot(path)
        plotter.close()
        with open(path, "rb") as file:
            return file.read()
