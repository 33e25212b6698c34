"""Points and curves of 3D Slicer, `.mrk.json`.

A file holds markups; each has its coordinate system and a list of control points with labels. A
curve runs through its control points; here it is a cubic spline over the chord length, sampled
every half millimetre. Slicer's own spline differs from it by less than the spacing of the points
where these follow the vessel.
"""

import json
import pathlib
from typing import Any, NamedTuple

import numpy as np
import scipy.interpolate
from jaxtyping import Float

from jaxfsi.mesh_files.axes import AXES, Axes
from jaxfsi.mesh_files.refusal import MeshFileError, reading
from jaxfsi.text_files import Malformed, read_text

SUFFIX = ".mrk.json"

_STEP_MM = 0.5
_MOST_POINTS = 100_000
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


class Markup(NamedTuple):
    """One list of points.

    Attributes:
        kind: `Fiducial`, `Curve`, `Line`, ...
        axes: of its coordinates.
        labels: name of each point.
        points: positions [mm].
    """

    kind: str
    axes: Axes
    labels: tuple[str, ...]
    points: Float[np.ndarray, "points 3"]

    def course(self) -> Float[np.ndarray, "samples 3"]:
        """Points along the curve [mm], half a millimetre apart."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        kept = self.points[np.concatenate([[True], steps > 0.0])]
        if len(kept) < 2:
            return kept
        chord = np.concatenate([[0.0], np.cumsum(steps[steps > 0.0])])
        s = np.linspace(0.0, chord[-1], max(int(np.ceil(chord[-1] / _STEP_MM)), 2) + 1)
        if self.kind == "Line" or len(kept) < 3:
            return np.stack([np.interp(s, chord, kept[:, i]) for i in range(3)], axis=1)
        return scipy.interpolate.CubicSpline(chord, kept)(s)


def read_markups(path: str | pathlib.Path) -> tuple[Markup, ...]:
    """Read the markups of a file that hold points.

    Args:
        path: a `.mrk.json` file.

    Raises:
        MeshFileError: it cannot be read, states no axes, or holds no points.
    """
    path = pathlib.Path(path)
    with reading(path, "markups of 3D Slicer"):
        document = json.loads(read_text(path))
        entries = document.get("markups") if isinstance(document, dict) else None
        if not isinstance(entries, list):
            raise Malformed("it has no list of markups")
        found = tuple(_markup(path, entry) for entry in entries)
    kept = tuple(markup for markup in found if len(markup.points))
    if not kept:
        raise MeshFileError(f"{path} holds no points. Place them in 3D Slicer and save it again.")
    return kept


def _markup(path: pathlib.Path, entry: Any) -> Markup:
    said = entry.get("coordinateSystem")
    axes: Axes | None = next((axes for axes in AXES if axes == said), None)
    if axes is None:
        raise MeshFileError(
            f"{path}: coordinateSystem is {said!r}, neither LPS nor RAS. Save it again with 3D"
            " Slicer 4.11 or later."
        )
    unit = entry.get("coordinateUnits", "mm")
    if unit not in _MM:
        raise MeshFileError(f"{path}: coordinates in {unit!r} are not known. Save them in mm.")
    control = [
        point
        for point in entry.get("controlPoints", [])
        if point.get("positionStatus", "defined") == "defined"
    ]
    if len(control) > _MOST_POINTS:
        raise Malformed(f"{len(control)} points are no course of a vessel")
    points = np.array([point["position"] for point in control], dtype=float).reshape(-1, 3)
    if not np.all(np.isfinite(points)):
        raise Malformed("a position is not finite")
    labels = tuple(str(point.get("label", "")) for point in control)
    return Markup(str(entry.get("type", "")), axes, labels, _MM[unit] * points)
