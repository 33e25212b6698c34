"""Triangulated surfaces: reading them, and making one clean piece of them, or saying why not.

Segmentation tools write triangles with three corners each, in any winding, with slivers, doubled
faces and small islands. `cleaned` merges corners, drops what encloses nothing, turns all triangles
the same way round and refuses what no cleaning makes a vessel: several pieces, edges or points
where sheets meet, one-sided surfaces.

Winding is a two-colouring: with every triangle as two nodes, kept and turned, and an edge between
compatible choices of neighbours, the connected components are the consistent orientations; a
surface is one-sided where both nodes of a triangle fall into one component.
"""

import os
import pathlib
from typing import NamedTuple

import numpy as np
import scipy.sparse
import scipy.spatial
from jaxtyping import Bool, Float, Int

from jaxfsi.faces import corner_fans
from jaxfsi.measures import triangle_areas, triangle_normals
from jaxfsi.mesh_files.vtp import read_vtp
from jaxfsi.text_files import regular_bytes, why

_SUFFIXES = (".stl", ".ply", ".obj", ".vtp")
_MERGE = 1e-6  # distance of corners that are one point, over the diagonal of the surface
_ISLAND = 0.005  # area of a piece that is dropped, over the area of the largest


class Triangles(NamedTuple):
    """A triangulated surface.

    Attributes:
        points: positions.
        faces: corners of each triangle.
    """

    points: Float[np.ndarray, "points 3"]
    faces: Int[np.ndarray, "faces 3"]


class Edges(NamedTuple):
    """Edges of a surface.

    Attributes:
        ends: points of each edge, the lower number first.
        of_face: the edge from corner i to corner i + 1 of each triangle.
        shared_by: number of triangles at each edge.
    """

    ends: Int[np.ndarray, "edges 2"]
    of_face: Int[np.ndarray, "faces 3"]
    shared_by: Int[np.ndarray, " edges"]


def read_triangles(path: str | os.PathLike[str]) -> Triangles:
    """Read an STL, PLY, OBJ or VTP surface as it stands in the file.

    Raises:
        ValueError: unknown kind of file, or missing, empty or truncated.
    """
    path = pathlib.Path(path)
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ValueError(
            f"{path}: {suffix or 'no suffix'} is not a known surface format."
            f" Save it as one of {', '.join(_SUFFIXES)}."
        )
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file. Check the path.")
    if path.stat().st_size == 0:
        raise ValueError(f"{path}: the file is empty. Export the surface again.")
    if suffix == ".vtp":
        file = read_vtp(path)
        surface = Triangles(file.points, file.triangles)
    else:
        surface = _loaded(path, suffix)
    if len(surface.faces) == 0:
        raise ValueError(f"{path}: holds no triangles. Export the surface again.")
    if not np.all(np.isfinite(surface.points)):
        raise ValueError(f"{path}: has coordinates that are not numbers. Export it again.")
    return surface


def check_span(surface: Triangles, largest: float) -> None:
    """Refuse a surface in which a corner lies farther away than anything in a body.

    Args:
        surface: the surface.
        largest: greatest distance from the middle of its corners along an axis.

    Raises:
        ValueError: names the corner that lies farthest.
    """
    distance = np.max(np.abs(surface.points - np.median(surface.points, axis=0)), axis=1)
    far = int(np.argmax(distance))
    if distance[far] > largest:
        raise ValueError(
            f"{np.sum(distance > largest)} of {len(distance)} corners of the surface lie outside"
            f" any body, the farthest at {_place(surface.points[far : far + 1])} cm. Correct the"
            " coordinate, or the unit, and export the surface again."
        )


