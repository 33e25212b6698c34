"""What a wire drawn back through the anomalous artery would read: pressure and lumen on its way.

A section is a plane across the axis in the reference shape. Its ring of material points on the
lumen moves with the wall; the pressure of a section is that of its ring, each point weighed by its
share of the outline. Area and minor axis are those of `jaxfsi.fields.lumen_sections.lumen_at`.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy import Anatomy, centerline_point
from jaxfsi.anatomy.sections import Ring, surface_ring
from jaxfsi.fields.lumen_cycle import LumenCycle
from jaxfsi.fields.lumen_sections import Planes, artery_planes, lumen_at
from jaxfsi.mesh import INTERFACE, Mesh
from jaxfsi.opening import ANOMALOUS

_SPACING = 0.05
"""Between sections where the anatomy has no contours of its own [cm]."""


class SectionSeries(NamedTuple):
    """Sections of the artery over a cycle.

    Attributes:
        s: distance from the ostium [cm].
        rings: of each section, as indices into the nodes of the lumen.
        area_image: area in the reference shape [cm²].
        minor_image: minor axis there [cm].
        area: area in each frame [cm²]; nan where a plane finds no lumen.
        minor: minor axis in each frame [cm].
    """

    s: Float[np.ndarray, " places"]
    rings: list[Ring]
    area_image: Float[np.ndarray, " places"]
    minor_image: Float[np.ndarray, " places"]
    area: Float[np.ndarray, "frames places"]
    minor: Float[np.ndarray, "frames places"]

    def read(
        self, values: Float[np.ndarray, "*times nodes"], points: Float[np.ndarray, "nodes 3"]
    ) -> Float[np.ndarray, "*times places"]:
        """A field of the lumen in each section.

        Args:
            values: at the nodes of the lumen.
            points: where these are in the reference shape [cm].
        """
        return np.stack([_ring_mean(ring, values, points) for ring in self.rings], axis=-1)


def pullback(mesh: Mesh, anatomy: Anatomy, cycle: LumenCycle) -> SectionSeries | None:
    """Sections from the ostium to the outlet, those of the anatomy's contours among them.

    Args:
        mesh: the mesh.
        anatomy: its anatomy.
        cycle: the lumen over a cycle.

    Returns:
        None where the anatomy has no axis of the artery, or no plane finds a closed lumen.
    """
    planes = _all_planes(anatomy)
    if planes is None:
        return None
    kept, rings = [], []
    triangles = mesh.labelled(INTERFACE)
    for k, (centre, normal) in enumerate(zip(planes.centre, planes.normal, strict=True)):
        try:
            ring = surface_ring(mesh.points, triangles, centre, normal)
        except ValueError:
            continue
        kept.append(k)
        low, high = (np.searchsorted(cycle.nodes, nodes) for nodes in (ring.low, ring.high))
        rings.append(Ring(low, high, ring.share))
    if not kept:
        return None
    planes = Planes(*(values[kept] for values in planes))
    moved, sizes = np.zeros_like(mesh.points), []
    for shift in (np.zeros_like(cycle.points), *cycle.moved):
        moved[cycle.nodes] = shift
        sizes.append(lumen_at(mesh, planes, moved))
    area, minor = (np.array(values) for values in zip(*sizes, strict=True))
    return SectionSeries(planes.s, rings, area[0], minor[0], area[1:], minor[1:])


def _all_planes(anatomy: Anatomy) -> Planes | None:
    """Planes at the contours of the anatomy, and evenly between and beyond them."""
    own = artery_planes(anatomy)
    if own is None:
        return None
    line = anatomy.centerlines[ANOMALOUS]
    contours = own.s if "s_frames" in anatomy.meta else np.zeros(0)
    n = max(2, round(float(line.s[-1]) / _SPACING) + 1)
    between = np.linspace(0.0, float(line.s[-1]), n)
    if len(contours):
        apart = np.abs(between[:, None] - contours[None]).min(axis=1)
        between = between[apart > 0.5 * _SPACING]
    s = np.sort(np.concatenate([contours, between]))
    places = [centerline_point(line, float(x)) for x in s]
    return Planes(s, np.array([p for p, _ in places]), np.array([t for _, t in places]))


def _ring_mean(
    ring: Ring, values: Float[np.ndarray, "*times nodes"], points: Float[np.ndarray, "nodes 3"]
) -> Float[np.ndarray, " *times"]:
    weight = _weights(ring.low, ring.high, ring.share, points)
    found = values[..., ring.low] * (1.0 - ring.share) + values[..., ring.high] * ring.share
    return found @ weight


def _weights(
    low: Int[np.ndarray, " points"],
    high: Int[np.ndarray, " points"],
    share: Float[np.ndarray, " points"],
    points: Float[np.ndarray, "nodes 3"],
) -> Float[np.ndarray, " points"]:
    """Share of the outline that belongs to each point of a ring: half of the pieces beside it."""
    p = points[low] * (1.0 - share[:, None]) + points[high] * share[:, None]
    piece = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
    own = 0.5 * (piece + np.roll(piece, 1))
    return own / own.sum()
