"""Figures fit their canvas."""

import numpy as np
import pytest
from matplotlib import rc_context

import study.report.figures as figures
from study.report.style import STYLE


def _document(names):
    """A run of the case's own law under some conditions, both outlets, both rules."""
    t = np.linspace(0.0, 0.7, 8)
    keys = ("t_s", "P_aorta_mmHg", "P_distal_mmHg", "Q_ml_per_min")
    wave = dict(zip(keys, (t.tolist(), *([(80.0 + t).tolist()] * 3)), strict=True))
    runs = []
    for name in names:
        for rule in [None] if name == "rest" else ["printed", "all"]:
            for boundary in (figures.CALIBRATED, figures.FIXED):
                run = {"condition": name, "law": "linear", "rule": rule, "boundary": boundary}
                runs.append({**run, "rest_ratio": 0.9, "ffr": 0.8})
    entry = {"period_s": 0.8, "P_systolic_mmHg": 110.0, "P_diastolic_mmHg": 65.0}
    return {
        "law": "linear",
        "rule": "printed",
        "conditions": dict.fromkeys(names, entry),
        "runs": runs,
        "waveforms": [wave] * len(runs),
    }


@pytest.mark.parametrize(
    "names", [("rest",), ("rest", "dobutamine"), ("rest", "dobutamine", "adenosine")]
)
def test_legend_of_the_waveforms_lies_inside_the_figure(names, monkeypatch):
    drawn = []
    monkeypatch.setattr(figures, "svg", lambda figure, name: drawn.append(figure) or "")
    figures.waveforms(_document(names))
    (figure,) = drawn
    with rc_context(STYLE):
        figure.draw_without_rendering()
        (legend,) = figure.legends
        box = legend.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.width
    assert box.y0 >= 0.0
    assert len(legend.get_texts()) == (3 if len(names) == 1 else 5)
    lowest = min(axes.get_tightbbox().y0 for axes in figure.axes)
    assert box.y1 <= lowest + 1.0
