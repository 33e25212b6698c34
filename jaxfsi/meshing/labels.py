"""Labels of a mesh: interface, blood faces, cut wall and outer wall from regions and cap planes.

The interface is every face whose two tetrahedra differ in region, the blood faces and the cut
walls are the boundary faces in the cap planes, and the rest of the solid's boundary is the outer
wall. Nothing is carried over from the surfaces that the mesh was made from, so the labels fit the
tetrahedra by construction.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from jaxfsi.faces import (
    RegionFaces,
    find_rows,
    region_faces,
    same_sense,
    triangle_edges,
    unique_rows,
)
from jaxfsi.measures import triangle_normals
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh
from jaxfsi.mesh_checks import place
from jaxfsi.opening import Opening

_PLANE_TOLERANCE = 1e-3  # distance of a cap node from its plane, in edges of its face


def label_faces(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
    openings: Sequence[Opening],
) -> Mesh:
    """A labelled mesh from tetrahedra, their regions and the planes that cut the vessels.

    A boundary face lies in an opening if its nodes lie within a thousandth of its longest edge of
    the plane, inside the opening's ball, and if it looks the way the opening does.

    Args:
        points: node positions [cm].
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.
        openings: the planes through which blood enters and leaves.

    Returns:
        The mesh. Its labels are the openings in the order given, ``interface``, ``outer_wall``
        and the rings; in a mesh without a solid the fluid's wall is the ``interface``.

    Raises:
        ValueError: two openings share a name, an opening has no blood face or no cut wall round
            it, its ball cuts through the wall, or part of the fluid's boundary lies neither in an
            opening nor on the solid.
    """
    names = [opening.name for opening in openings]
    _check_names(names)
    bounds = region_faces(tets, region)
    has_solid = len(bounds.solid) > 0
    cap = _cap_of(points, bounds.fluid, openings)
    ring = _cap_of(points, bounds.solid, openings)
    for i, name in enumerate(names):
        if not np.any(cap == i):
            raise ValueError(
                f"no blood face lies in the plane of the opening {name!r} near"
                f" {place(openings[i].centre)}. Check its centre, normal and radius, and that the"
                " mesh was cut there."
            )
        if has_solid and not np.any(ring == i):
            raise ValueError(
                f"the opening {name!r} near {place(openings[i].centre)} has no cut wall round it."
                " Check that the wall reaches its plane and lies in its ball."
            )
    open_faces = bounds.fluid[cap < 0]
    if has_solid and len(open_faces):
        at = points[open_faces[0]].mean(axis=0)
        raise ValueError(
            f"{len(open_faces)} boundary faces of the fluid lie neither in an opening nor on the"
            f" wall, the first at {place(at)}. Name the opening that is missing, or mesh the wall"
            " without holes."
        )
    groups = [(name, bounds.fluid[cap == i]) for i, name in enumerate(names)]
    groups.append((INTERFACE, bounds.interface if has_solid else open_faces))
    groups.append((OUTER_WALL, bounds.solid[ring < 0]))
    groups += [(name + RING_SUFFIX, bounds.solid[ring == i]) for i, name in enumerate(names)]
    return labelled_mesh(points, tets, region, dict(groups))


def _check_names(names: list[str]) -> None:
    reserved = [
        name for name in names if name in (INTERFACE, OUTER_WALL) or name.endswith(RING_SUFFIX)
    ]
    if reserved or len(set(names)) != len(names):
        raise ValueError(
            f"the openings are named {', '.join(names)}. Give each its own name, none of them"
            f" {INTERFACE!r}, {OUTER_WALL!r} or ending in {RING_SUFFIX!r}."
        )


def _cap_of(
    points: Float[np.ndarray, "nodes 3"],
    faces: Int[np.ndarray, "faces 3"],
    openings: Sequence[Opening],
) -> Int[np.ndarray, " faces"]:
    """Opening in whose plane each face lies, −1 for none; the nearest centre wins."""
    corners = points[faces]
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.sqrt(np.max(np.sum(edges**2, axis=2), axis=1, initial=0.0))
    normals = np.cross(edges[:, 1], edges[:, 2])
    best = np.full(len(faces), np.inf)
    cap = np.full(len(faces), -1, dtype=np.int64)
    planes: list[Bool[np.ndarray, " faces"]] = []
    for i, opening in enumerate(openings):
        offset = corners - opening.centre
        height = np.max(np.abs(offset @ opening.normal), axis=1, initial=0.0)
        distance = np.sqrt(np.max(np.sum(offset**2, axis=2), axis=1, initial=0.0))
        in_plane: Bool[np.ndarray, " faces"] = (height <= _PLANE_TOLERANCE * longest) & (
            normals @ opening.normal > 0.0
        )
        inside = in_plane & (distance <= opening.radius) & (distance < best)
        cap[inside] = i
        best[inside] = distance[inside]
        planes.append(in_plane)
    for i, opening in enumerate(openings):
        if _touch(faces[cap == i], faces[planes[i] & (cap < 0)]):
            raise ValueError(
                f"the ball of the opening {opening.name!r} near {place(opening.centre)}, radius"
                f" {opening.radius:.4g} cm, cuts through the faces in its plane. Enlarge it to hold"
                " the wall of its vessel."
            )
    return cap


def _touch(some: Int[np.ndarray, "some 3"], others: Int[np.ndarray, "others 3"]) -> bool:
    """Whether triangles share an edge with others."""
    if len(some) == 0 or len(others) == 0:
        return False
    known, _ = unique_rows(np.sort(triangle_edges(others).reshape(-1, 2), axis=1))
    return bool(np.any(find_rows(triangle_edges(some).reshape(-1, 2), known) >= 0))


def labelled_mesh(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
    groups: Mapping[str, Int[np.ndarray, "_ 3"]],
) -> Mesh:
    """A mesh from one array of faces per label; labels without faces are left out."""
    kept = {name: faces for name, faces in groups.items() if len(faces)}
    return Mesh(
        points=points,
        tets=tets,
        region=region,
        faces=np.concatenate([*kept.values(), np.zeros((0, 3), dtype=np.int64)]),
        face_label=np.repeat(np.arange(len(kept)), [len(faces) for faces in kept.values()]),
        label_names=tuple(kept),
    )


def outward(
    faces: Int[np.ndarray, "faces 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
) -> Int[np.ndarray, "faces 3"]:
    """The same triangles, turned where needed to point out of their region.

    Args:
        faces: triangles on the boundary or the interface, of either sense.
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.

    Raises:
        ValueError: a triangle is no face of the boundary or the interface.
    """
    return _turned_like(faces, _all_bounds(region_faces(tets, region)))


def _all_bounds(bounds: RegionFaces) -> Int[np.ndarray, "faces 3"]:
    return np.concatenate([bounds.interface, bounds.fluid, bounds.solid])


def _turned_like(
    faces: Int[np.ndarray, "faces 3"], wanted: Int[np.ndarray, "wanted 3"]
) -> Int[np.ndarray, "faces 3"]:
    entry = find_rows(faces, wanted)
    if np.any(entry < 0):
        raise ValueError(
            f"{np.sum(entry < 0)} of {len(faces)} named triangles are no faces of the boundary or"
            f" the interface, the first with the nodes {faces[np.argmax(entry < 0)].tolist()}"
            " (counted from 0). Name only faces of the same mesh."
        )
    turned = ~same_sense(faces, wanted[entry])
    return np.where(turned[:, None], faces[:, [0, 2, 1]], faces)


def face_components(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, " faces"]:
    """Number of the connected patch that each triangle belongs to; patches meet at edges."""
    edges = np.sort(triangle_edges(faces).reshape(-1, 2), axis=1)
    distinct, which = unique_rows(edges)
    owner = np.repeat(np.arange(len(faces)), 3)
    size = len(faces) + len(distinct)
    ones = np.ones(len(owner), dtype=np.int8)
    graph = csr_array((ones, (owner, len(faces) + which)), shape=(size, size))
    return connected_components(graph, directed=False)[1][: len(faces)].astype(np.int64)


def find_openings(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
) -> tuple[Opening, ...]:
    """Openings of a mesh of fluid and solid: the flat patches of the fluid's boundary.

    Where a wall surrounds the blood, the fluid's boundary off the interface is its openings and
    nothing else. The radius of each reaches beyond the cut wall in its plane.

    Args:
        points: node positions [cm].
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.

    Returns:
        One opening per patch, named ``opening_1``, ``opening_2``, ... by falling area.

    Raises:
        ValueError: the mesh has no solid, or no opening, or a patch is not flat.
    """
    bounds = region_faces(tets, region)
    if len(bounds.solid) == 0 or len(bounds.fluid) == 0:
        raise ValueError(
            "openings can be found only in a mesh of blood inside a wall that leaves them open."
            " Give the openings instead."
        )
    patch = face_components(bounds.fluid)
    found = [
        _patch_opening(points, bounds.fluid[patch == i], bounds.solid)
        for i in range(int(patch.max()) + 1)
    ]
    found.sort(key=lambda pair: -pair[0])
    return tuple(
        opening._replace(name=f"opening_{i}") for i, (_, opening) in enumerate(found, start=1)
    )


def _patch_opening(
    points: Float[np.ndarray, "nodes 3"],
    patch: Int[np.ndarray, "faces 3"],
    solid: Int[np.ndarray, "solid 3"],
) -> tuple[float, Opening]:
    """Area of a patch and the opening that it is."""
    a, b, c = (points[patch[:, i]] for i in range(3))
    vectors = triangle_normals(points, patch) / 2.0
    areas = np.linalg.norm(vectors, axis=1)
    total = float(np.linalg.norm(vectors.sum(axis=0)))
    centre = np.sum(areas[:, None] * (a + b + c), axis=0) / (3.0 * areas.sum())
    if total < (1.0 - 1e-6) * areas.sum():
        raise ValueError(
            f"the boundary of the fluid near {place(centre)} is not flat, so it is no opening."
            " Close the wall there, or cut the mesh by a plane."
        )
    normal = vectors.sum(axis=0) / total
    rim = float(np.max(np.linalg.norm(points[patch].reshape(-1, 3) - centre, axis=1)))
    reach = np.linalg.norm(points[solid] - centre, axis=2).max(axis=1)
    height = np.abs((points[solid] - centre) @ normal).max(axis=1)
    in_plane = (height <= _PLANE_TOLERANCE * rim) & (reach <= 3.0 * rim)
    radius = max(rim, float(np.max(reach[in_plane], initial=0.0)))
    return total, Opening("", centre, normal, 1.001 * radius)


def complete_labels(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    region: Int[np.ndarray, " tets"],
    named: Mapping[str, Int[np.ndarray, "_ 3"]],
) -> Mesh:
    """A labelled mesh from named faces of which the walls may be missing or turned.

    All faces are turned to point out of their region. Interface faces without a name become
    ``interface``; so do, where there is no solid, boundary faces of the fluid if nothing is named
    ``interface``. Faces of the solid without a name become the ring of an opening that they
    touch in its plane, or ``outer_wall``.

    Args:
        points: node positions [cm].
        tets: nodes of each tetrahedron, positively oriented.
        region: `Region` of each tetrahedron.
        named: triangles by label, of either sense.

    Raises:
        ValueError: a named triangle is no boundary or interface face, or boundary faces of the
            fluid have no name.
    """
    bounds = region_faces(tets, region)
    wanted = _all_bounds(bounds)
    groups = {name: _turned_like(faces, wanted) for name, faces in named.items() if len(faces)}
    known = np.concatenate([np.zeros((0, 3), dtype=np.int64), *groups.values()])
    interface, fluid, solid = (
        faces[find_rows(faces, known) < 0]
        for faces in (bounds.interface, bounds.fluid, bounds.solid)
    )
    if len(fluid) and len(bounds.interface) == 0 and INTERFACE not in groups:
        interface, fluid = fluid, fluid[:0]
    if len(fluid):
        raise ValueError(
            f"{len(fluid)} boundary faces of the fluid have no name, the first at"
            f" {place(points[fluid[0]].mean(axis=0))}. Name every opening in the file."
        )
    openings = [
        name
        for name in groups
        if name not in (INTERFACE, OUTER_WALL) and not name.endswith(RING_SUFFIX)
    ]
    ring = _ring_of(points, solid, [groups[name] for name in openings])
    extra = {INTERFACE: interface, OUTER_WALL: solid[ring < 0]}
    extra |= {name + RING_SUFFIX: solid[ring == i] for i, name in enumerate(openings)}
    for name, faces in extra.items():
        if len(faces):
            groups[name] = np.concatenate([groups.get(name, faces[:0]), faces])
    return labelled_mesh(points, tets, region, groups)


def _ring_of(
    points: Float[np.ndarray, "nodes 3"],
    solid: Int[np.ndarray, "solid 3"],
    openings: list[Int[np.ndarray, "_ 3"]],
) -> Int[np.ndarray, " solid"]:
    """Opening whose cut wall each face of the solid is, −1 for none."""
    planes = []
    for faces in openings:
        vector = triangle_normals(points, faces).sum(axis=0)
        centre = points[faces].mean(axis=(0, 1))
        rim = float(np.max(np.linalg.norm(points[faces] - centre, axis=2)))
        planes.append(Opening("", centre, vector / np.linalg.norm(vector), 3.0 * rim))
    return _cap_of(points, solid, planes)
