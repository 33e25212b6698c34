"""The ends of a vessel from points that were placed in 3D Slicer."""

import os
import pathlib
import re

from jaxfsi.mesh_files import UNITS_CM, Axes, read_markups, turned
from lumped.units import MM

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")


def opening_points(
    path: str | os.PathLike[str], *, unit: str, axes: Axes | None
) -> dict[str, tuple[float, float, float]]:
    """Points near the ends of a vessel by name.

    Args:
        path: a mrk.json file; the labels of its points are the names of the ends.
        unit: of the result, ``cm`` or ``mm``.
        axes: of the result.

    Raises:
        ValueError: the file cannot be read, labels are no names, or nothing says what the axes of
            the surface are.
    """
    path = pathlib.Path(path)
    markups = read_markups(path)
    if axes is None:
        raise ValueError(
            f"{path}: its points are in {markups[0].axes}, but nothing says the axes of the"
            f' surface. Add axes = "{markups[0].axes}" below [anatomy] where it is in the same.'
        )
    found: dict[str, tuple[float, float, float]] = {}
    for markup in markups:
        points = turned(markup.points, markup.axes, axes) * (MM / UNITS_CM[unit])
        for label, (x, y, z) in zip(markup.labels, points.tolist(), strict=True):
            if not _NAME.fullmatch(label) or label in found:
                raise ValueError(
                    f"{path}: {label!r} cannot name an end. Label each point once, such as"
                    " aorta_inlet, aorta_outlet, anomalous_outlet."
                )
            found[label] = (x, y, z)
    return found
