"""Figure of a calibrated wall as SVG text: lumens measured and predicted along the artery."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from study.report.style import COLOURS, GREY, INK, STYLE, legend_below, svg

Document = Mapping[str, Any]

MODELS = {
    "linear": "linear elements, moduli of the case",
    "literature": "bending wall, moduli of the case",
    "fitted": "bending wall, fitted",
}
"""What each model is called."""

_QUANTITIES = (("area", "mm2", "area [mm²]"), ("minor", "mm", "minor axis [mm]"))


def wall_figure(document: Document) -> str:
    """Area and minor axis over the distance from the ostium in every state."""
    states, s = document["states"], document["s_mm"]
    with rc_context(STYLE):
        figure = Figure(figsize=(3.2 * max(len(states), 2), 5.2), layout="constrained")
        grid = figure.subplots(2, len(states), sharex=True, sharey="row", squeeze=False)
        for column, (name, state) in enumerate(states.items()):
            for axes, (key, unit, label) in zip(grid[:, column], _QUANTITIES, strict=True):
                measured = np.array(state["measured"][f"{key}_{unit}"])
                sd = np.array(state[f"{key}_sd_{unit}"])
                axes.fill_between(s, measured - sd, measured + sd, color="#dfe3e8", linewidth=0)
                axes.plot(s, measured, color=INK, marker="o", markersize=3, label="measured")
                image = document["image_lumen"][f"{key}_{unit}"]
                axes.plot(s, image, color=GREY, linestyle=":", label="image")
                for colour, (model, words) in zip(COLOURS, MODELS.items(), strict=True):
                    values = state["predicted"][model][f"{key}_{unit}"]
                    way = "--" if model == "fitted" else "-"  # both bending walls stay in sight
                    axes.plot(s, values, color=colour, linestyle=way, label=words)
                if column == 0:
                    axes.set_ylabel(label)
            role = "fitted" if state["fitted"] else "predicted"
            grid[0, column].set_title(f"{name.replace('_', ' ')} ({role})")
            grid[1, column].set_xlabel("distance from the ostium [mm]")
        handles, _ = grid[0, 0].get_legend_handles_labels()
        legend_below(figure, handles, most=3)
        return svg(figure, "wall")
