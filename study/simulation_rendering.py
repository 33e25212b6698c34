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
_WIDTH, _HEIGHT = 330, 330


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
    grids = [_moved(pv.read(file)) for file in options["files"]]
    slices = [grid.slice(normal=arrays["normal"], origin=arrays["focus"]) for grid in grids]
    blood = [part.extract_cells(part.cell_data["region"] == 0) for part in slices]
    wall = [part.extract_cells(part.cell_data["region"] == 1) for part in slices]
    for part, P in zip(blood, arrays["P_inlet_mmHg"], strict=True):
        part["drop"] = part["pressure_mmHg"] - P
        part["speed"] = np.linalg.norm(part["velocity_cm_per_s"], axis=1)
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
    plotter = pv.Plotter(
        off_screen=True,
        shape=(1, columns),
        window_size=[_WIDTH * columns, _HEIGHT],
        border=False,
    )
    plotter.set_background("white")  # pyright: ignore[reportArgumentType]  wrapped method
    return plotter


def _bar(title: str) -> Any:
    return {
        "title": title,
        "color": "#1d2733",
        "vertical": True,
        "n_labels": 3,
        "fmt": "%.3g",
        "position_x": 0.8,
        "position_y": 0.06,
        "width": 0.1,
        "height": 0.5,
        "title_font_size": 13,
        "label_font_size": 12,
    }


_TITLES = {
    "drop": "mmHg",
    "speed": "cm/s",
    "size": "mm",
    "shear": "dyn/cm2",
}


def _slices(blood, wall, name: str, colours: Any, arrays: dict, half: str) -> bytes:
    low, high = _range(blood, name, 0.5, 99.5)
    plotter = _plotter(len(blood))
    for column, (inside, outside) in enumerate(zip(blood, wall, strict=True)):
        plotter.subplot(0, column)
        last = column == len(blood) - 1
        if outside.n_cells:
            plotter.add_mesh(outside, color=_WALL, lighting=False)
        plotter.add_mesh(
            inside,
            scalars=name,
            cmap=colours,
            clim=(low, high),
            lighting=False,
            show_scalar_bar=last,
            scalar_bar_args=_bar(_TITLES[name]) if last else None,
        )
        plotter.enable_anti_aliasing("ssaa")
        _look(plotter, arrays["focus"], arrays["normal"], arrays["up"], float(arrays[half]))
    return _png(plotter)


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
    plotter = _plotter(len(parts))
    for column, part in enumerate(parts):
        plotter.subplot(0, column)
        last = column == len(parts) - 1
        plotter.add_mesh(
            part,
            scalars=name,
            cmap=colours,
            clim=(low, high),
            smooth_shading=True,
            specular=0.1,
            show_scalar_bar=last,
            scalar_bar_args=_bar(_TITLES[name]) if last else None,
        )
        plotter.enable_anti_aliasing("ssaa")
        _look(
            plotter,
            arrays["centre"],
            arrays["view"],
            arrays["upright"],
            float(arrays["whole_half"]),
        )
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
