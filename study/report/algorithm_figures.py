"""Figures of a study as SVG text: ramp, calibration, waveforms with FFR, lumen, sensitivities."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lumped import MMHG
from lumped.units import ML_PER_MIN
from study.report.parameter_names import NAMES
from study.report.sensitivity_figures import sensitivity_figure
from study.report.style import COLOURS, GREY, INK, RED, STYLE, svg
from study.run.limits import FFR_THRESHOLD

Document = Mapping[str, Any]


def study_figures(document: Document) -> dict[str, str]:
    """All figures of a study's document, by name; those without data are left out."""
    drawn = {
        "ramp": ramp(document),
        "calibration": calibration(document),
        "waveforms": waveforms(document),
        "motion": motion(document),
        "deformation": deformation(document),
        "sensitivities": sensitivities(document),
        "fsi_sensitivities": sensitivity_figure(document),
    }
    return {name: text for name, text in drawn.items() if text}


def ramp(document: Document) -> str:
    """Drop over flow of the ramp, its curve, and the straight line that the paper takes for it."""
    part = document["ramp"]
    Q, drop = np.array(part["Q_cm3_per_s"]), np.array(part["drop_mmHg"])
    a, b, R0 = part["a"], part["b"], part["tangent_40_mmHg"]
    with rc_context(STYLE):
        figure = Figure(figsize=(6.6, 3.9), layout="constrained")
        axes = figure.add_subplot()
        fine = np.linspace(0.0, max(Q.max(), 1e-6) * 1.03, 200)
        axes.plot(Q / ML_PER_MIN, drop, color=INK, linewidth=3.0, alpha=0.35, label="3D ramp")
        axes.plot(
            fine / ML_PER_MIN,
            (a * fine + b * fine**2) / MMHG,
            color=COLOURS[0],
            label="curve a Q + b Q|Q|",
        )
        axes.plot(
            fine / ML_PER_MIN,
            R0 * fine / MMHG,
            color=COLOURS[1],
            linestyle=(0, (5, 2)),
            label="surrogate of the paper, R0 Q",
        )
        q40 = (R0 - a) / (2.0 * b) if b > 0.0 else 40.0 * MMHG / R0
        near = fine[fine > 0.55 * q40]
        axes.plot(
            near / ML_PER_MIN,
            40.0 + R0 * (near - q40) / MMHG,
            color=GREY,
            linewidth=1.0,
            label="its tangent at 40 mmHg",
        )
        axes.plot([q40 / ML_PER_MIN], [40.0], "o", color=GREY, markersize=5)
        axes.set_ylim(0.0, max(drop.max(), 40.0) * 1.12)
        axes.set_xlim(0.0, None)
        axes.set_xlabel("flow through the anomalous artery [mL/min]")
        axes.set_ylabel("pressure drop [mmHg]")
        axes.legend(loc="upper left")
        return svg(figure, "ramp")


def calibration(document: Document) -> str:
    """Resting ratio over α: the surrogates as curves, the runs in 3D as points."""
    target = document["rest_ratio_measured"]
    with rc_context(STYLE):
        figure = Figure(figsize=(6.6, 3.9), layout="constrained")
        axes = figure.add_subplot()
        for k, (law, curve) in enumerate(sorted(document["curves"].items())):
            name = "linear surrogate (the paper)" if law == "linear" else "curve surrogate"
            axes.plot(curve["alpha"], curve["rest_ratio"], color=COLOURS[1 - k], label=name)
        for k, entry in enumerate(document["calibrations"]):
            axes.plot(
                [entry["alpha"]],
                [entry["rest_ratio"]],
                "s" if entry["best"] else "o",
                color=RED if entry["best"] else INK,
                markersize=7,
                zorder=5,
            )
            axes.annotate(
                f" 3D: {entry['origin']}",
                (entry["alpha"], entry["rest_ratio"]),
                fontsize=8,
                color=INK,
                xytext=(5, -11 if k % 2 else 6),  # neighbours lie close
                textcoords="offset points",
            )
        axes.axhline(target, color=RED, linewidth=1.0, label="measured")
        axes.set_xscale("log")
        axes.set_xlabel("alpha, scale of the resistances of the outlet")
        axes.set_ylabel("resting Pd/Pa")
        axes.legend(loc="lower right")
        return svg(figure, "calibration")


