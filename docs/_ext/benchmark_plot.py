"""The directive ``{benchmark-plot} NAME``: a stored result over the size of its rows, as SVG.

Both axes are logarithmic. Options: ``x`` and ``y``, columns of `docs/benchmarks/NAME.json` with a
label each (``column: label``). A dashed line through the first point grows like x.
"""

import json
import math
from typing import ClassVar

from benchmark_table import STORED
from docutils import nodes
from docutils.parsers.rst import directives
from drawings import line, svg, text
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

WIDTH, HEIGHT = 560, 330
LEFT, RIGHT, TOP, BOTTOM = 70, 540, 20, 270
Point = tuple[float, float]


class BenchmarkPlot(SphinxDirective):
    """Plot of a stored result."""

    required_arguments = 1
    option_spec: ClassVar = {"x": directives.unchanged, "y": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """Make the plot."""
        path = STORED / f"{self.arguments[0]}.json"
        self.env.note_dependency(str(path))
        rows = json.loads(path.read_text(encoding="utf-8"))["result"]["rows"]
        (x, x_label), (y, y_label) = (_column(self.options[axis]) for axis in ("x", "y"))
        points = sorted((float(row[x]), float(row[y])) for row in rows)
        return [nodes.raw("", _plot(points, x_label, y_label), format="html")]


def _column(option: str) -> tuple[str, str]:
    name, _, label = option.partition(":")
    return name.strip(), (label or name).strip()


def _plot(points: list[Point], x_label: str, y_label: str) -> str:
    first, last = points[0], points[-1]
    linear = first[1] * last[0] / first[0]
    columns = _range([x for x, _ in points])
    rows = _range([*(y for _, y in points), linear])

    def place(x: float, y: float) -> Point:
        across = math.log(x / columns[0]) / math.log(columns[1] / columns[0])
        up = math.log(y / rows[0]) / math.log(rows[1] / rows[0])
        return LEFT + (RIGHT - LEFT) * across, BOTTOM - (BOTTOM - TOP) * up

    parts = [line((LEFT, TOP), (LEFT, BOTTOM), (RIGHT, BOTTOM))]
    for tick in _ticks(*columns):
        x, _ = place(tick, rows[0])
        parts += [
            line((x, BOTTOM), (x, BOTTOM + 5)),
            text(x, BOTTOM + 21, f"{tick:,.10g}", size=13),
        ]
    for tick in _ticks(*rows):
        _, y = place(columns[0], tick)
        parts += [line((LEFT - 5, y), (LEFT, y)), text(LEFT - 9, y + 4, f"{tick:g}", "end", 13)]
    parts.append(line(place(*first), place(last[0], linear), dash=True))
    parts.append(line(*(place(*point) for point in points)))
    for point in points:
        x, y = place(*point)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="currentColor"/>')
    parts.append(text((LEFT + RIGHT) / 2, HEIGHT - 8, x_label))
    parts.append(text(LEFT + 10, TOP + 12, y_label, "start"))
    parts.append(text(*_below(place(last[0], linear)), "in proportion", "end", 13))
    return svg(WIDTH, HEIGHT, *parts)


def _below(place: Point) -> Point:
    return place[0], place[1] + 48


def _range(values: list[float]) -> tuple[float, float]:
    return min(values) / 1.3, max(values) * 1.3


def _ticks(least: float, most: float) -> list[float]:
    """1, 2 and 5 times powers of ten in a range."""
    decades = range(math.floor(math.log10(least)), math.ceil(math.log10(most)) + 1)
    found = (digit * 10.0**decade for decade in decades for digit in (1, 2, 5))
    return [value for value in found if least <= value <= most]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("benchmark-plot", BenchmarkPlot)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
