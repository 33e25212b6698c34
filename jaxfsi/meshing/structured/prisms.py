"""Extruded meshes: triangulated sections, prisms between them, prisms cut into tetrahedra.

Each prism is cut so that the diagonal of every quadrilateral side leaves its lowest node number;
two prisms that share a side then agree on its diagonal without asking each other. Source:
Dompierre, Labbé, Vallet & Camarero 1999, "How to subdivide pyramids, prisms, and hexahedra into
tetrahedra", Proc. 8th International Meshing Roundtable, 195-204.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.mesh import tet_volumes


class PlaneMesh(NamedTuple):
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
    section: PlaneMesh, heights: Float[np.ndarray, " levels"]
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
    wedges = np.concatenate([section.triangles, section.triangles + n_section], axis=1)
    tets = np.concatenate(
        [tets_of_wedges(wedges + n_section * k, points) for k in range(n_levels - 1)]
    )
    region = np.tile(np.tile(section.region, 3), n_levels - 1)
    return points, tets, region


def tets_of_wedges(
    wedges: Int[np.ndarray, "wedges 6"], points: Float[np.ndarray, "nodes 3"]
) -> Int[np.ndarray, "tets 4"]:
    """Three positively oriented tetrahedra for each wedge: all first ones, then all second ones.

    The diagonal of a quadrilateral side leaves the lower of its two nodes on the first face, so
    that wedges that share a side, and with it these two nodes, agree.

    Args:
        wedges: three nodes of one face, then those above them on the other.
        points: node positions [cm].
    """
    order = np.argsort(wedges[:, :3], axis=1)
    a, b, c = np.take_along_axis(wedges[:, :3], order, axis=1).T
    A, B, C = np.take_along_axis(wedges[:, 3:], order, axis=1).T
    parts = [(a, b, c, C), (a, b, B, C), (a, A, B, C)]
    tets = np.concatenate([np.stack(part, axis=1) for part in parts])
    inverted = tet_volumes(points, tets) < 0.0
    tets[inverted] = tets[inverted][:, [1, 0, 2, 3]]
    return tets


def in_columns(
    triangles: Int[np.ndarray, "triangles 3"],
    levels: Float[np.ndarray, "levels nodes 3"],
    points: Float[np.ndarray, "others 3"],
    foot: Int[np.ndarray, " nodes"],
) -> tuple[Float[np.ndarray, "all 3"], Int[np.ndarray, "tets 4"], Int[np.ndarray, "wedges 6"]]:
    """Layers of wedges on a triangulated surface, from it outwards.

    Args:
        triangles: of the surface, as indices into ``foot``, pointing outwards.
        levels: positions of the nodes of each level above the surface [cm].
        points: nodes that exist, those of the surface among them [cm].
        foot: node of each column on the surface, in rising order.

    Returns:
        All nodes, those of the levels last; tetrahedra; wedges.
    """
    n, size = len(points), len(foot)
    level = [foot, *(n + size * k + np.arange(size) for k in range(len(levels)))]
    wedges = np.concatenate(
        [
            np.concatenate([low[triangles], high[triangles]], axis=1)
            for low, high in itertools.pairwise(level)
        ]
    )
    whole = np.concatenate([points, levels.reshape(-1, 3)])
    return whole, tets_of_wedges(wedges, whole), wedges


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
