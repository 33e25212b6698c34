"""Meshes as a pair of SimVascular-style ``mesh-complete`` folders, one for each region."""

import dataclasses
import pathlib
from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from jaxfsi.faces import find_rows, region_faces, triangle_edges, unique_rows
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.mesh_files.acceptance import accepted, check_cells
from jaxfsi.mesh_files.arrays import built
from jaxfsi.mesh_files.complete_folder import (
    CompleteFolder,
    check_target,
    read_folder,
    write_folder,
)
from jaxfsi.mesh_files.joining import join_nodes
from jaxfsi.mesh_files.lengths import UNITS_CM, Unit, check_stored_unit, check_unit
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_files.renaming import check_names
from jaxfsi.meshing.labels import complete_labels

Path = str | pathlib.Path


def write_mesh_complete(
    fluid: Path | None,
    solid: Path | None,
    mesh: Mesh,
    *,
    unit: Unit,
    any_size: bool = False,
) -> None:
    """Write each region of a mesh as a ``mesh-complete`` folder.

    Both folders count nodes and elements on their own; coordinates of the shared nodes are equal
    to the last bit. Wedges of the wall are three tetrahedra each, and listed in the JSON beside
    them.

    Args:
        fluid: folder for the blood; None for a mesh without blood.
        solid: folder for the wall; None for a mesh without a wall.
        mesh: mesh to write.
        unit: length unit of the files.
        any_size: write meshes too that are too large or too small for a vessel.

    Raises:
        ValueError: a folder exists already, the mesh has faults, or its regions and the folders
            do not agree.
    """
    check_unit(unit)
    check_mesh(mesh)
    folders = {
        region: pathlib.Path(path)
        for region, path in ((Region.FLUID, fluid), (Region.SOLID, solid))
        if path is not None
    }
    held = {region for region in Region if np.any(mesh.region == region)}
    if held != set(folders):
        raise MeshFileError(
            f"the mesh has the regions {_names(held)}, but folders were given for"
            f" {_names(set(folders))}. Give one folder for each region of the mesh."
        )
    for path in folders.values():
        check_target(path)
    for region, path in folders.items():
        write_folder(path, mesh, region, unit, any_size=any_size)


def _names(regions: set[Region]) -> str:
    return ", ".join(region.name.lower() for region in sorted(regions)) or "none"


def read_mesh_complete(
    fluid: Path | None,
    solid: Path | None,
    *,
    unit: Unit,
    labels: Mapping[str, str] | None = None,
    tolerance: float | None = None,
    any_size: bool = False,
    damaged: bool = False,
) -> Mesh:
    """Read a mesh from one ``mesh-complete`` folder for each region.

    Folders from `write_mesh_complete` come back as the mesh that was written. In other folders
    the name of a surface file is its label; the interface is found where fluid and solid meet, a
    surface of the solid that meets an opening along its rim becomes the ring of that opening, and
    the other surfaces of the solid are its outer wall. Without a solid, surfaces with ``wall`` in
    their name are the vessel wall.

    Args:
        fluid: folder of the blood; None for a wall alone.
        solid: folder of the wall; None for blood alone.
        unit: length unit of the files.
        labels: label of surface files that are to be named otherwise.
        tolerance: distance up to which nodes of fluid and solid are one [cm]; None: a
            millionth of the extent.
        any_size: read meshes too that are too large or too small for a vessel.
        damaged: read meshes with faults too, to examine them with `jaxfsi.meshing.check_topology`.

    Returns:
        The mesh; of foreign folders, the nodes of the fluid come first.

    Raises:
        ValueError: files are missing, truncated, malformed or in another unit, the regions share
            no nodes or nearly do, or the boundary cannot be labelled.
    """
    check_unit(unit)
    folders = {
        region: read_folder(pathlib.Path(path), unit, any_size=any_size)
        for region, path in ((Region.FLUID, fluid), (Region.SOLID, solid))
        if path is not None
    }
    if not folders:
        raise MeshFileError("no folder was given. Give the folder of the fluid or of the solid.")
    for folder in folders.values():
        if folder.entry is not None:
            check_stored_unit(unit, folder.entry.unit, folder.path)
    whole = _reassembled(folders, unit)
    path = next(iter(folders.values())).path
    if whole is None:
        joined = _joined(folders, unit, dict(labels or {}), tolerance)
        return accepted(joined, None, path, damaged=damaged)
    return accepted(whole, labels, path, damaged=damaged)


