"""Figure of the uncertainty of FFR: its distribution, and the causes of its width."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.report.parameter_names import NAMES
from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg
from study.report.uncertainty_words import LEAST_SHARE
from study.run.limits import FFR_THRESHOLD

Document = Mapping[str, Any]


def uncertainty_figure(document: Document) -> str:
    """Distribution and causes of each condition's FFR; empty without them."""
    entries = document.get("uncertainty") or []
    if not entries:
        return ""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 2.5 * len(entries)), layout="constrained")
        grid = figure.subplots(len(entries), 2, squeeze=False, width_ratios=(1.1, 1.0))
        for (left, right), entry in zip(grid, entries, strict=True):
            _distribution(left, document, entry)
            _causes(right, entry)
        for axes in grid[:, 0]:
            axes.set_xlim(min(a.get_xlim()[0] for a in grid[:, 0]), 1.0)
        return svg(figure, "uncertainty")


def _distribution(axes: Axes, document: Document, entry: Document) -> None:
    """Density from the quantiles, the interval below it, and what else is known."""
    values = np.asarray(entry["quantiles"])
    middles, density = (values[1:] + values[:-1]) / 2.0, 1.0 / np.maximum(np.diff(values), 1e-6)
    smooth = np.convolve(np.pad(density, 2, mode="edge"), np.ones(5) / 5.0, mode="valid")
    smooth = smooth / smooth.max()
    axes.fill_between(middles, smooth, color=COLOURS[0], alpha=0.25, linewidth=0.0)
    below = middles <= FFR_THRESHOLD
    axes.fill_between(middles, smooth, where=below.tolist(), color=RED, alpha=0.35, linewidth=0.0)
    low, high = entry["interval_90"]
    axes.plot([low, high], [-0.12, -0.12], color=COLOURS[0], linewidth=4.0, solid_capstyle="butt")
    axes.plot(entry["median"], -0.12, "o", color=INK, markersize=5.0)
    axes.text(
        entry["median"], -0.2, f"{entry['median']:.2f} [{low:.2f}, {high:.2f}]",
        ha="center", va="top", fontsize=9.0, color=INK,
    )  # fmt: skip
    axes.axvline(FFR_THRESHOLD, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
    for rule, ffr in _by_rule(document, entry):
        axes.plot(ffr, 1.08, "v", color=COLOURS[1], markersize=6.0, clip_on=False)
        axes.text(ffr, 1.16, f"rule {rule}", ha="center", fontsize=7.5, color=COLOURS[1])
    measured = _measured(document, entry["condition"])
    if measured is not None:
        axes.axvline(measured, color=RED, linewidth=2.0)
        axes.text(measured, 0.55, " measured", color=RED, fontsize=8.0)
    axes.set_title(f"FFR under {entry['condition']}", pad=14.0)
    axes.set_yticks([])
    axes.set_ylim(-0.45, 1.3)
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)


def _by_rule(document: Document, entry: Document) -> list[tuple[str, float]]:
    """FFR with each stress rule, in 0D or, of a study, in 3D."""
    if document["kind"] == "study":
        rows = [row for row in document["rows"] if row["condition"] == entry["condition"]]
        return [(row["rule"], row["fsi"]) for row in rows if row["fsi"] is not None]
    own = (entry["condition"], entry["law"], "calibrated")
    return [
        (run["rule"], run["ffr"])
        for run in document["runs"]
        if (run["condition"], run["law"], run["boundary"]) == own
    ]


def _measured(document: Document, condition: str) -> float | None:
    if document["kind"] == "study":
        return next(r["measured"] for r in document["rows"] if r["condition"] == condition)
    return document["conditions"][condition].get("measured_ffr")


def _causes(axes: Axes, entry: Document) -> None:
    """Share of each cause in the variance."""
    shown = [cause for cause in entry["causes"] if cause["share"] >= LEAST_SHARE]
    rest = 1.0 - sum(cause["share"] for cause in shown)
    names = [str(NAMES.get(cause["name"], cause["name"])) for cause in shown]
    shares = [100.0 * cause["share"] for cause in shown]
    if rest > 0.0005:
        names.append("all others")
        shares.append(100.0 * rest)
    axes.barh(range(len(names)), shares, color=COLOURS[0], height=0.6)
    for k, share in enumerate(shares):
        axes.text(share + 1.0, k, f"{share:.0f} %" if share >= 1.0 else "< 1 %", va="center")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 112.0)
    axes.set_title("Share of the variance")
    axes.set_xlabel("%")
    axes.grid(visible=False, axis="y")
