"""Figures of a what-if as SVG text: the artery before and after, on the same axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from study.report.style import COLOURS, GREY, STYLE, legend_below, svg

Document = Mapping[str, Any]

_WIDE, _HIGH, _LEAST_HIGH = 3.7, 1.45, 0.4  # panels [in]
_LABELLED = 0.12
"""Share of the axis from which on the part within the aorta is named."""


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
    # the lumen has one scale on both axes: its panel is as high as it is wide by these limits
    high = _WIDE * limits["major_axis_mm"] / limits["s_mm"]
    heights = (max(high, _LEAST_HIGH), _HIGH, _HIGH)
    with rc_context(STYLE):
        figure = Figure(figsize=(_WIDE + 0.7, sum(heights) + 1.4), layout="constrained")
        drawn, area, minor = figure.subplots(3, 1, sharex=True, height_ratios=heights)
        for key, shade, words in (
            ("major_axis_mm", 0.25, "on its major axis"),
            ("minor_axis_mm", 0.8, "on its minor axis"),
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
            axes.plot(s[least], side[key][least], "o", color=GREY, markersize=4, clip_on=False)
            axes.set_ylim(0.0, limits[key])
            axes.set_ylabel(label)
        for axes in (drawn, area, minor):
            axes.axvspan(0.0, s[0], color=GREY, alpha=0.18, linewidth=0)
        if s[0] > _LABELLED * limits["s_mm"]:
            drawn.text(s[0] / 2.0, 0.0, "aorta", ha="center", va="center", color=GREY)
        minor.set_xlim(0.0, limits["s_mm"])
        minor.set_xlabel("distance from the ostium [mm]")
        legend_below(figure, drawn.get_legend_handles_labels()[0], most=2)
        return svg(figure, f"what-if-{name}")