def _reassembled(folders: dict[Region, CompleteFolder], unit: Unit) -> Mesh | None:
    """The mesh that was written, from the places that its parts keep; None if parts are missing."""
    path = next(iter(folders.values())).path
    entries = [folder.entry for folder in folders.values() if folder.entry is not None]
    places = [
        (region, folder, folder.node_index, folder.tet_index)
        for region, folder in sorted(folders.items(), reverse=True)
        if folder.node_index is not None and folder.tet_index is not None
    ]
    if len(entries) < len(folders) or len(places) < len(folders):
        return None
    if any(entry != entries[0] for entry in entries):
        raise MeshFileError(
            f"{' and '.join(str(folder.path) for folder in folders.values())} do not belong"
            " together. Give the two folders of one mesh."
        )
    if not _all_there(places):
        return None
    points = np.full((1 + max(int(node.max()) for _, _, node, _ in places), 3), np.nan)
    ids = np.arange(1, len(points) + 1)
    tets = np.zeros((1 + max(int(tet.max()) for _, _, _, tet in places), 4), dtype=np.int64)
    region_of = np.full(len(tets), -1, dtype=np.int64)
    for region, folder, node, tet in places:
        _same_places(points[node], folder)
        points[node] = folder.points
        if folder.whole_ids is not None:
            ids[node] = folder.whole_ids
        tets[tet] = node[folder.tets]
        region_of[tet] = int(region)
    names, meta = entries[0].label_names, entries[0].meta
    own_ids = any(folder.whole_ids is not None for folder in folders.values())
    return built(
        path,
        points * UNITS_CM[unit],
        tets,
        region_of,
        *_placed_faces([(folder, node) for _, folder, node, _ in places], names),
        names,
        ids if own_ids else None,
        meta,
        entries[0].wedges if Region.SOLID in folders else (),
    )


def _all_there(
    places: list[tuple[Region, CompleteFolder, Int[np.ndarray, " _"], Int[np.ndarray, " _"]]],
) -> bool:
    """Whether the places of nodes and tetrahedra count without a gap, so that no part is missing.

    Raises:
        MeshFileError: a place is negative.
    """
    for _, folder, node, tet in places:
        if min(int(node.min(initial=0)), int(tet.min(initial=0))) < 0:
            raise MeshFileError(
                f"{folder.path} gives a node or a tetrahedron a negative place in the whole mesh."
                " Write it again."
            )
    nodes = np.unique(np.concatenate([node for _, _, node, _ in places]))
    tets = np.unique(np.concatenate([tet for _, _, _, tet in places]))
    return all(len(found) == 1 + int(np.max(found, initial=-1)) for found in (nodes, tets))


def _placed_faces(
    folders: list[tuple[CompleteFolder, Int[np.ndarray, " _"]]], names: tuple[str, ...]
) -> tuple[Int[np.ndarray, "faces 3"], Int[np.ndarray, " faces"]]:
    """Faces and labels of the whole mesh; where two folders hold a face, the last one's counts."""
    placed = [
        (np.full(len(surface.place), names.index(name)), surface.place, node[surface.faces])
        for folder, node in folders
        for name, surface in folder.surfaces.items()
        if surface.place is not None and name in names
    ]
    order = np.concatenate([np.zeros(0, dtype=np.int64), *(index for _, index, _ in placed)])
    n_faces = 1 + int(np.max(order, initial=-1))
    if n_faces > len(order) or np.any(order < 0):
        raise MeshFileError(
            f"surface files are missing from {folders[0][0].path}, or the places of their faces are"
            " wrong. Write the mesh again."
        )
    faces = np.zeros((n_faces, 3), dtype=np.int64)
    label = np.full(n_faces, -1, dtype=np.int64)
    for number, index, nodes in placed:
        faces[index] = nodes
        label[index] = number
    if np.any(label < 0):
        raise MeshFileError(
            f"surface files are missing from {folders[0][0].path}. Write the mesh again."
        )
    return faces, label


def _same_places(known: np.ndarray, folder: CompleteFolder) -> None:
    """Refuse folders of different meshes: shared nodes must be equal to the last bit."""
    both = np.isfinite(known[:, 0])
    if np.any(known[both] != folder.points[both]):
        raise MeshFileError(
            f"{folder.path} has shared nodes elsewhere than the folder of the other region. Give"
            " the two folders of one mesh."
        )


