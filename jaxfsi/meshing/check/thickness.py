"""Wall thickness really obtained: rays from the interface through the solid, tet by tet.

From the centroid of each interface triangle a ray runs along the triangle's normal into the wall,
from tetrahedron to tetrahedron through their faces, until it leaves the solid. It does so at the
outer wall, at another part of the interface (there the wall is a septum that two lumens share), or
at the cut ends.
"""

import enum
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxfsi.faces import face_table, find_rows, tet_neighbours
from jaxfsi.mesh import INTERFACE, RING_SUFFIX, Mesh, Region, tet_faces

_MOST_STEPS = 10_000


class Exit(enum.IntEnum):
    """Where a ray leaves the wall."""

    OUTER_WALL = 0
    LUMEN = 1
    END = 2


class WallThickness(NamedTuple):
    """Thickness of the wall behind each interface triangle.

    Attributes:
        points: centroid of the triangle [cm].
        thickness: length of the ray inside the wall [cm].
        exit: `Exit`, where it leaves the wall.
    """

    points: Float[np.ndarray, "rays 3"]
    thickness: Float[np.ndarray, " rays"]
    exit: Int[np.ndarray, " rays"]

    @property
    def of_wall(self) -> Float[np.ndarray, " outer"]:
        """Thickness where the wall faces the outside [cm]."""
        return self.thickness[self.exit == Exit.OUTER_WALL]

    @property
    def of_septum(self) -> Float[np.ndarray, " septum"]:
        """Thickness where the wall lies between two parts of the lumen [cm]."""
        return self.thickness[self.exit == Exit.LUMEN]


def wall_thickness(mesh: Mesh) -> WallThickness:
    """Thickness of the wall along the normal of each interface triangle.

    Args:
        mesh: labelled mesh of fluid and solid.

    Raises:
        ValueError: the mesh has no solid, or a ray does not leave it.
    """
    if not np.any(mesh.region == Region.SOLID):
        raise ValueError("the mesh has no wall to measure. Give a mesh with a solid.")
    faces = mesh.labelled(INTERFACE)
    corners = mesh.points[faces]
    origin = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    direction = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    if not np.any(mesh.region == Region.FLUID):
        direction = -direction  # the interface of a solid alone points out of it
    tet = _solid_behind(mesh, faces)
    last_tet, side, thickness = _walk(mesh, tet, origin, direction)
    return WallThickness(origin, thickness, _exit_of(mesh, last_tet, side))


def _solid_behind(mesh: Mesh, faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, " faces"]:
    """The solid tetrahedron at each interface triangle."""
    table = face_table(mesh.tets)
    entry = find_rows(faces, table.nodes)
    first, second = table.first[entry], table.second[entry]
    return np.where(mesh.region[first] == Region.SOLID, first, second)


def _walk(
    mesh: Mesh,
    tet: Int[np.ndarray, " rays"],
    origin: Float[np.ndarray, "rays 3"],
    direction: Float[np.ndarray, "rays 3"],
) -> tuple[Int[np.ndarray, " rays"], Int[np.ndarray, " rays"], Float[np.ndarray, " rays"]]:
    """Last solid tetrahedron of each ray, the face it leaves by, and its length [cm]."""
    neighbours = tet_neighbours(mesh.tets)
    faces = tet_faces(mesh.tets)
    tet = tet.copy()
    side = np.zeros(len(tet), dtype=np.int64)
    length = np.zeros(len(tet))
    moving = np.arange(len(tet))
    for _ in range(_MOST_STEPS):
        if len(moving) == 0:
            return tet, side, length
        corners = mesh.points[faces[tet[moving]]]
        normal = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
        speed = np.einsum("rfi,ri->rf", normal, direction[moving])
        height = np.einsum("rfi,rfi->rf", normal, corners[:, :, 0] - origin[moving][:, None])
        leaving = speed > 0.0
        distance = np.where(leaving, height / np.where(leaving, speed, 1.0), np.inf)
        side[moving] = np.argmin(distance, axis=1)
        length[moving] = np.min(distance, axis=1)
        behind = neighbours[tet[moving], side[moving]]
        goes_on: Bool[np.ndarray, " moving"] = (behind >= 0) & (mesh.region[behind] == Region.SOLID)
        tet[moving[goes_on]] = behind[goes_on]
        moving = moving[goes_on]
    raise ValueError(
        f"{len(moving)} rays through the wall did not leave it after {_MOST_STEPS} tetrahedra."
        " Check the mesh for inverted tetrahedra with check_mesh."
    )


def _exit_of(
    mesh: Mesh, tet: Int[np.ndarray, " rays"], side: Int[np.ndarray, " rays"]
) -> Int[np.ndarray, " rays"]:
    entry = find_rows(tet_faces(mesh.tets)[tet, side], mesh.faces)
    if np.any(entry < 0):
        raise ValueError(
            f"{np.sum(entry < 0)} rays leave the wall through a face without a label. Label the"
            " mesh with jaxfsi.meshing.label_faces."
        )
    kinds = np.array(
        [
            Exit.LUMEN
            if name == INTERFACE
            else Exit.END
            if name.endswith(RING_SUFFIX)
            else Exit.OUTER_WALL
            for name in mesh.label_names
        ],
        dtype=np.int64,
    )
    return kinds[mesh.face_label[entry]]
