"""A tetrahedral mesh of blood and wall with shared nodes, and the names of its boundary.

Fluid and solid are two regions of one mesh, so the interface conforms by construction. Which
faces make up the interface and the boundary follows from the tetrahedra and their regions alone
(`region_faces`); only the names of the openings come from outside. Faces point out of their
region, those of the interface from the fluid into the solid.
"""

import dataclasses
import enum

import numpy as np
from jaxtyping import Float, Int

INTERFACE = "interface"
OUTER_WALL = "outer_wall"
RING_SUFFIX = "_ring"

# Faces of a positively oriented tetrahedron (a, b, c, d), det(b−a, c−a, d−a) > 0, pointing
# outwards; face i lies opposite to vertex i.
_TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


class Region(enum.IntEnum):
    """What fills a tetrahedron."""

    FLUID = 0
    SOLID = 1


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Linear tetrahedra of fluid and solid with named boundary faces.

    An opening NAME has its blood face under the label ``NAME`` and the cut wall around it under
    ``NAME_ring``; the wetted wall is ``interface`` and the outside of the wall ``outer_wall``. A
    mesh without a solid has ``interface`` as its vessel wall.

    Attributes:
        points: node positions [cm].
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.
        faces: nodes of each labelled triangle.
        face_label: index into ``label_names`` of each labelled triangle.
        label_names: names of the labels.
    """

    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    region: Int[np.ndarray, " tets"]
    faces: Int[np.ndarray, "faces 3"]
    face_label: Int[np.ndarray, " faces"]
    label_names: tuple[str, ...]

    @property
    def openings(self) -> tuple[str, ...]:
        """Names of the openings that blood passes."""
        walls = (INTERFACE, OUTER_WALL)
        return tuple(
            name
            for name in self.label_names
            if name not in walls and not name.endswith(RING_SUFFIX)
        )

    def labelled(self, name: str) -> Int[np.ndarray, "faces 3"]:
        """Triangles under one label.

        Raises:
            ValueError: the mesh has no such label.
        """
        if name not in self.label_names:
            raise ValueError(
                f"the mesh has no faces named {name!r}; its labels are"
                f" {', '.join(self.label_names)}. Use one of these."
            )
        return self.faces[self.face_label == self.label_names.index(name)]

    def tets_of(self, region: Region) -> Int[np.ndarray, "tets 4"]:
        """Tetrahedra of one region."""
        return self.tets[self.region == region]


def tet_faces(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "tets 4 3"]:
    """The four outward faces of each tetrahedron; face i lies opposite to vertex i."""
    return tets[:, _TET_FACES]


def tet_volumes(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> Float[np.ndarray, " tets"]:
    """Signed volume of each tetrahedron [cm³], positive where it is oriented positively."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
