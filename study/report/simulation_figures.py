"""Figures of a 3D run as SVG text: pressures and flows of the ports, and how the steps went."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg

Document = Mapping[str, Any]

_MORE = (*COLOURS, "#8e6bb5", "#2f8f83", INK)


def simulation_figures(document: Document) -> dict[str, str]:
    """Figures of the document of a run, by name; none where no step was taken."""
    if not document["history"]["t_s"]:
        return {}
    return {"ports": ports(document), "steps": steps(document)}


def ports(document: Document) -> str:
    """Pressure and flow of every opening over time."""
    history = document["history"]
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.6), layout="constrained")
        pressure, aorta, coronary = figure.subplots(
            3, 1, sharex=True, height_ratios=(1.5, 1.0, 1.0)
        )
        for k, name in enumerate(history["ports"]):
            colour = _MORE[k % len(_MORE)]
            pressure.plot(history["t_s"], history["P_mmHg"][name], color=colour, label=_words(name))
            sign = -1.0 if name.endswith("inlet") else 1.0
            below = aorta if name.startswith("aorta") else coronary
            Q = sign * np.asarray(history["Q_ml_per_min"][name])
            into = " (in)" if sign < 0.0 else " (out)"
            litres = below is aorta
            below.plot(
                history["t_s"], Q / 1000.0 if litres else Q, color=colour, label=_words(name) + into
            )
        pressure.set_ylabel("pressure [mmHg]")
        aorta.set_ylabel("aorta [L/min]")
        coronary.set_ylabel("coronary [mL/min]")
        coronary.set_xlabel("time [s]")
        _limits(coronary, history)
        for axes in (pressure, aorta, coronary):
            _cycles(axes, document)
            if axes.lines:
                axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg(figure, "ports")


def _limits(axes: Axes, history: Mapping[str, Any]) -> None:
    """Leave the first hundredth of the run out of the scale: the start from rest rings."""
    skip = len(history["t_s"]) // 50
    values = [
        value
        for name, flow in history["Q_ml_per_min"].items()
        if not name.startswith("aorta")
        for value in flow[skip:]
    ]
    if values:
        low, high = min(values), max(values)
        margin = 0.08 * max(high - low, 1e-9)
        axes.set_ylim(low - margin, high + margin)


def _cycles(axes: Axes, document: Document) -> None:
    period, last = document["period_s"], document["history"]["t_s"][-1]
    for t in np.arange(period, last + 1e-9, period):
        axes.axvline(t, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)


def steps(document: Document) -> str:
    """Iterations, residual, change and smallest element of every step."""
    history = document["history"]
    t = history["t_s"]
    with rc_context(STYLE):
        figure = Figure(figsize=(9.2, 4.4), layout="constrained")
        effort, residual, change, volume = figure.subplots(2, 2, sharex=True).flat
        effort.plot(t, history["n_linear"], color=COLOURS[0], linewidth=1.0)
        effort.set_ylabel("iterations a step")
        residual.semilogy(t, _positive(history["residual"]), color=COLOURS[0], linewidth=1.0)
        residual.axhline(document["solver"]["tolerance"], color=RED, linewidth=1.0)
        residual.set_ylabel("residual, of the start's")
        change.semilogy(t, _positive(history["change"]), color=COLOURS[0], linewidth=1.0)
        change.set_ylabel("change of a step")
        volume.plot(t, history["least_volume"], color=COLOURS[0], linewidth=1.0)
        volume.set_ylabel("least volume of an element")
        for axes in (change, volume):
            axes.set_xlabel("time [s]")
        for event in document["events"]:
            effort.axvline(event["t_s"], color=RED, linewidth=0.8)
        return svg(figure, "steps")


def _positive(values: list[float]) -> np.ndarray:
    return np.maximum(np.asarray(values), 1e-16)


def _words(name: str) -> str:
    return name.replace("_", " ")
