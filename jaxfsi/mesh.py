"""A tetrahedral mesh of blood and wall with shared nodes, and the names of its boundary.

Fluid and solid are two regions of one mesh, so the interface conforms by construction. Which
faces make up the interface and the boundary follows from the tetrahedra and their regions alone
(`jaxfsi.faces.region_faces`); only the names of the openings come from outside. Faces point out
of their region, those of the interface from the fluid into the solid.

Where the wall stands in columns on the lumen's triangles, the mesh also names its wedges: six
nodes and the three tetrahedra that fill them. A wall of wedges bends (`jaxfsi.core.elements`);
everything else reads the tetrahedra alone.
"""

import dataclasses
import enum
import itertools

import numpy as np
from jaxtyping import Bool, Float, Int

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
        node_ids: id of each node in the numbering or the file that it came from; None: its index
            plus one.
        meta: numbers worth keeping with the mesh (parameters, state, source); plain values that
            JSON can hold.
        wedges: nodes of the wedges of the wall: three of the inner face, then the three above
            them outside. Three solid tetrahedra fill each.
    """

    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    region: Int[np.ndarray, " tets"]
    faces: Int[np.ndarray, "faces 3"]
    face_label: Int[np.ndarray, " faces"]
    label_names: tuple[str, ...]
    node_ids: Int[np.ndarray, " nodes"] | None = None
    meta: dict[str, object] = dataclasses.field(default_factory=dict)
    wedges: Int[np.ndarray, "wedges 6"] = dataclasses.field(
        default_factory=lambda: np.zeros((0, 6), dtype=np.int64)
    )

    def __post_init__(self) -> None:
        """Refuse arrays that do not belong together.

        Raises:
            ValueError: indices out of range, unequal lengths, unknown regions, labels without a
                name, points that are not finite.
        """
        faults = _faults(self)
        if faults:
            raise ValueError(
                f"this is not a mesh: {'; '.join(faults)}. Check how its arrays were put together."
            )

    @property
    def ids(self) -> Int[np.ndarray, " nodes"]:
        """Id of each node, counted from one where the mesh does not carry its own."""
        return np.arange(1, len(self.points) + 1) if self.node_ids is None else self.node_ids

    @property
    def openings(self) -> tuple[str, ...]:
        """Names of the openings that blood passes; none where there is no blood."""
        if not np.any(self.region == Region.FLUID):
            return ()
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

    @property
    def wedge_tets(self) -> Int[np.ndarray, "wedges 3"]:
        """The three tetrahedra that fill each wedge."""
        return _filling(self.wedges, self.tets)[0]

    def tets_of(self, region: Region) -> Int[np.ndarray, "tets 4"]:
        """Tetrahedra of one region."""
        return self.tets[self.region == region]


def _out_of_range(name: str, index: np.ndarray, size: int, of: str) -> list[str]:
    if index.size == 0 or (index.min() >= 0 and index.max() < size):
        return []
    bad = np.any(((index < 0) | (index >= size)).reshape(len(index), -1), axis=1)
    return [
        f"{name} run from {index.min()} to {index.max()}, but there are {size} {of}"
        f" ({np.sum(bad)} are wrong, the first in row {np.argmax(bad)})"
    ]


def _faults(mesh: Mesh) -> list[str]:
    """What is wrong with the arrays of a mesh, each in one clause; cheap enough for every mesh."""
    faults = []
    n_nodes = len(mesh.points)
    if len(mesh.tets) == 0:
        faults.append("it has no tetrahedra")
    if not np.all(np.isfinite(mesh.points)):
        bad = int(np.sum(~np.all(np.isfinite(mesh.points), axis=1)))
        faults.append(f"{bad} of {n_nodes} points are not finite")
    faults += _out_of_range("nodes of tetrahedra", mesh.tets, n_nodes, "points")
    faults += _out_of_range("nodes of faces", mesh.faces, n_nodes, "points")
    faults += _out_of_range(
        "labels of faces", mesh.face_label, len(mesh.label_names), "label names"
    )
    if not faults and len(mesh.wedges):
        faults += _wedge_faults(mesh)
    for what, array, size in (
        ("regions for the tetrahedra", mesh.region, len(mesh.tets)),
        ("labels for the faces", mesh.face_label, len(mesh.faces)),
    ):
        if len(array) != size:
            faults.append(f"{len(array)} {what}, of which there are {size}")
    unknown = np.setdiff1d(mesh.region, [int(region) for region in Region])
    if unknown.size:
        faults.append(f"regions {unknown.tolist()} are neither 0 (fluid) nor 1 (solid)")
    if len(set(mesh.label_names)) != len(mesh.label_names):
        faults.append(f"label names appear twice: {', '.join(mesh.label_names)}")
    if mesh.node_ids is not None and (
        len(mesh.node_ids) != n_nodes or len(np.unique(mesh.node_ids)) != n_nodes
    ):
        faults.append(f"{len(np.unique(mesh.node_ids))} different node ids for {n_nodes} points")
    return faults


def _filling(
    wedges: Int[np.ndarray, "wedges 6"], tets: Int[np.ndarray, "tets 4"]
) -> tuple[Int[np.ndarray, "wedges 3"], Bool[np.ndarray, " wedges"]]:
    """Tetrahedra whose corners are all among those of a wedge, and which wedges have three."""
    subsets = np.array(list(itertools.combinations(range(6), 4)))
    sought = np.sort(wedges[:, subsets], axis=2).reshape(-1, 4)
    held = np.sort(tets, axis=1)
    base = max((int(a.max()) for a in (sought, held) if a.size), default=0) + 1
    key, wanted = (_row_keys(rows, base) for rows in (held, sought))
    order = np.argsort(key)
    place = order[np.minimum(np.searchsorted(key[order], wanted), len(order) - 1)]
    found = (key[place] == wanted).reshape(len(wedges), -1)
    whole = found.sum(axis=1) == 3
    # The columns of those found come first; a stable sort keeps their order.
    first = np.argsort(~found, axis=1, kind="stable")[:, :3]
    return np.take_along_axis(place.reshape(found.shape), first, axis=1), whole


def _row_keys(rows: Int[np.ndarray, "rows 4"], base: int) -> np.ndarray:
    """One number a row, or where four of them exceed 64 bits one Python integer."""
    kind = np.int64 if base**4 < 2**63 else object
    a, b, c, d = rows.astype(kind).T
    return ((a * base + b) * base + c) * base + d


def _wedge_faults(mesh: Mesh) -> list[str]:
    """What is wrong with the wedges of a mesh whose other arrays are right."""
    if mesh.wedges.ndim != 2 or mesh.wedges.shape[1] != 6:
        return [f"wedges have the shape {mesh.wedges.shape}, not (wedges, 6)"]
    faults = _out_of_range("nodes of wedges", mesh.wedges, len(mesh.points), "points")
    if faults:
        return faults
    tets, whole = _filling(mesh.wedges, mesh.tets)
    if not np.all(whole):
        bad = int(np.argmin(whole))
        return [
            f"{np.sum(~whole)} of {len(whole)} wedges are not filled by three tetrahedra (the first"
            f" is {bad})"
        ]
    if np.any(mesh.region[tets] != Region.SOLID):
        faults.append("some wedges lie in the blood")
    if len(np.unique(tets)) != tets.size:
        faults.append("some wedges share a tetrahedron")
    return faults


def tet_faces(tets: Int[np.ndarray, "tets 4"]) -> Int[np.ndarray, "tets 4 3"]:
    """The four outward faces of each tetrahedron; face i lies opposite to vertex i."""
    return tets[:, _TET_FACES]


def tet_volumes(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> Float[np.ndarray, " tets"]:
    """Signed volume of each tetrahedron [cm³], positive where it is oriented positively."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
