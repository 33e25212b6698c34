"""The lumen coloured by the local ratio as a plain picture, where a page cannot draw, and on paper.

The surface is drawn by matplotlib, farthest triangles first: nothing but a figure is needed.
"""

import io
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from study.report.style import COLOURS, GREY, RED, STYLE
from study.report.vessel_colours import low_end, ratio_colours

_SIZE, _DPI = (8.6, 3.7), 110  # inches, dots an inch
_PALE, _PALE_SHARE = (0.93, 0.94, 0.95), 0.72
"""Colour that vessels beside the artery fade to, and how far."""

_SHADE = 0.55
"""Share of light that falls on a face seen edge on."""


class PulledBack(NamedTuple):
    """A pull-back curve.

    Attributes:
        s_mm: distance from the ostium.
        ratio: ratio there [-].
    """

    s_mm: Float[np.ndarray, " places"]
    ratio: Float[np.ndarray, " places"]


class LookedAt(NamedTuple):
    """How the lumen is looked at.

    Attributes:
        focus: middle of the view [mm].
        toward: direction to the eye.
        up: what is up.
        half: half of the height of the view [mm].
    """

    focus: Float[np.ndarray, " 3"]
    toward: Float[np.ndarray, " 3"]
    up: Float[np.ndarray, " 3"]
    half: float


def lumen_picture(
    points: Float[np.ndarray, "nodes 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    ratio: Float[np.ndarray, " nodes"],
    beside: Bool[np.ndarray, " nodes"],
    view: LookedAt,
    title: str,
    limit: float,
    curve: PulledBack | None,
) -> bytes:
    """PNG file of the lumen and, where there is one, its pull-back curve.

    Args:
        points: nodes of the lumen [mm].
        triangles: of the lumen, their normals out of the blood.
        ratio: local ratio at the nodes [-].
        beside: nodes of other vessels than the artery, which are drawn paler.
        view: see `LookedAt`.
        title: of the picture.
        limit: the ratio that is marked [-].
        curve: see `PulledBack`.
    """
    low = low_end(float(ratio.min()), limit)
    with rc_context(STYLE):
        figure = Figure(figsize=_SIZE, dpi=_DPI, layout="constrained")
        parts = figure.subplots(1, 2 if curve else 1, squeeze=False)[0]
        colour = ratio_colours(ratio[triangles].mean(axis=1), low, limit)
        pale = np.where(beside[triangles].any(axis=1), _PALE_SHARE, 0.0)[:, None]
        colour = (1.0 - pale) * colour + pale * np.array(_PALE)
        _surface(parts[0], points[triangles], colour, view)
        _legend(parts[0], low, limit)
        if curve is not None:
            _curve(parts[1], curve, low, limit)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.0, fontweight="bold")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png")
    small = io.BytesIO()
    Image.open(buffer).convert("RGB").save(small, format="png", optimize=True)
    return small.getvalue()


def _surface(
    axes: Axes,
    corner: Float[np.ndarray, "triangles 3 3"],
    colour: Float[np.ndarray, "triangles 3"],
    view: LookedAt,
) -> None:
    side = np.cross(view.up, view.toward)
    side = side / np.linalg.norm(side)
    up = np.cross(view.toward, side)
    corner = (corner - view.focus) @ np.stack([side, up, view.toward], axis=1)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    facing = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    colour = colour * (_SHADE + (1.0 - _SHADE) * facing)[:, None]
    order = np.argsort(corner[:, :, 2].mean(axis=1))
    faces = PolyCollection(list(corner[order, :, :2]), facecolors=colour[order], linewidths=0.2)
    faces.set_edgecolor([tuple(one) for one in colour[order].tolist()])
    faces.set_rasterized(True)
    axes.add_collection(faces)
    axes.set(xlim=(-1.3 * view.half, 1.3 * view.half), ylim=(-view.half, view.half))
    axes.set_aspect("equal")
    axes.axis("off")


def _legend(axes: Axes, low: float, limit: float) -> None:
    bar = axes.inset_axes((0.02, 0.04, 0.045, 0.5))
    values = np.linspace(low, 1.0, 200)
    bar.imshow(
        ratio_colours(values, low, limit)[:, None], origin="lower", aspect="auto",
        extent=(0.0, 1.0, low, 1.0),
    )  # fmt: skip
    bar.axhline(limit, color="black", linewidth=1.2)
    bar.set_xticks([])
    bar.set_yticks([low, limit, 0.9, 1.0])
    bar.yaxis.tick_right()
    bar.set_title("local Pd/Pa", fontsize=8.5, fontweight="normal")
    bar.grid(visible=False)


def _curve(axes: Axes, curve: PulledBack, low: float, limit: float) -> None:
    axes.plot(curve.s_mm, curve.ratio, color=COLOURS[0])
    axes.axhline(limit, color=RED, linewidth=1.0, linestyle="--")
    place = (0.99, limit)
    axes.annotate(
        f"limit {limit:.2f}", place, (0, 3), ("axes fraction", "data"), "offset points",
        color=RED, ha="right", fontsize=8.5,
    )  # fmt: skip
    axes.set(ylim=(low, 1.01), xlabel="distance from the ostium [mm]", ylabel="local Pd/Pa")
    axes.tick_params(colors=GREY)