def _loaded(path: pathlib.Path, suffix: str) -> Triangles:
    import trimesh  # a quarter of a second to import, for surfaces alone

    hint = "The file may be truncated; export the surface again."
    if suffix == ".stl":
        _check_stl(path, hint)
    try:
        mesh = trimesh.load_mesh(path, process=False)
        points = np.asarray(mesh.vertices, dtype=float).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # the reader has no exception of its own
        raise ValueError(f"{path}: cannot be read as {suffix[1:]}: {why(error)}. {hint}") from error
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(points):
        raise ValueError(f"{path}: triangles name points that are not there. {hint}")
    return Triangles(points, faces)


def _check_stl(path: pathlib.Path, hint: str) -> None:
    """Refuse an STL file that ends early; readers may take what is left without a word."""
    data = regular_bytes(path)
    expected = 84 + 50 * int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == expected:
        return
    if data[:5] == b"solid" and b"facet" in data[:2000]:
        if b"endsolid" not in data[-2000:]:
            raise ValueError(f"{path}: ends without endsolid. {hint}")
        return
    raise ValueError(f"{path}: {len(data)} bytes where {max(expected, 84)} are announced. {hint}")


def edges_of(faces: Int[np.ndarray, "faces 3"]) -> Edges:
    """All edges of a surface."""
    following = np.roll(faces, -1, axis=1)
    n = int(faces.max()) + 1 if len(faces) else 1
    key = np.minimum(faces, following) * n + np.maximum(faces, following)
    edge, of_face, count = np.unique(key.ravel(), return_inverse=True, return_counts=True)
    ends = np.stack([edge // n, edge % n], axis=1)
    return Edges(ends, of_face.reshape(-1, 3), count)


def neighbours(edges: Edges) -> tuple[Int[np.ndarray, "pairs 2"], Int[np.ndarray, "pairs 2"]]:
    """Triangles that share an edge with one other triangle, and the corner where it starts."""
    flat = edges.of_face.ravel()
    order = np.argsort(flat, kind="stable")
    starts = np.concatenate([[0], np.cumsum(edges.shared_by)[:-1]])[edges.shared_by == 2]
    slots = np.stack([order[starts], order[starts + 1]], axis=1)
    return slots // 3, slots % 3


def vertex_normals(surface: Triangles) -> Float[np.ndarray, "points 3"]:
    """Unit normals of the points: face normals weighted by the angle of each triangle there.

    Source: Thürmer & Wüthrich 1998, "Computing vertex normals from polygonal facets".
    """
    normals = unit(triangle_normals(*surface))
    total = np.zeros_like(surface.points)
    corners = surface.points[surface.faces]
    for i in range(3):
        one = unit(corners[:, (i + 1) % 3] - corners[:, i])
        other = unit(corners[:, (i + 2) % 3] - corners[:, i])
        angle = np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0))
        np.add.at(total, surface.faces[:, i], angle[:, None] * normals)
    return unit(total)


def unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors of length one; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def compacted(surface: Triangles) -> Triangles:
    """The surface without unused points."""
    used, faces = np.unique(surface.faces, return_inverse=True)
    return Triangles(surface.points[used], faces.reshape(-1, 3))


def cleaned(surface: Triangles) -> Triangles:
    """One consistently wound piece with shared points.

    Raises:
        ValueError: several pieces, non-manifold edges or points, or a one-sided surface.
    """
    surface = _without_islands(_merged(surface))
    _check_manifold(surface)
    return _consistently_wound(surface)


def _merged(surface: Triangles) -> Triangles:
    """Corners within a millionth of the diagonal become one point; O(n log n).

    Points in one cell of a grid are one at once, so that only a few are left near each other,
    however many coincide.
    """
    low = surface.points.min(axis=0)
    diagonal = float(np.linalg.norm(np.ptp(surface.points, axis=0)))
    if not 0.0 < diagonal < np.inf:
        raise ValueError(
            f"the surface shrinks to a point, or is none: it spans {diagonal:.3g}. Export it"
            " again with more digits."
        )
    reach = _MERGE * diagonal
    cells = np.floor((surface.points - low) / (reach / np.sqrt(3.0))).astype(np.int64)
    _, kept, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    pairs = scipy.spatial.KDTree(surface.points[kept]).query_pairs(reach, output_type="ndarray")
    n = len(kept)
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, cluster = scipy.sparse.csgraph.connected_components(graph, directed=False)
    label = cluster[cell.reshape(-1)]
    _, first = np.unique(label, return_index=True)
    faces = label[surface.faces].astype(np.int64)
    whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    faces = faces[whole]
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(once) == 0:
        raise ValueError(
            "the surface shrinks to a point when its corners are merged. Export it again with"
            " more digits."
        )
    return compacted(Triangles(surface.points[first], faces[np.sort(once)]))


