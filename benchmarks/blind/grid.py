"""The grid of richness and noise as one table, and the figure of its calibration."""

import pathlib

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from benchmarks.blind.score import Row, detectability, ranked, score, stated_and_seen, truth
from study.report.style import COLOURS, GREY, STYLE

COLUMNS = {
    "top-1": "top-1",
    "top-2": "top-2",
    "right if named": "right if named",
    "wrongly named of all": "wrongly named",
    "false alarms": "false alarms",
    "90 % set covers": "90 % set covers",
    "mean size of set": "its size",
    "outside: flagged": "outside flagged",
    "outside: named": "outside named",
    "pair: first": "pair: first",
    "pair: both": "pair: both",
    "ECE": "ECE",
    "shrink / oracle": "shrink/oracle",
    "made worse": "made worse",
}
"""Figures of `score` that the table shows, with its headings."""

BINS = 8
"""Bins of the reliability plot."""


def grid_table(levels: dict[str, list[Row]]) -> str:
    """A Markdown table, one row a level, shares with their 95 % Wilson intervals."""
    lines = [
        "| level | cases | " + " | ".join(COLUMNS.values()) + " |",
        "|---" * (len(COLUMNS) + 2) + "|",
    ]
    for name, rows in levels.items():
        found = score(rows)
        lines.append(f"| {name} | {len(rows)} | " + " | ".join(found[c] for c in COLUMNS) + " |")
    return "\n".join(lines)


def grid_figure(levels: dict[str, list[Row]], path: pathlib.Path) -> None:
    """Reliability of every level, and the share ranked first by detectability, as PNG."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot([0, 1], [0, 1], color=GREY, linestyle=(0, (3, 2)), linewidth=1.0)
        for k, (name, rows) in enumerate(levels.items()):
            colour = COLOURS[k % len(COLOURS)]
            _reliability(left, rows, name, colour)
            _detection(right, rows, name, colour)
        left.set_xlabel("stated probability of the likeliest hypothesis")
        left.set_ylabel("share of these that are true")
        right.set_xscale("log")
        right.set_xlabel("detectability λ of the effect [noise units]")
        right.set_ylabel("share ranked first")
        right.set_ylim(0.0, 1.05)
        left.legend(loc="upper left", fontsize=8)
        figure.savefig(path, dpi=150)


def _reliability(axes, rows: list[Row], name: str, colour: str) -> None:
    p, hit = stated_and_seen(rows)
    order = np.argsort(p)
    parts = [part for part in np.array_split(order, BINS) if part.size]
    x, y = ([float(v[part].mean()) for part in parts] for v in (p, hit))
    spread = [np.sqrt(max(b * (1.0 - b), 0.02) / part.size)
              for b, part in zip(y, parts, strict=True)]  # fmt: skip
    axes.errorbar(x, y, yerr=spread, color=colour, marker="o", markersize=4, linewidth=1.2,
                  capsize=2, label=name)  # fmt: skip


def _detection(axes, rows: list[Row], name: str, colour: str) -> None:
    single = [r for r in rows if r["label"]["kind"] == "single"]
    if not single:
        return
    size = np.array([detectability(r) for r in single])
    hit = np.array([ranked(r)[0] == truth(r)[0] for r in single], float)
    order = np.argsort(size)
    parts = [part for part in np.array_split(order, BINS) if part.size]
    axes.plot(
        [float(np.median(size[part])) for part in parts],
        [float(hit[part].mean()) for part in parts],
        color=colour, marker="o", markersize=4, linewidth=1.2, label=name,
    )  # fmt: skip
