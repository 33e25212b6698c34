"""A picture of imported recordings: which beats were used, and which were left out, and why."""

import pathlib
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study.case.catheter.beat_means import PHASES, ImportedCondition
from study.report.style import COLOURS, GREY, INK, RED, STYLE

_MOST_SAMPLES = 6000
_MOST_SECONDS = 40.0
_COLOUR = {"P_aorta": COLOURS[0], "P_distal": COLOURS[1]}


def draw_beats(conditions: Sequence[ImportedCondition], path: pathlib.Path) -> None:
    """Draw all recordings into one PNG file.

    Args:
        conditions: the recordings.
        path: the file to write.
    """
    with rc_context(STYLE):
        size = (13.0, 2.7 * len(conditions) + 0.4)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(
            len(conditions), 3, squeeze=False, gridspec_kw={"width_ratios": [4.0, 1.2, 1.2]}
        )
        for (left, middle, right), c in zip(grid, conditions, strict=True):
            _trace(left, c)
            _overlay(middle, c, "P_aorta", "aortic")
            _overlay(right, c, "P_distal", "distal")
        figure.savefig(path, format="png", dpi=110, metadata={"Software": None})


def _trace(axes: Axes, c: ImportedCondition) -> None:
    """The recording, the beats left out shaded with the reason."""
    t = c.trace.t
    # of a long one the stretch with the most beats left out tells most
    start = t[0]
    bad = [k for k, why in enumerate(c.beats.reason) if why]
    if t[-1] - t[0] > _MOST_SECONDS and bad:
        first = c.beats.onset[bad]
        counts = [((first >= s) & (first < s + _MOST_SECONDS)).sum() for s in first]
        start = min(float(first[int(np.argmax(counts))]) - 1.0, t[-1] - _MOST_SECONDS)
    shown = (t >= start) & (t <= start + _MOST_SECONDS)
    step = max(1, int(shown.sum()) // _MOST_SAMPLES)
    for name, colour in _COLOUR.items():
        axes.plot(t[shown][::step], c.trace.waves[name][shown][::step], color=colour, linewidth=0.8)
    top = float(c.trace.waves["P_aorta"][shown].max())
    for k in bad:
        onset, length = float(c.beats.onset[k]), float(c.beats.length[k])
        if start <= onset <= start + _MOST_SECONDS:
            axes.axvspan(onset, onset + length, color=RED, alpha=0.14, linewidth=0.0)
            axes.text(
                onset + 0.5 * length, top + 3.0, c.beats.reason[k], color=RED, fontsize=5.5,
                rotation=90.0, ha="center", va="bottom",
            )  # fmt: skip
    axes.set_xlim(start, min(start + _MOST_SECONDS, float(t[-1])))
    axes.set_ylim(top=top + 28.0 if bad else None)
    used, all_ = len(c.beats.used), len(c.beats.reason)
    part = "" if t[-1] - t[0] <= _MOST_SECONDS else f", {_MOST_SECONDS:.0f} s of {t[-1] - t[0]:.0f}"
    axes.set_title(f"{c.name}: {used} of {all_} beats used{part}, Pd/Pa {c.means.ratio:.3f}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("pressure [mmHg]")


def _overlay(axes: Axes, c: ImportedCondition, name: str, title: str) -> None:
    """All beats above each other, and their mean."""
    t, wave = c.trace.t, c.trace.waves[name]
    for used, colour, order in ((False, RED, 1), (True, GREY, 2)):
        for k, why in enumerate(c.beats.reason):
            if (why == "") == used:
                onset, length = c.beats.onset[k], c.beats.length[k]
                inside = (t >= onset) & (t < onset + min(length, 1.5 * c.means.period))
                axes.plot(
                    t[inside] - onset, wave[inside], color=colour, alpha=0.35, linewidth=0.5,
                    zorder=order,
                )  # fmt: skip
    phase = (np.arange(PHASES) + 0.5) / PHASES
    axes.plot(phase * c.means.period, c.means.mean_beat[name], color=INK, linewidth=1.4, zorder=3)
    axes.set_title(title)
    axes.set_xlabel("time from onset [s]")