def _joined(
    folders: dict[Region, CompleteFolder],
    unit: Unit,
    labels: dict[str, str],
    tolerance: float | None,
) -> Mesh:
    """A mesh from foreign folders."""
    path = next(iter(folders.values())).path
    scaled = {
        region: folder._replace(points=folder.points * UNITS_CM[unit])
        for region, folder in folders.items()
    }
    if len(scaled) == 2:
        fluid, solid = scaled[Region.FLUID], scaled[Region.SOLID]
        nodes = join_nodes(fluid.points, fluid.tets, solid.points, solid.tets, tolerance=tolerance)
        numbers = {Region.FLUID: np.arange(len(fluid.points)), Region.SOLID: nodes.solid}
        points, ids = nodes.points, None
    else:
        (alone,) = scaled.values()
        numbers = {region: np.arange(len(alone.points)) for region in scaled}
        points, ids = alone.points, alone.node_ids
        ids = None if np.array_equal(ids, np.arange(1, len(points) + 1)) else ids
    tets = np.concatenate([numbers[region][scaled[region].tets] for region in scaled])
    region_of = np.concatenate(
        [np.full(len(scaled[region].tets), int(region)) for region in scaled]
    )
    none = np.zeros((0, 3), dtype=np.int64)
    bare = built(path, points, tets, region_of, none, none[:, 0], (), ids, {})
    check_cells(bare, path)
    surfaces = {
        region: {name: numbers[region][surface.faces] for name, surface in folder.surfaces.items()}
        for region, folder in scaled.items()
    }
    named = _named_surfaces(bare, surfaces, labels, path)
    mesh = complete_labels(points, tets, region_of, named)
    return dataclasses.replace(mesh, node_ids=ids)


def _named_surfaces(
    mesh: Mesh,
    surfaces: dict[Region, dict[str, Int[np.ndarray, "_ 3"]]],
    labels: dict[str, str],
    path: pathlib.Path,
) -> dict[str, Int[np.ndarray, "_ 3"]]:
    """Label of each surface file, and its faces, off the interface."""
    held = [name for files in surfaces.values() for name in files]
    check_names(labels, held, path, what="surface")
    interface = region_faces(mesh.tets, mesh.region).interface
    openings: dict[str, np.ndarray] = {}
    walls: dict[str, np.ndarray] = {}
    for name, faces in _off_interface(surfaces.get(Region.FLUID, {}), interface).items():
        vessel_wall = len(interface) == 0 and ("wall" in name or name == INTERFACE)
        label = labels.get(name, INTERFACE if vessel_wall else name)
        kind = walls if label == INTERFACE else openings
        kind[label] = np.concatenate([kind.get(label, faces[:0]), faces])
    for name, faces in _off_interface(surfaces.get(Region.SOLID, {}), interface).items():
        label = labels.get(name) or _solid_label(faces, openings, name)
        walls[label] = np.concatenate([walls.get(label, faces[:0]), faces])
    if not openings and Region.FLUID in surfaces:
        raise MeshFileError(f"{path} names no opening of the blood. Save its caps as surfaces.")
    return openings | walls


def _off_interface(
    surfaces: dict[str, Int[np.ndarray, "_ 3"]], interface: Int[np.ndarray, "interface 3"]
) -> dict[str, Int[np.ndarray, "_ 3"]]:
    """Surfaces that do not lie on the interface; one that does in part is refused."""
    kept = {}
    for name, faces in surfaces.items():
        on_interface = find_rows(faces, interface) >= 0
        if np.any(on_interface) and not np.all(on_interface):
            raise MeshFileError(
                f"the surface {name!r} lies on the interface with {np.sum(on_interface)} of its"
                f" {len(faces)} faces only: fluid and solid do not conform there. Mesh both from"
                " one surface, or save the caps apart from the wall."
            )
        if not np.any(on_interface):
            kept[name] = faces
    return kept


def _solid_label(
    faces: Int[np.ndarray, "faces 3"], openings: dict[str, Int[np.ndarray, "_ 3"]], name: str
) -> str:
    """Label of a surface of the solid: ring of the opening whose rim it shares, or outer wall."""
    if not openings:
        return name
    edges = triangle_edges(faces).reshape(-1, 2)
    rims = {opening: _edges_once(blood) for opening, blood in openings.items()}
    touching = [opening for opening, rim in rims.items() if np.any(find_rows(edges, rim) >= 0)]
    if len(touching) > 1:
        raise MeshFileError(
            f"the surface {name!r} touches the openings {', '.join(touching)}. Save the cut wall of"
            " each opening as a surface of its own."
        )
    return touching[0] + RING_SUFFIX if touching else OUTER_WALL


def _edges_once(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "edges 2"]:
    return unique_rows(np.sort(triangle_edges(faces).reshape(-1, 2), axis=1))[0]