def _without_islands(surface: Triangles) -> Triangles:
    n = len(surface.points)
    ends = edges_of(surface.faces).ends
    graph = scipy.sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    if count == 1:
        return surface
    piece = label[surface.faces[:, 0]]
    area = np.bincount(piece, triangle_areas(*surface), count)
    large = area > _ISLAND * np.max(area)
    if np.sum(large) > 1:
        shares = np.sort(area[large])[::-1] / np.sum(area)
        raise ValueError(
            f"the surface falls into {np.sum(large)} pieces (shares of the area:"
            f" {', '.join(f'{share:.0%}' for share in shares)}): the coronary does not touch the"
            " aorta, or parts of other organs are in. Join or remove the pieces in the"
            " segmentation."
        )
    return compacted(Triangles(surface.points, surface.faces[large[piece]]))


def _place(points: Float[np.ndarray, "n 3"]) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in points[0]) + ")"


def _check_manifold(surface: Triangles) -> None:
    edges = edges_of(surface.faces)
    crowded = edges.shared_by > 2
    if np.any(crowded):
        where = surface.points[edges.ends[crowded, 0]]
        raise ValueError(
            f"{np.sum(crowded)} edges have more than two triangles, first near {_place(where)} in"
            " the unit of the file: sheets of the surface meet there. Remesh the segmentation, or"
            " remove inner walls."
        )
    pinched = _pinched(surface, edges)
    if np.any(pinched):
        gaps = int(np.sum(edges.shared_by == 1))
        more = f" {gaps} edges are open: the file may be truncated." if gaps else ""
        raise ValueError(
            f"{np.sum(pinched)} points join sheets that share no edge, first near"
            f" {_place(surface.points[pinched])} in the unit of the file.{more}"
            " Remesh the segmentation, or separate the sheets."
        )


def _pinched(surface: Triangles, edges: Edges) -> Bool[np.ndarray, " points"]:
    """Points whose triangles form more than one fan: corners joined across edges, counted."""
    pairs, corner = neighbours(edges)
    fan = corner_fans(surface.faces, 3 * pairs + corner)
    _, start = np.unique(fan, return_index=True)
    return np.bincount(surface.faces.ravel()[start], minlength=len(surface.points)) > 1


def _consistently_wound(surface: Triangles) -> Triangles:
    pairs, corner = neighbours(edges_of(surface.faces))
    starts = surface.faces[pairs, corner]
    opposed = starts[:, 0] != starts[:, 1]
    n = len(surface.faces)
    kept = np.stack([pairs[:, 0], np.where(opposed, pairs[:, 1], pairs[:, 1] + n)], axis=1)
    turned = np.stack([pairs[:, 0] + n, np.where(opposed, pairs[:, 1] + n, pairs[:, 1])], axis=1)
    links = np.concatenate([kept, turned])
    graph = scipy.sparse.coo_array(
        (np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(2 * n, 2 * n)
    )
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    if np.any(label[:n] == label[n:]):
        raise ValueError(
            "the surface has one side only (like a Möbius strip), so it has no inside. Remesh the"
            " segmentation."
        )
    flip = label[:n] != label[0]
    return Triangles(surface.points, np.where(flip[:, None], surface.faces[:, ::-1], surface.faces))
