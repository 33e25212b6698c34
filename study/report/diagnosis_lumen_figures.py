"""The lumen that would explain a record, as a figure with its caption."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from study.report.number_formats import signed
from study.report.style import COLOURS, GREY, INK, STYLE, legend_below, svg

_SCAN, _WANTED = "#dfe3e8", COLOURS[1]


def lumen_change(document: Mapping[str, Any]) -> str:
    """Half of the minor axis and its change along the artery; empty where there is no change."""
    part = document.get("lumen")
    if not part or part["change"] is None:
        return ""
    change = part["change"]
    names = ("s_mm", "half_minor_mm", "delta_r_mm", "low_mm", "high_mm")
    s, scanned, delta, low, high = (np.array(change[name]) for name in names)
    reach = 2.0 * change["scan_sd_mm"]
    with rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.9), layout="constrained")
        size, off = figure.subplots(2, 1, sharex=True, height_ratios=(1.35, 1.0))
        for axes, middle in ((size, scanned), (off, np.zeros_like(scanned))):
            axes.fill_between(
                s, middle - reach, middle + reach, color=_SCAN, linewidth=0, label="scan ± 2 sd"
            )
            axes.fill_between(
                s, middle + low, middle + high, color=_WANTED, alpha=0.3, linewidth=0,
                label="± 2 sd of the loss",
            )  # fmt: skip
            axes.plot(s, middle, color=INK, label="as scanned")
            axes.plot(s, middle + delta, color=_WANTED, label="would explain the record")
            if change["course_mm"] is not None:
                axes.axvline(change["course_mm"], color=GREY, linewidth=1.0, linestyle=(0, (3, 3)))
        if change["course_mm"] is not None:
            size.annotate(
                "the intramural course ends", (change["course_mm"], 0.0), (4.0, 4.0),
                xycoords=("data", "axes fraction"), textcoords="offset points", color=GREY,
                fontsize=8.0,
            )  # fmt: skip
        size.set_ylim(0.0, None)
        size.set_ylabel("half of the minor axis [mm]")
        off.set_ylabel("change [mm]")
        off.set_xlabel("distance from the ostium [mm]")
        off.set_xlim(s[0], s[-1])
        legend_below(figure, size.get_legend_handles_labels()[0])
        return svg(figure, "lumen-change")


def change_words(change: Mapping[str, Any]) -> str:
    """The caption of the figure, from the part as JSON holds it."""
    mean = change["course_mean_mm"]
    course = (
        ""
        if mean is None
        else f" Mean over the intramural course of {change['course_mm']:.1f} mm:"
        f" {signed(mean, 3)} mm."
    )
    return (
        f"R0 of the lumen × {change['R0_factor']:.2f}, K × {change['K_factor']:.2f}.{course} Bands:"
        " two standard deviations of the scan, and of the loss that the record wants. Errors of the"
        f" scan are taken as alike over {change['correlation_mm']:.1f} mm."
    )
