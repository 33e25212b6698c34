"""Figures of a cohort as SVG text: parity and Bland-Altman plots, fixed beside calibrated.

As the agreement figures of Puelz et al. 2024 for rest, adenosine and dobutamine: left arteries
blue, right ones red.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.report.number_formats import signed
from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg
from study.run.limits import FFR_THRESHOLD
from study.store.result_names import CALIBRATED, FIXED, FIXED_0D

Document = Mapping[str, Any]

_COLOUR = {"left": COLOURS[0], "right": RED, None: INK}
_WORDS = {
    FIXED: "fixed outlet",
    FIXED_0D: "fixed outlet, 0D",
    CALIBRATED: "calibrated outlet",
}


def cohort_figures(document: Document) -> dict[str, str]:
    """One figure a condition and rule, by `condition` or `condition, rule`."""
    settings = dict.fromkeys((g["condition"], g["rule"]) for g in document["groups"])
    return {
        condition if rule is None else f"{condition}, rule {rule}": agreement_figure(
            document, condition, rule
        )
        for condition, rule in settings
    }


def interval_figure(document: Document) -> str:
    """Medians and intervals over measured FFR, one panel a condition; empty without them."""
    every = [e for e in document.get("intervals", []) if e["measured"] is not None]
    conditions = list(dict.fromkeys(e["condition"] for e in every))
    if not every:
        return ""
    low = min(min(e["low"], e["measured"]) for e in every) - 0.03
    limits = (low, max(max(e["high"], e["measured"]) for e in every) + 0.02)
    with rc_context(STYLE):
        figure = Figure(figsize=(4.4 * len(conditions), 4.2), layout="constrained")
        for axes, condition in zip(
            figure.subplots(1, len(conditions), squeeze=False)[0], conditions, strict=True
        ):
            entries = [e for e in every if e["condition"] == condition]
            axes.axvline(FFR_THRESHOLD, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
            axes.axhline(FFR_THRESHOLD, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
            axes.plot(limits, limits, color=GREY, linewidth=1.0)
            for entry in entries:
                colour = _COLOUR[entry["side"]]
                axes.plot(
                    [entry["measured"]] * 2, [entry["low"], entry["high"]], color=colour,
                    linewidth=2.0, alpha=0.45,
                )  # fmt: skip
                axes.plot(entry["measured"], entry["median"], "o", color=colour, markersize=5.0)
            inside = sum(e["low"] <= e["measured"] <= e["high"] for e in entries)
            axes.set_xlim(*limits)
            axes.set_ylim(*limits)
            axes.set_aspect("equal")
            axes.set_xlabel("measured")
            axes.set_ylabel("predicted, 90 %")
            axes.set_title(f"{condition}: {inside} of {len(entries)} inside")
        return svg(figure, "cohort-intervals")


def agreement_figure(document: Document, condition: str, rule: str | None) -> str:
    """Parity above, Bland-Altman below; fixed outlet left, calibrated right."""
    known = {
        g["boundary"]: g["n"]
        for g in document["groups"]
        if (g["condition"], g["rule"]) == (condition, rule)
    }
    whole = known.get(FIXED, 0) >= known.get(FIXED_0D, 0)
    boundaries = [b for b in (FIXED if whole else FIXED_0D, CALIBRATED) if b in known]
    every = [
        p
        for p in document["pairs"]
        if (p["condition"], p["rule"]) == (condition, rule) and p["measured"] is not None
    ]
    values = [p["predicted"] for p in every] + [p["measured"] for p in every]
    low, high = min(values) - 0.03, max(max(values) + 0.02, 1.0)
    span = 1.15 * max([abs(p["predicted"] - p["measured"]) for p in every] + [0.02])
    with rc_context(STYLE):
        figure = Figure(figsize=(4.4 * len(boundaries), 7.2), layout="constrained")
        grid = figure.subplots(2, len(boundaries), squeeze=False)
        for k, boundary in enumerate(boundaries):
            group = next(g for g in document["groups"] if _is(g, condition, rule, boundary))
            pairs = [p for p in every if p["boundary"] == boundary]
            _parity(grid[0, k], pairs, group, (low, high))
            _bland_altman(grid[1, k], pairs, group, span)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        figure.legend(
            list(unique.values()), list(unique), loc="outside lower center", ncols=len(unique)
        )
        return svg(figure, f"cohort-{condition}-{rule}")


def _is(group: Document, condition: str, rule: str | None, boundary: str) -> bool:
    return (group["condition"], group["rule"], group["boundary"]) == (condition, rule, boundary)


def _points(axes: Axes, pairs: Sequence[Document], x: Sequence[float], y: Sequence[float]) -> None:
    for side, colour in _COLOUR.items():
        chosen = [i for i, p in enumerate(pairs) if p["side"] == side]
        if chosen:
            axes.plot(
                [x[i] for i in chosen],
                [y[i] for i in chosen],
                "o",
                color=colour,
                markersize=6,
                label=f"{side} artery" if side else "patients",
                zorder=5,
            )


def _parity(
    axes: Axes, pairs: Sequence[Document], group: Document, limits: tuple[float, float]
) -> None:
    axes.plot(limits, limits, color=GREY, linewidth=1.0)
    _points(axes, pairs, [p["measured"] for p in pairs], [p["predicted"] for p in pairs])
    axes.set_xlim(*limits)
    axes.set_ylim(*limits)
    axes.set_aspect("equal")
    axes.set_xlabel("measured")
    axes.set_ylabel("predicted")
    r = "" if group["r"] is None else f", r = {group['r']:.2f}"
    title = f"{_WORDS[group['boundary']]}: RMSE = {group['rmse']:.3f}{r}"
    axes.set_title(title)


def _bland_altman(axes: Axes, pairs: Sequence[Document], group: Document, span: float) -> None:
    mean = [(p["measured"] + p["predicted"]) / 2.0 for p in pairs]
    error = [p["predicted"] - p["measured"] for p in pairs]
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.axhline(group["bias"], color=INK, linewidth=1.4)
    notes = [f"bias {signed(group['bias'], 3)}"]
    if group["sd"] is not None:
        for limit in (group["low"], group["high"]):
            axes.axhline(limit, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
        span = max(span, 1.15 * max(abs(group["low"]), abs(group["high"])))
        notes.append(f"limits {signed(group['low'], 3)} to {signed(group['high'], 3)}")
    _points(axes, pairs, mean, error)
    axes.set_ylim(-span, span)
    middle = float(np.mean(mean))
    reach = max(0.03, 1.2 * max(abs(value - middle) for value in mean))
    axes.set_xlim(middle - reach, middle + reach)
    axes.set_xlabel("mean of predicted and measured")
    axes.set_ylabel("predicted − measured")
    axes.set_title(", ".join(notes))
