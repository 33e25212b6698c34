"""Thickness of a coronary wall from contours of its external elastic membrane.

Readers of ultrasound draw the membrane between media and adventitia beside the lumen. The wall is
what lies between both contours, intima and media: of frame k

    t_k = Σ_i w_i min |p_i − membrane_k| / Σ_i w_i,

the mean over the lumen's outline p_i of the distance to the membrane, with w_i the length of the
outline at p_i. It is one number a frame: how the thickness varies around the vessel is kept as its
least and greatest value.
"""

import os
import pathlib
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.contours import read_frames
from jaxfsi.polygons import inside_polygon
from lumped.units import MM

FEWEST_FRAMES = 3
"""Frames with both contours that are needed."""

_OUTSIDE_MM = 0.15
_OUTSIDE_SHARE = 0.03
_HEIGHT_MM = 0.05
_THINNEST_MM = 0.02
_MOST_SHOWN = 5


class ExternalWall(NamedTuple):
    """Thickness of the wall at the frames of a pullback [cm]; nan where a frame has no membrane.

    Attributes:
        mean: mean around the vessel.
        least: least around it.
        greatest: greatest around it.
    """

    mean: Float[np.ndarray, " frames"]
    least: Float[np.ndarray, " frames"]
    greatest: Float[np.ndarray, " frames"]

    def along(
        self, s_frames: Float[np.ndarray, " frames"], s: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Mean thickness [cm] at distances s from the ostium [cm]; constant beyond the frames.

        Args:
            s_frames: distance of each frame.
            s: distances that are wanted.
        """
        known = np.isfinite(self.mean)
        return np.interp(s, s_frames[known], self.mean[known])


def outline_distances(
    lumen: Float[np.ndarray, "points 2"], membrane: Float[np.ndarray, "corners 2"]
) -> Float[np.ndarray, " points"]:
    """Distance of each point from a closed polygon, negative outside of it.

    Args:
        lumen: the points.
        membrane: corners of the polygon, not closed by a repeated one.
    """
    start, way = membrane, np.roll(membrane, -1, axis=0) - membrane
    offset = lumen[:, None] - start
    length = np.maximum(np.sum(way**2, axis=1), 1e-30)
    share = np.clip(np.sum(offset * way, axis=2) / length, 0.0, 1.0)
    distance = np.linalg.norm(offset - share[..., None] * way, axis=2).min(axis=1)
    return np.where(inside_polygon(lumen, membrane), distance, -distance)


def read_external_wall(
    contours: str | os.PathLike[str], external: str | os.PathLike[str], numbers: np.ndarray
) -> ExternalWall:
    """Measure the wall between two files of contours.

    Args:
        contours: of the lumen, see `jaxfsi.contours.read_ivus_contours`.
        external: of the external elastic membrane, in the same form and coordinates; it may lack
            frames.
        numbers: frames in the order of the result.

    Raises:
        ValueError: a file cannot be read, too few frames have both, or a membrane does not
            surround its lumen, or all lie on it.
    """
    place = pathlib.Path(external)
    lumen, membrane = read_frames(pathlib.Path(contours)), read_frames(place)
    both = [int(n) for n in numbers if int(n) in membrane]
    if len(both) < FEWEST_FRAMES:
        raise ValueError(
            f"{place}: {len(both)} frames of the lumen have a membrane, at least {FEWEST_FRAMES}"
            " are needed. Give the contours of the same pullback."
        )
    values = np.full((3, len(numbers)), np.nan)
    faults = []
    for k, number in enumerate(int(n) for n in numbers):
        if number not in membrane:
            continue
        inner, outer = lumen[number], membrane[number]
        if abs(inner.z_mm - outer.z_mm) > _HEIGHT_MM:
            faults.append(f"frame {number} lies at z = {outer.z_mm:g}, that of the lumen at"
                          f" {inner.z_mm:g} mm")  # fmt: skip
            continue
        distance = outline_distances(inner.points_mm, outer.points_mm)
        crossing = distance < -_OUTSIDE_MM
        if crossing.mean() > _OUTSIDE_SHARE:
            faults.append(f"in frame {number} {crossing.mean():.0%} of the lumen lies outside")
            continue
        distance = np.maximum(distance, 0.0)
        sides = np.linalg.norm(np.roll(inner.points_mm, -1, axis=0) - inner.points_mm, axis=1)
        weight = 0.5 * (sides + np.roll(sides, 1))
        values[:, k] = float(weight @ distance / weight.sum()), distance.min(), distance.max()
    if not faults and np.nanmax(values[0]) < _THINNEST_MM:
        faults.append("the membrane lies on the lumen in every frame")
    if faults:
        more = f"; and {len(faults) - _MOST_SHOWN} more" if len(faults) > _MOST_SHOWN else ""
        raise ValueError(
            f"{place}: {'; '.join(faults[:_MOST_SHOWN])}{more}. Give the external membrane of the"
            " same pullback and phase, in the coordinates of the lumen."
        )
    return ExternalWall(*(MM * values))
