"""Figures of a what-if as SVG text: the artery before and after, on the same axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from study.report.style import COLOURS, GREY, STYLE, legend_below, svg

Document = Mapping[str, Any]


def what_if_figures(document: Document) -> dict[str, str]:
    """Lumen, area and minor axis along the artery, a figure for each side."""
    sides = {name: document[name] for name in ("before", "after")}
    limits = {
        key: 1.08 * max(max(side[key]) for side in sides.values())
        for key in ("s_mm", "area_mm2", "major_axis_mm", "minor_axis_mm")
    }
    return {
        name: _side(side, name, limits, colour)
        for (name, side), colour in zip(sides.items(), COLOURS, strict=False)
    }


def _side(side: Document, name: str, limits: Mapping[str, float], colour: str) -> str:
    s = np.array(side["s_mm"])
    with rc_context(STYLE):
        figure = Figure(figsize=(4.9, 6.2), layout="constrained")
        drawn, area, minor = figure.subplots(3, 1, sharex=True, height_ratios=(1.1, 1.0, 1.0))
        for key, shade, words in (
            ("major_axis_mm", 0.25, "seen on its major axis"),
            ("minor_axis_mm", 0.8, "seen on its minor axis"),
        ):
            half = np.array(side[key]) / 2.0
            drawn.fill_between(s, -half, half, color=colour, alpha=shade, linewidth=0, label=words)
        reach = 0.5 * limits["major_axis_mm"]
        drawn.set_ylim(-reach, reach)
        drawn.set_aspect("equal", adjustable="box")
        drawn.set_ylabel("lumen [mm]")
        drawn.set_title(f"{name}: the artery from the aorta on")
        for axes, key, label in (
            (area, "area_mm2", "area [mm²]"),
            (minor, "minor_axis_mm", "minor axis [mm]"),
        ):
            axes.plot(s, side[key], color=colour)
            least = int(np.argmin(side[key]))
            axes.plot(s[least], side[key][least], "o", color=GREY, markersize=4)
            axes.set_ylim(0.0, limits[key])
            axes.set_ylabel(label)
        minor.set_xlim(0.0, limits["s_mm"])
        minor.set_xlabel("distance from the ostium [mm]")
        legend_below(figure, drawn.get_legend_handles_labels()[0], most=2)
        return svg(figure, f"what-if-{name}")
