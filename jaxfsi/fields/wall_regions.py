"""Regions of a wall round two lumens: that of the aorta, that of the coronary, the septum.

A tetrahedron belongs to the nearer lumen. It is septum where it lies between both: seen from it
they stand more than 120° apart, and it is no farther from each than that wall is thick.
"""

import enum

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxfsi.adjoint.lumen_shape import LumenSurface, lumen_surface, vessel_nodes
from jaxfsi.anatomy import Anatomy
from jaxfsi.mesh import Mesh, Region
from jaxfsi.opening import ANOMALOUS

_BETWEEN = -0.5
"""Cosine of the angle between the directions to both lumens above which a point is not between."""

_PARTS = 4
"""Parts into which the edges of the lumen's triangles are divided to find its nearest point."""


class WallRegion(enum.IntEnum):
    """Region of a tetrahedron of the wall."""

    AORTA = 0
    CORONARY = 1
    SEPTUM = 2


def wall_regions(mesh: Mesh, anatomy: Anatomy) -> Int[np.ndarray, " solid_tets"]:
    """Region of each tetrahedron of the wall of an anatomy, see `WallRegion`.

    Raises:
        ValueError: the anatomy has no axis of the anomalous artery, or the mesh no wall.
    """
    line = anatomy.centerlines.get(ANOMALOUS)
    if line is None:
        raise ValueError(
            f"the anatomy {anatomy.name!r} has no axis of the anomalous artery, so that its wall"
            " cannot be told from the aorta's. Give an anatomy that has one."
        )
    surface = lumen_surface(mesh)
    return regions_beside(
        mesh, surface, vessel_nodes(surface, line.points), anatomy.thickness(surface.points)
    )


def regions_beside(
    mesh: Mesh,
    surface: LumenSurface,
    of_coronary: Bool[np.ndarray, " nodes"],
    thickness: Float[np.ndarray, " nodes"],
) -> Int[np.ndarray, " solid_tets"]:
    """Region of each tetrahedron of a wall, see `WallRegion`.

    Args:
        mesh: the mesh.
        surface: its lumen.
        of_coronary: which nodes of the lumen belong to the coronary; the others are the aorta's.
        thickness: of the wall at each node of the lumen [cm].

    Raises:
        ValueError: the mesh has no wall, or only one lumen.
    """
    tets = mesh.tets_of(Region.SOLID)
    if not len(tets) or np.all(of_coronary) or not np.any(of_coronary):
        raise ValueError(
            "a wall has regions where it has two lumens, of the aorta and of the coronary."
            " Give a mesh with a wall and both."
        )
    middle = mesh.points[tets].mean(axis=1)
    share = np.array(
        [(i, j, _PARTS - i - j) for i in range(_PARTS + 1) for j in range(_PARTS + 1 - i)]
    )
    points, depth, coronary = (
        np.einsum("ka,ta...->tk...", share / _PARTS, values[surface.triangles])
        for values in (surface.points, thickness, of_coronary.astype(float))
    )
    distance, towards, deep = [], [], []
    for own in (coronary < 0.5, coronary >= 0.5):
        far, place = KDTree(points[own]).query(middle)
        distance.append(far)
        towards.append((points[own][place] - middle) / far[:, None])
        deep.append(depth[own][place])
    between = np.sum(towards[0] * towards[1], axis=1) < _BETWEEN
    joined = np.sum(distance, axis=0) <= np.sum(deep, axis=0)
    region = np.where(distance[1] < distance[0], WallRegion.CORONARY, WallRegion.AORTA)
    return np.where(between & joined, WallRegion.SEPTUM, region).astype(np.int64)
