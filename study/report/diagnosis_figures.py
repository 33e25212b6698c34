"""Figures of a diagnosis, as SVG text that stands alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from diagnosis.where import PHASES
from study.report.diagnosis_lumen_figures import lumen_change
from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg

Document = Mapping[str, Any]

LARGEST_Z = 10.0
"""z at which a map's colour saturates."""

SMALLEST_BAR = 0.005
"""Probability below which a cause has no bar."""

_SITES = {
    "P_aorta": "aortic", "P_distal": "distal", "Q": "flow", "mean_P_aorta": "aortic mean",
    "mean_P_distal": "distal mean", "ffr": "ratio", "mean_Q": "mean flow",
}  # fmt: skip


def diagnosis_figures(document: Document) -> dict[str, str]:
    """All figures of a diagnosis, by name; those without data are left out."""
    drawn = {
        "causes": causes(document),
        "where": where_map(document["where"], "where"),
        "places": places(document),
        "waveforms": waveforms(document),
        "ladder": ladder(document),
        "lumen": lumen_change(document),
    }
    if document["where_after_rest_alone"]:
        drawn["where_rest"] = where_map(document["where_after_rest_alone"], "where-rest")
    return {name: text for name, text in drawn.items() if text}


def causes(document: Document) -> str:
    """Ranked bars of the probabilities."""
    shown = [(k, v) for k, v in document["probabilities"].items() if k != "other pairs"]
    always = {"none", "unknown"}
    top = [
        item
        for k, item in enumerate(shown)
        if k == 0 or (k < 6 and item[1] >= SMALLEST_BAR) or item[0] in always
    ]
    with rc_context(STYLE):
        figure = Figure(figsize=(7.4, 0.34 * len(top) + 0.9), layout="constrained")
        axes = figure.add_subplot()
        for k, (name, p) in enumerate(top):
            colour = GREY if name in always else COLOURS[0]
            axes.barh(k, p, color=colour, height=0.62)
            axes.text(p + 0.01, k, f"{p:.2f}", va="center", fontsize=8.5, color=INK)
        labels = {"none": "no gap", "unknown": "not in the catalogue"}
        names = [
            labels[n] if n in labels else n.replace("_", " ").replace("+", " + ") for n, _ in top
        ]
        axes.set_yticks(range(len(top)), names)
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.1)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("probability")
        return svg(figure, "causes")


def where_map(blocks: list[Mapping[str, Any]], name: str) -> str:
    """Misfit of every condition and site over phases and harmonics, in noise units."""
    if not blocks:
        return ""
    rows = sorted({(b["condition"], b["site"]) for b in blocks})
    order = [*PHASES, "mean", "harmonics 1-3", "harmonics 4-10", "harmonics above 10"]
    columns = [part for part in order if any(b["phase"] == part for b in blocks)]
    values = np.full((len(rows), len(columns)), np.nan)
    for b in blocks:
        values[rows.index((b["condition"], b["site"])), columns.index(b["phase"])] = b["z"]
    with rc_context(STYLE):
        figure = Figure(figsize=(8.2, 0.36 * len(rows) + 1.5), layout="constrained")
        axes = figure.add_subplot()
        image = axes.imshow(
            np.clip(values, 0.0, LARGEST_Z), cmap="OrRd", vmin=0.0, vmax=LARGEST_Z, aspect="auto"
        )
        for (i, j), z in np.ndenumerate(values):
            if np.isfinite(z):
                dark = z > 0.6 * LARGEST_Z
                text = f"{z:.0f}" if abs(z) >= 10 else f"{z:.1f}"
                axes.text(j, i, text, ha="center", va="center", fontsize=7.5,
                          color="white" if dark else INK)  # fmt: skip
        axes.set_xticks(range(len(columns)), [c.replace(" ", "\n", 1) for c in columns])
        axes.set_yticks(
            range(len(rows)), [f"{c.replace('_', ' ')}, {_SITES.get(s, s)}" for c, s in rows]
        )
        axes.grid(visible=False)
        figure.colorbar(image, ax=axes, label="misfit z [noise sd]", shrink=0.9)
        return svg(figure, name)


