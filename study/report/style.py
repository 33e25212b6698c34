"""Style of all figures, and figures as SVG text that stands alone."""

import io
import re
from collections.abc import Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

INK, GREY, RED = "#1d2733", "#8b95a1", "#b3382c"
COLOURS = ("#1f6fb2", "#d9822b", "#5a8f3c")
"""Series of a figure, in order; apart from each other for colour-blind eyes."""

STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e9ed",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.6,
    "svg.fonttype": "path",
}
"""Settings of matplotlib for every figure."""


def legend_below(figure: Figure, handles: Sequence[Any], *, most: int = 4) -> None:
    """A legend below a figure, in as many columns as fit its width.

    Args:
        figure: with a constrained layout, which makes room.
        handles: entries.
        most: columns at most.
    """
    for columns in range(min(len(handles), most), 0, -1):
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns)
        width = legend.get_window_extent().width
        if width <= figure.bbox.width or columns == 1:
            return
        legend.remove()


def svg(figure: Figure, name: str) -> str:
    """SVG text to stand inside HTML: no prolog, no metadata, identifiers of its own."""
    buffer = io.StringIO()
    empty = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with rc_context({"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata=empty)
    text = buffer.getvalue()
    return re.sub(r"\s+$", "", text[text.index("<svg") :], flags=re.MULTILINE)
