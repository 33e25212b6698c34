"""Extruded meshes: triangulated sections, prisms between them, prisms cut into tetrahedra.

Each prism is cut so that the diagonal of every quadrilateral side leaves its lowest node number;
two prisms that share a side then agree on its diagonal without asking each other. Source:
Dompierre, Labbé, Vallet & Camarero 1999, "How to subdivide pyramids, prisms, and hexahedra into
tetrahedra", Proc. 8th International Meshing Roundtable, 195-204.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.mesh import tet_volumes


class Section(NamedTuple):
    """A triangulated plane cross-section.

    Attributes:
        points: positions in the plane [cm].
        triangles: nodes of each triangle.
        region: `jaxfsi.mesh.Region` of each triangle.
    """

    points: Float[np.ndarray, "nodes 2"]
    triangles: Int[np.ndarray, "triangles 3"]
    region: Int[np.ndarray, " triangles"]


def extruded(
    section: Section, heights: Float[np.ndarray, " levels"]
) -> tuple[Float[np.ndarray, "nodes 3"], Int[np.ndarray, "tets 4"], Int[np.ndarray, " tets"]]:
    """Points, positively oriented tetrahedra and regions of a section drawn along z.

    Args:
        section: what is drawn; node i at level k becomes node k n + i.
        heights: z of each level [cm], rising.
    """
    n_section, n_levels = len(section.points), len(heights)
    points = np.empty((n_levels, n_section, 3))
    points[:, :, :2] = section.points
    points[:, :, 2] = heights[:, None]
    points = points.reshape(-1, 3)
    low = np.sort(section.triangles, axis=1)
    a, b, c = low.T
    up = n_section
    one_layer = np.stack(
        [
            np.stack([a, b, c, c + up], axis=1),
            np.stack([a, b, b + up, c + up], axis=1),
            np.stack([a, a + up, b + up, c + up], axis=1),
        ]
    ).reshape(-1, 4)
    offsets = up * np.arange(n_levels - 1)
    tets = (offsets[:, None, None] + one_layer[None]).reshape(-1, 4)
    inverted = tet_volumes(points, tets) < 0.0
    tets[inverted] = tets[inverted][:, [1, 0, 2, 3]]
    region = np.tile(np.tile(section.region, 3), n_levels - 1)
    return points, tets, region


def strip_between(
    inner: Int[np.ndarray, " inner"], outer: Int[np.ndarray, " outer"]
) -> Int[np.ndarray, "triangles 3"]:
    """Triangles between two closed rings of evenly spaced nodes with the same start angle.

    Walking round, the next triangle takes the edge whose middle comes first, on either ring; its
    third corner is where the walk stands on the other ring.

    Args:
        inner: node numbers round the inner ring.
        outer: node numbers round the outer ring.
    """
    n_in, n_out = len(inner), len(outer)
    # Middles of the edges in units of a turn / (2 n_in n_out): integers, so that ties are exact.
    middle_in = (2 * np.arange(n_in) + 1) * n_out
    middle_out = (2 * np.arange(n_out) + 1) * n_in
    passed_in = np.searchsorted(middle_in, middle_out, side="left")
    passed_out = np.searchsorted(middle_out, middle_in, side="right")
    from_out = np.stack([outer, np.roll(outer, -1), inner[passed_in % n_in]], axis=1)
    from_in = np.stack([np.roll(inner, -1), inner, outer[passed_out % n_out]], axis=1)
    return np.concatenate([from_out, from_in])
