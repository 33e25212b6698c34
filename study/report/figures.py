"""Figures of a report, as SVG text that stands alone."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from lumped.units import ML_PER_MIN, MMHG
from study.case.laws import LINEAR, QUADRATIC
from study.report.parameter_names import NAMES
from study.report.style import COLOURS, GREY, INK, RED, STYLE, legend_below, svg
from study.run.limits import CATHETER_MM, FFR_THRESHOLD
from study.store.result_names import CALIBRATED, FIXED

Document = Mapping[str, Any]


def figures(document: Document) -> dict[str, str]:
    """All figures of a run's document, by name; those without data are left out."""
    drawn = {
        "overview": overview(document),
        "waveforms": waveforms(document),
        "alpha": alpha(document),
        "sensitivities": sensitivities(document),
    }
    if document["vessel"] is not None:
        drawn["lumen"] = lumen(document)
    return {name: svg for name, svg in drawn.items() if svg}


def overview(document: Document) -> str:
    """The pressure ratio of every condition under every reading, a point each."""
    names = list(document["conditions"])
    with rc_context(STYLE):
        figure = Figure(figsize=(8.2, 0.62 * len(names) + 1.15), layout="constrained")
        axes = figure.add_subplot()
        for k, name in enumerate(names):
            runs = [run for run in document["runs"] if run["condition"] == name]
            for run, offset in zip(runs, np.linspace(-0.24, 0.24, len(runs)), strict=True):
                axes.plot(_ratio(run), k + offset, linestyle="none", **_mark(document, run))
            measured = _measured(document, name)
            if measured is not None:
                axes.plot([measured] * 2, [k - 0.34, k + 0.34], color=RED, linewidth=2.0, zorder=1)
        axes.axvline(FFR_THRESHOLD, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=0)
        axes.text(
            FFR_THRESHOLD, -0.62, f" {FFR_THRESHOLD:.2f}", color=GREY, fontsize=8, va="center"
        )
        axes.set_yticks(range(len(names)), [name.capitalize() for name in names])
        axes.set_ylim(len(names) - 0.5, -0.75)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("mean distal over mean aortic pressure (FFR; at rest Pd/Pa)")
        figure.legend(handles=_overview_key(document), loc="outside right center")
        return svg(figure, "overview")


def _mark(document: Document, run: Mapping[str, Any]) -> dict[str, Any]:
    """Colour by rule, shape by law, hollow for the nominal outlet."""
    colour = INK if run["rule"] is None else _rule_colour(document, run["rule"])
    filled = run["boundary"] == CALIBRATED
    return {
        "marker": LAW_MARKS[run["law"]],
        "markersize": 7.0 if filled else 5.5,
        "markerfacecolor": colour if filled else "white",
        "markeredgecolor": colour,
        "markeredgewidth": 1.3,
    }


LAW_MARKS = {LINEAR: "o", QUADRATIC: "s"}


def _overview_key(document: Document) -> list[Line2D]:
    """One entry for each rule, law, outlet and, where there is one, the measurement."""

    def entry(label: str, **style: Any) -> Line2D:
        look = {"marker": "o", "linestyle": "none", "color": INK, "markersize": 6.5, **style}
        return Line2D([], [], label=label, **look)

    rules = list(dict.fromkeys(run["rule"] for run in document["runs"] if run["rule"]))
    laws = list(dict.fromkeys(run["law"] for run in document["runs"]))
    return [
        entry("measured", marker="", linestyle="-", color=RED, linewidth=2.0),
        *(entry(f'stress rule "{rule}"', color=_rule_colour(document, rule)) for rule in rules),
        *(entry(f"{law} law", marker=LAW_MARKS[law]) for law in laws),
        entry("calibrated outlet"),
        entry("nominal outlet", markerfacecolor="white", markersize=5.5),
    ]


def waveforms(document: Document) -> str:
    """Pressures, flow and the instantaneous ratio of every condition under the case's own law."""
    names = list(document["conditions"])
    with rc_context(STYLE):
        figure = Figure(figsize=(3.4 * max(len(names), 2), 6.6), layout="constrained")
        grid = figure.subplots(
            3, len(names), sharex="col", sharey="row", squeeze=False,
            height_ratios=(1.5, 1.2, 1.0),
        )  # fmt: skip
        handles: dict[str, Any] = {}
        for k, name in enumerate(names):
            handles |= _condition_column(document, name, list(grid[:, k]))
        grid[0, 0].set_ylabel("pressure [mmHg]")
        grid[1, 0].set_ylabel("coronary flow [mL/min]")
        grid[2, 0].set_ylabel("distal / aortic")
        legend_below(figure, list(handles.values()))
        return svg(figure, "waveforms")