def waveforms(document: Document) -> str:
    """Pressures of aorta and artery, rest and then stress, and the ratio of each cycle below.

    As figure 6 of Puelz et al. 2024.
    """
    runs = _shown(document)
    if not runs:
        return ""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 5.2), layout="constrained")
        pressure, ratio = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
        start = 0.0
        for k, run in enumerate(runs):
            wave = run["history"]
            t = start + np.array(wave["t_s"])
            if "t_site_s" in wave:
                aorta = (start + np.array(wave["t_site_s"]), wave["P_site_mmHg"])
            else:
                aorta = (t, wave["P_aorta_mmHg"])
            pressure.plot(*aorta, color=COLOURS[0], label="aorta" if k == 0 else None)
            pressure.plot(
                t,
                wave["P_distal_mmHg"],
                color=RED,
                label="behind the anomalous artery" if k == 0 else None,
            )
            for n, value in enumerate(run["ratios"]):
                left = start + n * run["period_s"]
                ratio.plot([left, left + run["period_s"]], [value] * 2, color=INK, linewidth=2.4)
                ratio.annotate(
                    f"{value:.3f}",
                    (left + run["period_s"] / 2.0, value),
                    xytext=(0, 5),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8.5,
                )
            pressure.text(
                start + 0.02, 1.0, _title(run),
                transform=pressure.get_xaxis_transform(),
                va="bottom", fontsize=9, color=INK, fontweight="bold",
            )  # fmt: skip
            start = float(t[-1])
            for axes in (pressure, ratio):
                axes.axvline(start, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        ratio.axhline(FFR_THRESHOLD, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        low = min(min(run["ratios"], default=1.0) for run in runs)
        ratio.set_ylim(min(low, FFR_THRESHOLD) - 0.06, 1.04)
        pressure.set_ylabel("pressure [mmHg]")
        ratio.set_ylabel("distal / aortic")
        ratio.set_xlabel("time [s]")
        figure.legend(loc="outside lower center", ncols=2)
        return svg(figure, "study-waveforms")


def _shown(document: Document) -> list[Document]:
    by_name = {run["folder"].split("/")[-1]: run for run in document["runs"]}
    return [by_name[name] for name in document["shown"] if name in by_name]


def _title(run: Document) -> str:
    rule = f"\nrule {run['rule']}" if run["rule"] else ""
    return f"{run['condition']}{rule}"


def motion(document: Document) -> str:
    """Lumen along the artery in diastole and systole, and where it is narrowest over the cycle."""
    parts = document["motion"]
    if not parts:
        return ""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 5.4), layout="constrained")
        grid = figure.subplots(2, 2, width_ratios=(1.2, 1.0))
        for k, (name, part) in enumerate(parts.items()):
            colour = (*COLOURS, "#8e6bb5", "#2f8f83")[k % 5]
            for row, what in enumerate(("area_mm2", "minor_mm")):
                values = _array(part[what])
                _profile(grid[row, 0], part, values, colour, name, image=k == 0, what=what)
                phase = np.array(part["t_s"]) / max(part["t_s"][-1], 1e-12)
                grid[row, 1].plot(phase, values[:, part["narrowest"]], color=colour, label=name)
        grid[0, 0].set_ylabel("lumen area [mm²]")
        grid[1, 0].set_ylabel("minor axis [mm]")
        grid[1, 0].set_xlabel("distance from the ostium [mm]")
        grid[1, 1].set_xlabel("phase of the cycle")
        grid[0, 1].set_title("at the narrowest place")
        grid[0, 0].set_title("range over the cycle; dashed: the image")
        handles, labels = grid[0, 1].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(parts), 4))
        return svg(figure, "motion")


