"""Off-screen pictures of a mesh by VTK; run in a child process, since VTK may end the process.

The child starts from this file and imports nothing of the package.
"""

import os
import tempfile

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("PYVISTA_USERDATA_PATH", tempfile.gettempdir())

import numpy as np
import pyvista as pv

_BLOOD, _WALL = "#c8443a", "#e6cfa8"
_EDGE = "#4a3b2a"
_BACK = "white"


def run(arrays: dict[str, np.ndarray], options: dict) -> dict[str, np.ndarray]:
    """Draw the pictures that the options name.

    Args:
        arrays: points, tets, region, faces, face_label of a mesh; focus, along, outward, up: the
            place and the directions to look at.
        options: colours by label, extents of the pictures [cm], sizes of the pictures [pixels].

    Returns:
        PNG files as bytes, by name.
    """
    drawn = {"outside": _outside(arrays, options), "cut": _cut(arrays, options)}
    if options["has_slit"]:
        drawn["slit"] = _slit(arrays, options)
    return {name: np.frombuffer(content, dtype=np.uint8) for name, content in drawn.items()}


def _plotter(size: list[int], columns: int) -> pv.Plotter:
    width, height = size
    plotter = pv.Plotter(
        off_screen=True,
        shape=(1, columns),
        window_size=[width, height],
        border=columns > 1,
        border_color="white",
        border_width=8.0,
    )
    plotter.set_background(_BACK)  # pyright: ignore[reportArgumentType]  wrapped method
    return plotter


def _surface(arrays: dict[str, np.ndarray], label: int) -> pv.PolyData:
    faces = arrays["faces"][arrays["face_label"] == label]
    cells = np.column_stack([np.full(len(faces), 3), faces])
    return pv.PolyData(arrays["points"], cells.ravel())


def _grid(arrays: dict[str, np.ndarray]) -> pv.UnstructuredGrid:
    tets = arrays["tets"]
    cells = np.column_stack([np.full(len(tets), 4), tets]).ravel()
    types = np.full(len(tets), pv.CellType.TETRA)
    grid = pv.UnstructuredGrid(cells, types, arrays["points"])
    grid.cell_data["region"] = arrays["region"]
    return grid


def _look(
    plotter: pv.Plotter, centre: np.ndarray, towards: np.ndarray, up: np.ndarray, half: float
) -> None:
    """Parallel view of a square of given half height about a point, from a direction."""
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


def _line_width(options: dict) -> float:
    return 0.9 if options["n_tets"] < 80_000 else 0.5


def _outside(arrays: dict[str, np.ndarray], options: dict) -> bytes:
    """Every label in its colour from two sides; the lumen through a transparent wall."""
    plotter = _plotter(options["three"], 3)
    for column, (view, glassy) in enumerate(((0, False), (1, False), (0, True))):
        plotter.subplot(0, column)
        for index, (name, colour) in enumerate(options["colours"].items()):
            surface = _surface(arrays, index)
            if surface.n_cells == 0 or (glassy and name.endswith("_ring")):
                continue
            glass = glassy and name == "outer_wall"
            plotter.add_mesh(
                surface,
                color=colour,
                opacity=0.14 if glass else 1.0,
                show_edges=not glass,
                edge_color=_EDGE,
                line_width=0.6 * _line_width(options),
                ambient=0.4,
                diffuse=0.65,
                specular=0.0,
            )
        plotter.enable_anti_aliasing("ssaa")
        half = options["view_halves"][view]
        _look(plotter, arrays["view_centres"][view], arrays["views"][view], arrays["up"], half)
    return _png(plotter)


def _cut(arrays: dict[str, np.ndarray], options: dict) -> bytes:
    """The tetrahedra behind a plane along the vessel: whole, and near the tissue between lumens."""
    normal, focus = arrays["cut_normal"], arrays["focus"]
    grid = _grid(arrays)
    middle = arrays["points"][arrays["tets"]].mean(axis=1)
    kept = grid.extract_cells((middle - focus) @ normal < 0.0)
    plotter = _plotter(options["two"], 2)
    views = ((arrays["cut_centre"], options["cut_half"]), (focus, options["near_half"]))
    up = arrays["outward"]
    for column, (centre, half) in enumerate(views):
        plotter.subplot(0, column)
        for region, colour in ((0, _BLOOD), (1, _WALL)):
            part = kept.extract_cells(kept.cell_data["region"] == region)
            if part.n_cells == 0:
                continue
            plotter.add_mesh(
                part.extract_surface(algorithm="dataset_surface"),
                color=colour,
                show_edges=True,
                edge_color=_EDGE,
                line_width=_line_width(options) * (0.8 if column == 0 else 1.4),
                ambient=0.45,
                diffuse=0.6,
                specular=0.0,
            )
        plane = centre - ((centre - focus) @ normal) * normal
        plotter.enable_anti_aliasing("ssaa")
        _look(plotter, plane, normal, up, half)
    return _png(plotter)


def _slit(arrays: dict[str, np.ndarray], options: dict) -> bytes:
    """Flat sections through the tetrahedra across the vessel, at three places along it."""
    grid = _grid(arrays)
    places = options["slit_places"]
    plotter = _plotter(options["three"], places)
    for column in range(places):
        plotter.subplot(0, column)
        origin, normal = arrays["slit_origin"][column], arrays["slit_normal"][column]
        outward = arrays["slit_outward"][column]
        section = grid.slice(normal=normal, origin=origin, generate_triangles=False)
        for region, colour in ((0, _BLOOD), (1, _WALL)):
            part = section.extract_cells(section.cell_data["region"] == region)
            if part.n_cells == 0:
                continue
            plotter.add_mesh(
                part.extract_surface(algorithm="dataset_surface"),
                color=colour,
                show_edges=True,
                edge_color=_EDGE,
                line_width=1.2,
                lighting=False,
            )
        plotter.enable_anti_aliasing("ssaa")
        half = options["slit_half"]
        _look(plotter, origin - 0.3 * half * outward, normal, outward, half)
    return _png(plotter)