def places(document: Document) -> str:
    """Probability of a cause at each place of the model, above what a free forcing says."""
    probabilities, forcing = document["place_in_model"], document["free_forcing"]
    labels = ["no gap" if name == "none" else name for name in probabilities]
    with rc_context(STYLE):
        figure = Figure(figsize=(7.4, 3.2), layout="constrained")
        axes = figure.add_subplot()
        for k, (name, p) in enumerate(probabilities.items()):
            axes.barh(k - 0.18, p, color=GREY if name == "none" else COLOURS[0], height=0.34)
            axes.text(p + 0.01, k - 0.18, f"{p:.2f}", va="center", fontsize=8.5, color=INK)
            if name != "none":
                share = sum(v for place, v in forcing.items() if place.split()[-1] == name)
                axes.barh(k + 0.16, share, color="#c4cbd3", height=0.22)
        axes.set_yticks(range(len(probabilities)), labels)
        axes.invert_yaxis()
        axes.set_xlim(0.0, 1.1)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("probability that a cause acts there; grey: free forcing alone")
        return svg(figure, "places")


def waveforms(document: Document) -> str:
    """Distal pressure of every condition: measured, base model, with the cause."""
    entries = document["waveforms"]
    with rc_context(STYLE):
        figure = Figure(figsize=(8.6, 2.5 * ((len(entries) + 1) // 2) + 0.4), layout="constrained")
        grid = figure.subplots((len(entries) + 1) // 2, 2, squeeze=False).reshape(-1)
        for axes, entry in zip(grid, entries, strict=False):
            t, trace = np.array(entry["t_s"]), entry["traces"]["P_distal"]
            if trace["measured"] is not None:
                wave, sd = np.array(trace["measured"]), document["noise"]["pressure_sd_mmHg"]
                axes.fill_between(t, wave - 2 * sd, wave + 2 * sd, color="#dfe3e8", linewidth=0)
                axes.plot(t, wave, color=INK, linewidth=1.0, label="measured ± 2 sd")
            axes.plot(t, trace["before"], color=RED, linestyle=(0, (4, 2)), label="base model")
            axes.plot(t, trace["after"], color=COLOURS[0], label="after the diagnosis")
            held = " (held out)" if entry["held_out"] else ""
            axes.set_title(entry["condition"].replace("_", " ") + held)
            axes.set_xlabel("time [s]")
            axes.set_ylabel("distal pressure [mmHg]")
        for axes in grid[len(entries) :]:
            axes.set_visible(False)
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=3)
        return svg(figure, "diagnosis-waveforms")


def ladder(document: Document) -> str:
    """The gap of held-out conditions: base model, with the cause, noise floor."""
    labels = {
        "P_distal_rms_mmHg": "distal pressure, rms [mmHg]",
        "ffr_error": "error of FFR [-]",
    }
    held_out = document["gap"]["held_out"]
    kinds = [kind for kind in labels if any(h[kind] for h in held_out)]
    rows = [h for h in held_out if any(h[kind] for kind in kinds)]
    if not rows:
        return ""
    steps = (("before", RED, "base model"), ("after", COLOURS[0], "after the diagnosis"),
             ("noise_floor", GREY, "noise"))  # fmt: skip
    with rc_context(STYLE):
        figure = Figure(figsize=(8.2, 0.8 * len(rows) + 1.2), layout="constrained")
        grid = figure.subplots(1, len(kinds), squeeze=False).reshape(-1)
        for axes, kind in zip(grid, kinds, strict=True):
            digits = ".2f" if kind.startswith("P_") else ".3f"
            for k, row in enumerate(rows):
                for s, (step, colour, _) in enumerate(steps):
                    if row[kind] is not None:
                        value = row[kind][step]
                        axes.barh(k + 0.26 * (s - 1), value, height=0.22, color=colour)
                        axes.text(value, k + 0.26 * (s - 1), f" {value:{digits}}", va="center",
                                  fontsize=8)  # fmt: skip
            axes.set_yticks(range(len(rows)), [r["condition"].replace("_", " ") for r in rows])
            axes.invert_yaxis()
            axes.margins(x=0.18)
            axes.set_xlabel(labels[kind])
            axes.grid(visible=False, axis="y")
        from_steps = [figure.axes[0].barh(0, 0, color=c, label=text) for _, c, text in steps]
        figure.legend(handles=from_steps, loc="outside upper right", ncols=3)
        return svg(figure, "ladder")
