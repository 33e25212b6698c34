"""The centre line of a vessel from a file: CSV, VMTK's poly lines (vtp), 3D Slicer's curves.

The first two may hold the radius of the lumen at each point: a fourth column, or VMTK's
`MaximumInscribedSphereRadius`.

Of poly lines with branches the longest is taken: from the source to the tip that lies farthest.
Centre lines of a coronary often begin in the aorta. Where the radii say so, the line is cut where
it first leaves the aorta's inscribed spheres,

    k₀ = min {k > J : |x_k − x_j| ≥ r_j for all j of A},  J = max W,  W = {j : r_j > 3 median(r)},

which is where the wall of the aorta would be without the coronary. The spheres A of the aorta
itself are those of W with r_j > 0.95 of W's median: on the way to the ostium they shrink and bulge
into the coronary.
"""

import os
import pathlib
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.mesh_files import (
    RADIUS,
    Axes,
    PolylineFile,
    read_markups,
    read_polylines,
    stated_axes,
    turned,
)
from jaxfsi.text_files import read_separated
from lumped.units import MM

WIDE = 3.0
"""Radius above which a point lies in the parent vessel, over the median of the line."""

_FULL = 0.95

_SPACING_RANGE_MM = (0.05, 5.0)
_LENGTH_RANGE_MM = (20.0, 400.0)
_RADIUS_RANGE_MM = (0.2, 40.0)


class SizedLine(NamedTuple):
    """The centre line of one vessel with its size.

    Attributes:
        points: in the order of the file [cm].
        radius: of the largest sphere in the lumen at each point [cm].
    """

    points: Float[np.ndarray, "points 3"]
    radius: Float[np.ndarray, " points"]


def read_centerline(
    path: str | os.PathLike[str], *, axes: Axes | None = None
) -> Float[np.ndarray, "points 3"]:
    """Read the centre line of one vessel.

    Args:
        path: a vtp file of poly lines in mm, a mrk.json file with one curve, or a text with one
            point x,y,z (or x,y,z,radius) in mm a line, separated by commas.
        axes: axes of the result, where the file states its own; None: as in the file.

    Returns:
        The points in cm, in the order of the file.

    Raises:
        ValueError: the file cannot be read, or spacing or length say that it is not in mm.
    """
    return _read(pathlib.Path(path), axes)[0]


def read_sized_line(path: str | os.PathLike[str], *, axes: Axes | None = None) -> SizedLine:
    """Read the centre line of one vessel with the radius of its lumen; arguments as above.

    Raises:
        ValueError: see `read_centerline`; or the file has no radii, or none of a vessel in mm.
    """
    path = pathlib.Path(path)
    points, radius = _read(path, axes)
    if radius is None:
        raise ValueError(
            f"{path}: the centre line has no radii. Save it as VTP with {RADIUS}, or as text with"
            " x, y, z, radius in mm on each line."
        )
    low, high = _RADIUS_RANGE_MM
    wrong = ~((radius >= low * MM) & (radius <= high * MM))
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise ValueError(
            f"{path}: the radius of point {k + 1} is {radius[k] / MM:g} mm, expected"
            f" {low:g}..{high:g} mm. Check that radii are in mm."
        )
    return SizedLine(points, radius)


def _read(
    path: pathlib.Path, axes: Axes | None
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, " points"] | None]:
    """Points and, where the file has them, radii [cm]."""
    radius: Float[np.ndarray, " points"] | None = None
    match path.suffix.lower():
        case ".vtp":
            file, said = read_polylines(path), stated_axes(path)
            nodes = _longest_nodes(file)
            points, sizes = file.points[nodes], file.radius
            radius = None if sizes is None else sizes[nodes]
        case ".json":
            points, said = _curve(path)
        case _:
            (points, radius), said = _text_points(path), None
    if axes is not None and said is not None:
        points = turned(points, said, axes)
    if len(points) < 4:
        raise ValueError(
            f"{path}: {len(points)} points, at least 4 are needed. Give the whole vessel."
        )
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    for what, value, (low, high) in (
        ("median spacing", float(np.median(steps)), _SPACING_RANGE_MM),
        ("length", float(np.sum(steps)), _LENGTH_RANGE_MM),
    ):
        if not low <= value <= high:
            raise ValueError(
                f"{path}: {what} {value:g} mm, expected {low:g}..{high:g} mm."
                " Check that x, y and z are in mm."
            )
    keep = np.concatenate([[True], steps > 0.0])
    return points[keep] * MM, None if radius is None else radius[keep] * MM


def _curve(path: pathlib.Path) -> tuple[Float[np.ndarray, "points 3"], Axes]:
    """Points of the one curve of a file of 3D Slicer, and their axes."""
    found = read_markups(path)
    curves = [markup for markup in found if markup.kind in ("Curve", "Line")] or list(found)
    if len(curves) > 1:
        raise ValueError(f"{path}: {len(curves)} curves. Save that of the vessel alone.")
    return curves[0].course(), curves[0].axes


def _text_points(
    path: pathlib.Path,
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, " points"] | None]:
    """Points and, where there is a fourth column, radii [mm]."""
    hint = "Expected one point a line: x, y, z (and radius) in mm, separated by commas."
    points, faults = [], []
    columns = 3
    for i, line in enumerate(read_separated(path, ",").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            point = [float(field) for field in line.split(",")]
        except ValueError:
            point = []
        if not points and len(point) == 4:
            columns = 4
        if len(point) != columns or not np.all(np.isfinite(point)):
            wanted = "three" if columns == 3 else "four"
            faults.append(f"line {i}: {line[:40]!r} is not {wanted} finite numbers")
        points.append(point)
    if faults:
        raise ValueError(f"{path}: {'; '.join(faults[:8])}. {hint}")
    if len(points) < 4:
        raise ValueError(f"{path}: {len(points)} points, at least 4 are needed. {hint}")
    values = np.array(points)
    return values[:, :3], values[:, 3] if columns == 4 else None


def longest_line(file: PolylineFile) -> Float[np.ndarray, "points 3"]:
    """Points of the longest line, its part within a wider parent vessel left out.

    Args:
        file: poly lines; their radii tell the parent vessel, without them nothing is left out.
    """
    return file.points[_longest_nodes(file)]


def _longest_nodes(file: PolylineFile) -> Int[np.ndarray, " nodes"]:
    """Nodes of that line."""

    def length(nodes: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(file.points[nodes], axis=0), axis=1).sum())

    nodes = max(file.lines, key=length)
    if file.radius is None:
        return nodes
    points, radius = file.points[nodes], file.radius[nodes]
    wide = radius > WIDE * np.median(radius)
    if wide[-1] and not wide[0]:  # from the tip to the source
        return nodes[::-1][outside_parent(points[::-1], radius[::-1], wide[::-1]) :][::-1]
    return nodes[outside_parent(points, radius, wide) :]


def outside_parent(
    points: Float[np.ndarray, "points 3"], radius: Float[np.ndarray, " points"], wide: np.ndarray
) -> int:
    """Index of the first point beyond the parent vessel, k₀ above; 0 where there is none.

    Args:
        points: of a line from its source.
        radius: of the inscribed spheres.
        wide: whether each sphere is one of the parent vessel.
    """
    if not wide.any():
        return 0
    last = int(np.flatnonzero(wide)[-1])
    full = wide & (radius > _FULL * np.median(radius[wide]))
    distance = np.linalg.norm(points[last + 1 :, None] - points[full], axis=2)
    outside = (distance >= radius[full]).all(axis=1)
    return last + 1 + int(outside.argmax()) if outside.any() else 0