def _condition_column(document: Document, name: str, column: Sequence[Axes]) -> dict[str, Any]:
    pressure, flow, ratio = column
    handles: dict[str, Any] = {}
    shown = [
        (wave, run)
        for wave, run in zip(document["waveforms"], document["runs"], strict=True)
        if run["condition"] == name
        and run["law"] == document["law"]
        # the nominal outlet under one rule is enough to compare with
        and (run["boundary"] == CALIBRATED or run["rule"] in (None, document["rule"]))
    ]
    text = []
    for wave, run in shown:
        style = _wave_style(document, run)
        t, P_aorta, P_distal, Q = (_closed(wave, key) for key in _WAVE_KEYS)
        (handles["aorta"],) = pressure.plot(t, P_aorta, color=RED, label="aorta", zorder=3)
        (handles[style["label"]],) = pressure.plot(t, P_distal, **style)
        flow.plot(t, Q, **style)
        ratio.plot(t, P_distal / P_aorta, **style)
        ratio.axhline(_ratio(run), color=style["color"], linewidth=0.9, linestyle=":")
        if run["boundary"] == CALIBRATED:
            text.append(f"{_ratio(run):.2f}")
    flow.axhline(0.0, color=GREY, linewidth=0.8)
    quantity = "resting ratio" if name == "rest" else "FFR"
    entry = document["conditions"][name]
    pressure.set_title(f"{name.capitalize()}: {quantity} {' / '.join(text)}")
    flow.set_title(
        f"{60.0 / entry['period_s']:.0f} beats/min, {entry['P_systolic_mmHg']:.0f}/"
        f"{entry['P_diastolic_mmHg']:.0f} mmHg",
        fontsize=8.5, fontweight="normal",
    )  # fmt: skip
    ratio.set_xlabel("time [s]")
    return handles


def _wave_style(document: Document, run: Mapping[str, Any]) -> dict[str, Any]:
    """Colour by rule; dashed and grey for the nominal outlet."""
    if run["boundary"] == FIXED:
        return {"color": GREY, "linestyle": "--", "label": "distal, nominal outlet"}
    if run["rule"] is None:
        return {"color": INK, "label": "distal, calibrated at rest"}
    label = f'distal, calibrated, "{run["rule"]}"'
    return {"color": _rule_colour(document, run["rule"]), "label": label}


_WAVE_KEYS = ("t_s", "P_aorta_mmHg", "P_distal_mmHg", "Q_ml_per_min")


def _closed(wave: Mapping[str, Any], key: str) -> np.ndarray:
    """A waveform over one whole cycle: the first sample repeated at its end."""
    values = np.asarray(wave[key])
    step = values[-1] - values[-2]
    return np.append(values, values[-1] + step if key == "t_s" else values[0])


def lumen(document: Document) -> str:
    """Area and minor axis along the vessel, and where its resistance sits."""
    vessel = document["vessel"]
    s = np.asarray(vessel["s_mm"])
    with rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.5), layout="constrained")
        along, parts = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
        share = 100.0 * np.asarray(vessel["a_frames"]) / vessel["a_viscous"]
        bars = along.bar(
            s, share, width=0.6 * np.median(np.diff(s)), color="#e3b9b4",
            label="share of the viscous resistance [%]",
        )  # fmt: skip
        (area,) = along.plot(
            s, vessel["area_mm2"], "o-", color=COLOURS[0], markersize=3.5, label="area [mm²]"
        )
        axis = along.twinx()
        axis.grid(visible=False)
        axis.spines["right"].set_visible(True)
        (minor,) = axis.plot(
            s, vessel["minor_axis_mm"], "s-", color=COLOURS[1], markersize=3.5,
            label="minor axis [mm], right",
        )  # fmt: skip
        floor = axis.axhline(
            CATHETER_MM, color=COLOURS[1], linewidth=1.0, linestyle=":",
            label=f"ultrasound catheter, {CATHETER_MM:g} mm",
        )  # fmt: skip
        axis.set_ylim(bottom=0.0)
        axis.set_ylabel("minor axis [mm]")
        along.set_ylim(bottom=0.0)
        along.set_xlabel("distance from the ostium [mm]")
        along.set_ylabel("area [mm²]; share [%]")
        along.set_title("Lumen along the artery", pad=34)
        along.legend(
            handles=[area, minor, floor, bars], ncols=2, loc="lower left",
            bbox_to_anchor=(-0.02, 0.995), borderaxespad=0.0,
        )  # fmt: skip
        _drop_parts(document, parts)
        return svg(figure, "lumen")


def _drop_parts(document: Document, axes: Axes) -> None:
    """Mean-flow pressure drop by cause, at the calibrated flow of each law at rest."""
    vessel = document["vessel"]
    run = _own_run(document, "rest", law=document["law"])
    flow = run["mean_flow_ml_per_min"]
    Q = flow * ML_PER_MIN
    parts = {
        "viscous, along the lumen": vessel["a_viscous"] * Q,
        "contraction at the ostium": vessel["b_contraction"] * Q**2,
        "entrance length": vessel["b_development"] * Q**2,
        "expansion": vessel["b_expansion"] * Q**2,
        "velocity head": vessel["b_head"] * Q**2,
    }
    values = [value / MMHG for value in parts.values()]
    axes.barh(list(parts), values, color="#7d9cb8")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    for k, value in enumerate(values):
        axes.text(max(value, 0.0), k, f" {value:.2f}", va="center", fontsize=8.5)
    axes.margins(x=0.18)
    axes.set_xlabel("drop [mmHg]")
    axes.set_title(f"Drop at {flow:.0f} mL/min: {sum(values):.1f} mmHg")


