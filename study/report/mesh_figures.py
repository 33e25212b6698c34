"""Figures of a mesh as SVG text: areas and outlines along a vessel, angles and thickness."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg
from study.run.limits import AREA_BOUND

Entry = Mapping[str, Any]

_AREA_PERCENT = 100.0 * AREA_BOUND
_BLOOD, _WALL = "#c8443a", "#c9a66b"


def mesh_figures(entry: Entry) -> dict[str, str]:
    """Figures of the mesh of one state, by name; those without data are left out."""
    name = entry["state"]
    drawn = {"histograms": histograms(entry["histograms"], f"{name} histograms")}
    if entry["sections"]:
        drawn["areas"] = areas(entry["sections"], f"{name} areas")
        drawn["outlines"] = outlines(entry["sections"][0], f"{name} outlines")
    return drawn


def areas(sections: Sequence[Entry], name: str) -> str:
    """Lumen area asked for and meshed along each vessel, and their difference below."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.2), layout="constrained")
        grid = figure.subplots(
            2, len(sections), squeeze=False, sharex="col", height_ratios=(1.6, 1.0),
            width_ratios=[2.0 if k == 0 else 1.0 for k in range(len(sections))],
        )  # fmt: skip
        for column, section in enumerate(sections):
            above, below = grid[:, column]
            above.plot(section["s_mm"], section["asked_mm2"], color=GREY, label="asked for")
            above.plot(
                section["s_mm"], section["meshed_mm2"], color=COLOURS[0], marker="o",
                markersize=3.5, linestyle="none", label="meshed",
            )  # fmt: skip
            above.set_title(section["vessel"])
            above.set_ylim(bottom=0.0)
            _errors(below, section)
        grid[0, 0].set_ylabel("lumen area [mm²]")
        grid[1, 0].set_ylabel("difference [%]")
        grid[0, 0].legend(loc="best")
        return svg(figure, name)


def _errors(axes: Axes, section: Entry) -> None:
    s = np.asarray(section["s_mm"])
    error = 100.0 * (np.asarray(section["meshed_mm2"]) / np.asarray(section["asked_mm2"]) - 1.0)
    beyond = np.abs(error) > _AREA_PERCENT
    width = 0.55 * float(np.median(np.diff(s))) if len(s) > 1 else 1.0
    axes.bar(s, error, width, color=np.where(beyond, RED, COLOURS[0]).tolist())
    for bound in (-_AREA_PERCENT, _AREA_PERCENT):
        axes.axhline(bound, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
    largest = max(1.3 * _AREA_PERCENT, 1.15 * float(np.max(np.abs(error))))
    axes.set_ylim(-largest, largest)
    axes.set_xlabel("distance along the axis [mm]")


def outlines(section: Entry, name: str) -> str:
    """Cross-sections of the lumen: filled as asked for, drawn as meshed; all to one scale."""
    shown = section["outlines"]
    columns = min(4, len(shown))
    rows = -(-len(shown) // columns)
    half = 1.08 * max(abs(value) for entry in shown for row in entry["asked_mm"] for value in row)
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.35 * rows), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes in grid.flat[len(shown) :]:
            axes.set_axis_off()
        for axes, entry in zip(grid.flat, shown, strict=False):
            axes.add_collection(
                LineCollection(_pieces(entry["asked_mm"]), colors=GREY, linewidths=4.0, alpha=0.45)
            )
            axes.add_collection(
                LineCollection(_pieces(entry["meshed_mm"]), colors=COLOURS[0], linewidths=1.3)
            )
            axes.set_aspect("equal")
            axes.set_xlim(-half, half)
            axes.set_ylim(-half, half)
            axes.set_title(f"{entry['s_mm']:.1f} mm: {_percent(entry['error'])}")
        for axes in grid[-1]:
            axes.set_xlabel("[mm]")
        for row in grid:
            row[0].set_ylabel("[mm]")
        return svg(figure, name)


def _pieces(rows: Sequence[Sequence[float]]) -> list[np.ndarray]:
    return [np.asarray(row).reshape(2, 2) for row in rows]


def _percent(error: float) -> str:
    return f"{100.0 * error:+.1f} %".replace("-", "−")


def histograms(data: Mapping[str, Entry], name: str) -> str:
    """Smallest dihedral angle of the tetrahedra by region; thickness of wall and septum."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.7), layout="constrained")
        grid = figure.subplots(1, len(data), squeeze=False)[0]
        titles = {
            "min_dihedral_deg": (
                "smallest dihedral angle of a tetrahedron [degrees]",
                "tetrahedra",
            ),
            "thickness_mm": ("thickness of the wall behind the lumen [mm]", "lumen triangles"),
        }
        colours = {"fluid": _BLOOD, "solid": _WALL, "wall": _WALL, "septum": INK}
        words = {"fluid": "blood", "solid": "wall", "septum": "between two lumens"}
        for axes, (measure, histogram) in zip(grid, data.items(), strict=True):
            edges = np.asarray(histogram["edges"])
            for part, counts in histogram["counts"].items():
                share = 100.0 * np.asarray(counts) / max(sum(counts), 1)
                filled = part != "septum"
                axes.stairs(
                    share, edges, fill=filled, alpha=0.55 if filled else 1.0,
                    color=colours[part], linewidth=1.5, label=words.get(part, part),
                )  # fmt: skip
            axes.set_xlabel(titles[measure][0])
            axes.set_ylabel(f"share of {titles[measure][1]} [%]")
            axes.legend(loc="best")
        return svg(figure, name)