def _profile(
    axes: Axes,
    part: Document,
    values: np.ndarray,
    colour: str,
    name: str,
    *,
    image: bool,
    what: str,
) -> None:
    s = np.array(part["s_mm"])
    order = np.argsort(s)
    # planes that no frame has cut are NaN in both
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    axes.fill_between(
        s[order], low[order], high[order], color=colour, alpha=0.35, linewidth=0, label=name
    )
    if image:
        key = {"area_mm2": "area_image_mm2", "minor_mm": "minor_image_mm"}[what]
        axes.plot(
            s[order], _array([part[key]])[0][order], color=INK, linestyle=(0, (4, 2)), linewidth=1.0
        )


_STATES = {"rest": "rest", "stress": "dobutamine"}
"""Condition of a study by the condition in the name of a state of contours."""


def deformation(document: Document) -> str:
    """Lumen in the 3D model over the cycle beside contours measured in diastole and systole."""
    states = document["measured_states"]
    by_condition = {run["condition"]: run["folder"].split("/")[-1] for run in _shown(document)}
    columns = [
        name
        for name in dict.fromkeys(state.split("_")[0] for state in states)
        if by_condition.get(_STATES.get(name, name)) in document["motion"]
    ]
    if len(states) < 2 or not columns:
        return ""
    with rc_context(STYLE):
        figure = Figure(figsize=(4.7 * len(columns), 5.8), layout="constrained")
        grid = figure.subplots(2, len(columns), sharex=True, sharey="row", squeeze=False)
        for k, name in enumerate(columns):
            condition = _STATES.get(name, name)
            part = document["motion"][by_condition[condition]]
            for axes, key in zip(grid[:, k], ("area_mm2", "minor_mm"), strict=True):
                _profile(
                    axes, part, _array(part[key]), COLOURS[0], "3D, over the cycle",
                    image=True, what=key,
                )  # fmt: skip
                for phase, colour in (("diastole", GREY), ("systole", RED)):
                    state = states.get(f"{name}_{phase}")
                    if state is not None:
                        axes.plot(
                            state["s_mm"], state[key], color=colour, linewidth=1.4,
                            marker="o", markersize=3, label=f"measured, {phase}",
                        )  # fmt: skip
            grid[0, k].set_title(condition)
            grid[1, k].set_xlabel("distance from the ostium [mm]")
        grid[0, 0].set_ylabel("lumen area [mm²]")
        grid[1, 0].set_ylabel("minor axis [mm]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        return svg(figure, "deformation")


def _array(rows: Sequence[Sequence[float | None]]) -> np.ndarray:
    return np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=float)


def sensitivities(document: Document) -> str:
    """Change of stress FFR for ten per cent more of each parameter, α held or tuned again."""
    entries = document["sensitivities"]
    if not entries:
        return ""
    names = sorted(
        {name for entry in entries for name in entry["recalibrated"] if name != "rest_ratio"},
        key=lambda name: -max(abs(e["recalibrated"].get(name, 0.0)) for e in entries),
    )[:10]
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 3.8), layout="constrained")
        panels = figure.subplots(1, len(entries), sharey=True, sharex=True, squeeze=False)[0]
        for axes, entry in zip(panels, entries, strict=True):
            for offset, key, colour in (
                (-0.2, "at_fixed_alpha", COLOURS[1]),
                (0.2, "recalibrated", COLOURS[0]),
            ):
                change = [entry["ffr"] * (1.1 ** entry[key].get(name, 0.0) - 1.0) for name in names]
                axes.barh(
                    np.arange(len(names)) + offset,
                    change,
                    height=0.36,
                    color=colour,
                    label={"at_fixed_alpha": "alpha held"}.get(key, "alpha tuned again"),
                )
            axes.axvline(0.0, color=INK, linewidth=0.8)
            axes.set_yticks(range(len(names)), [NAMES.get(name, name) for name in names])
            axes.set_xlabel("change of FFR for +10 %")
            axes.set_title(f"{entry['condition']}, FFR {entry['ffr']:.3f}")
        panels[0].invert_yaxis()
        panels[-1].legend(loc="lower right")
        return svg(figure, "study-sensitivities")