def alpha(document: Document) -> str:
    """Resting ratio over alpha for each law, with the measured value and the fixed boundary."""
    fits = {law: fit for law, fit in document["calibrations"].items() if "alpha" in fit}
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 2.9), layout="constrained")
        axes = figure.add_subplot()
        for (law, fit), colour in zip(fits.items(), COLOURS, strict=False):
            curve = document["calibration_curves"][law]
            axes.plot(curve["alpha"], curve["rest_ratio"], color=colour, label=f"{law} law")
            axes.plot(fit["alpha"], fit["rest_ratio"], "o", color=colour, markersize=8)
            axes.annotate(
                f"{fit['alpha']:.3g}", (fit["alpha"], fit["rest_ratio"]), color=colour,
                textcoords="offset points", xytext=(7, -12),
            )  # fmt: skip
        target = next(iter(fits.values()))["target"]
        axes.axhline(target, color=INK, linewidth=1.0, linestyle="--")
        axes.axvline(1.0, color=GREY, linewidth=1.0, linestyle=":")
        axes.text(
            1.0,
            0.02,
            "nominal outlet ",
            color=GREY,
            ha="right",
            transform=axes.get_xaxis_transform(),
        )
        axes.text(0.005, target, f"measured {target:g}", va="bottom", fontsize=8.5,
                  transform=axes.get_yaxis_transform())  # fmt: skip
        axes.set_xscale("log")
        axes.set_xlabel("alpha, scale of the outlet's resistances [-]")
        axes.set_ylabel("resting ratio")
        axes.legend(loc="lower right")
        return svg(figure, "alpha")


def sensitivities(document: Document, *, count: int = 9, least: float = 1e-5) -> str:
    """Change of FFR when a parameter grows by a tenth, alpha retuned or kept, by condition."""
    entries = [
        entry
        for entry in document["sensitivities"]
        if entry["condition"] != "rest"
        and entry["law"] == document["law"]
        and entry["rule"] == document["rule"]
    ]
    if not entries:
        return ""
    size: dict[str, float] = {}
    for entry in entries:
        for part in ("recalibrated", "at_fixed_alpha"):
            # the measured ratio cannot grow by a tenth: the report gives it by itself
            for name, slope in ((n, x) for n, x in entry[part].items() if n != "rest_ratio"):
                size[name] = max(size.get(name, 0.0), abs(slope))
    names = [n for n in sorted(size, key=lambda n: -size[n]) if size[n] > least][:count]
    with rc_context(STYLE):
        figure = Figure(
            figsize=(1.9 + 3.6 * len(entries), 0.36 * len(names) + 1.3), layout="constrained"
        )
        grid = figure.subplots(1, len(entries), sharey=True, sharex=True, squeeze=False)[0]
        y = np.arange(len(names))
        for axes, entry in zip(grid, entries, strict=True):
            ffr = _own_run(document, entry["condition"], law=entry["law"])["ffr"]
            for part, colour, offset, label in (
                ("recalibrated", COLOURS[0], -0.19, "alpha tuned again to the resting ratio"),
                ("at_fixed_alpha", "#b9c4cf", 0.19, "alpha kept"),
            ):
                change = [ffr * (1.1 ** entry[part].get(name, 0.0) - 1.0) for name in names]
                axes.barh(y + offset, change, height=0.36, color=colour, label=label)
            axes.axvline(0.0, color=INK, linewidth=0.8)
            axes.set_title(entry["condition"].capitalize())
            axes.set_xlabel("change of FFR for +10 %")
            axes.xaxis.set_major_locator(MaxNLocator(4))
            axes.grid(visible=False, axis="y")
        grid[0].set_yticks(y, [NAMES.get(name, name) for name in names])
        grid[0].invert_yaxis()
        handles = grid[0].get_legend_handles_labels()[0]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
        return svg(figure, "sensitivities")


def _rule_colour(document: Document, rule: str) -> str:
    rules = list(dict.fromkeys(run["rule"] for run in document["runs"] if run["rule"]))
    return COLOURS[rules.index(rule) % len(COLOURS)]


def _ratio(run: Mapping[str, Any]) -> float:
    return run["rest_ratio"] if run["condition"] == "rest" else run["ffr"]


def _measured(document: Document, name: str) -> float | None:
    return document["conditions"][name]["measured_rest_ratio" if name == "rest" else "measured_ffr"]


def _own_run(document: Document, condition: str, *, law: str) -> Mapping[str, Any]:
    """The calibrated run of a condition under a law and the case's own rule."""
    rule = None if condition == "rest" else document["rule"]
    return next(
        run
        for run in document["runs"]
        if (run["condition"], run["law"], run["rule"]) == (condition, law, rule)
        and run["boundary"] == CALIBRATED
    )
