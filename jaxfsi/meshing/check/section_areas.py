"""Lumen areas of a mesh against those that were asked for, section by section along a vessel.

A plane across the vessel's axis cuts the interface triangles in a polygon; its area is compared
with the measured contour of that frame, or with the implicit lumen cut by the same plane. The
corners of the polygon lie on the lumen, so a coarse mesh loses area: of a circle cut into n
chords about 6.6/n².
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.anatomy import Anatomy
from jaxfsi.anatomy.sections import (
    centerline_point,
    lumen_outline,
    measured_section,
    surface_outline,
)
from jaxfsi.mesh import INTERFACE, Mesh

_ENDS = 0.03  # share of the axis left out at both ends, where planes meet ostium or opening
_GRID = 81
_ALIKE = 0.15  # largest difference between the ends of two outlines over the local radius
_SQUARES = (2.0, 3.2, 5.2, 8.5)  # half width of the searched square over the local radius


class SectionAreas(NamedTuple):
    """Lumen areas along one vessel; nan where a plane gives no closed section.

    Attributes:
        vessel: name of its centerline.
        s: places along it [cm].
        asked: area of contour or implicit lumen [cm²].
        meshed: area of the mesh [cm²].
        outlines: pieces of the asked and of the meshed outline in the plane [cm]; empty arrays
            where there is none.
    """

    vessel: str
    s: Float[np.ndarray, " places"]
    asked: Float[np.ndarray, " places"]
    meshed: Float[np.ndarray, " places"]
    outlines: list[tuple[Float[np.ndarray, "_ 2 2"], Float[np.ndarray, "_ 2 2"]]]

    @property
    def error(self) -> Float[np.ndarray, " places"]:
        """Meshed over asked area, less one."""
        return self.meshed / self.asked - 1.0

    @property
    def largest_error(self) -> float:
        """Largest absolute error of the places that have one; nan if none has."""
        known = np.abs(self.error[np.isfinite(self.error)])
        return float(np.max(known)) if len(known) else float("nan")


def section_areas(
    mesh: Mesh, anatomy: Anatomy, *, vessel: str = "anomalous", n_places: int = 24
) -> SectionAreas:
    """Compare lumen areas of a mesh with its anatomy along a vessel.

    Places between frames count only where both outlines belong to one vessel; frames always do.

    Args:
        mesh: mesh of the anatomy.
        anatomy: where its ``meta`` holds ``s_frames`` and ``area_frames`` of the anomalous vessel,
            the frames are the places and their contours what was asked.
        vessel: name of the centerline.
        n_places: number of places where there are no frames.

    Raises:
        ValueError: the anatomy has no such centerline.
    """
    if vessel not in anatomy.centerlines:
        raise ValueError(
            f"{anatomy.name} has no centerline {vessel!r}; it has"
            f" {', '.join(anatomy.centerlines)}. Use one of these."
        )
    line = anatomy.centerlines[vessel]
    frames = anatomy.meta.get("s_frames") if vessel == "anomalous" else None
    if frames is not None:
        s = np.asarray(frames, dtype=float)
        contours = np.asarray(anatomy.meta["area_frames"], dtype=float)
    else:
        s = line.s[0] + (line.s[-1] - line.s[0]) * np.linspace(_ENDS, 1.0 - _ENDS, n_places)
        contours = None
    triangles = mesh.labelled(INTERFACE)
    asked, meshed, outlines = np.full(len(s), np.nan), np.full(len(s), np.nan), []
    for i, place in enumerate(s):
        centre, tangent = centerline_point(line, float(place))
        wanted = _asked_outline(anatomy, centre, tangent)
        obtained = _meshed_outline(mesh, triangles, centre, tangent)
        outlines.append((wanted, obtained))
        if (
            len(wanted)
            and len(obtained)
            and (
                contours is not None
                or _alike(wanted, obtained, float(anatomy.local_radius(centre[None])[0]))
            )
        ):
            asked[i] = measured_section(wanted).area if contours is None else contours[i]
            meshed[i] = measured_section(obtained).area
    return SectionAreas(vessel, s, asked, meshed, outlines)


def _alike(
    wanted: Float[np.ndarray, "n 2 2"], obtained: Float[np.ndarray, "m 2 2"], radius: float
) -> bool:
    """Whether two outlines end at the same places.

    Where vessels join, one outline may hold a second vessel that the other leaves out; and the
    implicit lumen goes on beyond the openings where the mesh ends.
    """
    ends = [np.stack([x.min(axis=(0, 1)), x.max(axis=(0, 1))]) for x in (wanted, obtained)]
    return float(np.max(np.abs(ends[0] - ends[1]))) < _ALIKE * radius


def _asked_outline(
    anatomy: Anatomy, centre: Float[np.ndarray, " 3"], normal: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "n 2 2"]:
    """Outline of the implicit lumen; empty where the plane runs into another vessel."""
    radius = float(anatomy.local_radius(centre[None])[0])
    for factor in _SQUARES:
        try:
            return lumen_outline(
                anatomy.lumen, centre, normal, half_width=factor * radius, n_points=_GRID
            )
        except ValueError:
            continue
    return np.zeros((0, 2, 2))


def _meshed_outline(
    mesh: Mesh,
    triangles: np.ndarray,
    centre: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "n 2 2"]:
    try:
        return surface_outline(mesh.points, triangles, centre, normal)
    except ValueError:
        return np.zeros((0, 2, 2))
