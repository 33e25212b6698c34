"""Figures of what moves the ratio of a 3D run: parameters, and pieces of the lumen."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.report.parameter_names import NAMES
from study.report.style import COLOURS, INK, STYLE, svg

Document = Mapping[str, Any]

_NAMES = {
    **NAMES,
    "P_systolic": "systolic pressure",
    "P_diastolic": "diastolic pressure",
    "E": "wall, Young's modulus",
    "nu": "wall, Poisson's ratio (+1 %)",
    "thickness": "wall, thickness",
    "P_image": "pressure in the image",
    "rho_f": "blood, density",
    "mu": "blood, viscosity",
    "stress_R_proximal": "stress factor of R_c (aorta)",
    "stress_R_distal": "stress factor of R_s (aorta)",
    "stress_C": "stress factor of C_s (aorta)",
}
_SHARE = {"nu": 0.01}
"""Growth of a parameter where ten per cent are too many: ν ends at a half."""


def sensitivity_figure(document: Document) -> str:
    """Change of the ratio for more of each parameter, and for a wider lumen along the artery."""
    entries = document.get("fsi_sensitivities") or []
    if not entries:
        return ""
    names = sorted(
        {name for entry in entries for name in entry["at_fixed_alpha"]},
        key=lambda name: -max(abs(change_of(e, "at_fixed_alpha", name)) for e in entries),
    )
    names = [
        n for n in names if any(abs(change_of(e, "at_fixed_alpha", n)) > 1e-9 for e in entries)
    ]
    with rc_context(STYLE):
        figure = Figure(figsize=(9.4, 4.4 * len(entries)), layout="constrained")
        grid = figure.subplots(len(entries), 2, squeeze=False, width_ratios=(1.25, 1.0))
        for (left, right), entry in zip(grid, entries, strict=True):
            _bars(left, entry, names)
            _pieces(right, entry)
        return svg(figure, "fsi-sensitivities")


def change_of(entry: Document, key: str, name: str) -> float:
    """Change of the ratio for ten per cent more of a parameter (one per cent of ν)."""
    slope = (entry[key] or {}).get(name, 0.0)
    return entry["ratio"] * ((1.0 + _SHARE.get(name, 0.1)) ** slope - 1.0)


def _bars(axes: Axes, entry: Document, names: list[str]) -> None:
    kinds = [("at_fixed_alpha", "alpha held", COLOURS[1])]
    if entry["recalibrated"]:
        kinds.append(("recalibrated", "alpha tuned again", COLOURS[0]))
    height = 0.8 / len(kinds)
    for k, (key, label, colour) in enumerate(kinds):
        change = [change_of(entry, key, name) for name in names]
        places = np.arange(len(names)) + (k - 0.5 * (len(kinds) - 1)) * height
        axes.barh(places, change, height=0.9 * height, color=colour, label=label)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(names)), [_NAMES.get(name, name) for name in names])
    axes.invert_yaxis()
    axes.set_xlabel("change of the ratio for +10 %")
    axes.set_title(f"{entry['condition']}, ratio {entry['ratio']:.3f}")
    axes.legend(loc="lower right")


def _pieces(axes: Axes, entry: Document) -> None:
    part = entry["lumen"]
    if part is None:
        axes.set_axis_off()
        return
    edges = np.array(part["edges_mm"])
    axes.bar(
        (edges[:-1] + edges[1:]) / 2.0,
        part["wider_0.1_mm"],
        width=0.9 * np.diff(edges),
        color=COLOURS[0],
    )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_xlabel("distance from the ostium [mm]")
    axes.set_ylabel("change of the ratio, this millimetre wider by 0.1 mm")
    axes.set_title(f"all of the artery: {part['whole_wider_0.1_mm']:+.3f}")
