"""Meshes in gmsh files (msh): 2.2 with physical groups in and out, 4.1 in.

The volumes of the groups ``fluid`` and ``solid`` are the regions, the surface groups the labels.
Unit and meta stand in a comment at the head of the file, which gmsh passes over.
"""

import dataclasses
import json
import pathlib
import re
from collections.abc import Mapping
from typing import NamedTuple

import meshio
import numpy as np
from jaxtyping import Int
from numpy.typing import ArrayLike

from jaxfsi.mesh import INTERFACE, OUTER_WALL, Mesh, Region
from jaxfsi.mesh_files.acceptance import accepted, check_cells
from jaxfsi.mesh_files.arrays import (
    NODE_ID,
    built,
    cell_values,
    cells_of,
    node_ids_of,
    points_in,
    without_unused,
)
from jaxfsi.mesh_files.lengths import UNITS_CM, Unit, check_extent, check_stored_unit, check_unit
from jaxfsi.mesh_files.refusal import MeshFileError, reading, staged
from jaxfsi.mesh_files.renaming import check_names
from jaxfsi.mesh_files.side_entry import SideEntry, entry_text, parsed_entry
from jaxfsi.meshing.labels import complete_labels
from jaxfsi.text_files import regular_bytes

_FIRST_LABEL = 10
_COMMENT = b"$Comments\njaxfsi "
_REGION_NAMES = {"fluid": Region.FLUID, "solid": Region.SOLID}
_LONG_NUMBER = re.compile(rb"^\s*(\d{9,})(?![\d.eE])", re.MULTILINE)  # of a node or an element
_SECTIONS = (b"MeshFormat", b"Nodes", b"Elements")


class _Groups(NamedTuple):
    """Physical groups: names by tag of volumes and of surfaces."""

    volumes: dict[int, str]
    surfaces: dict[int, str]


def write_msh(path: str | pathlib.Path, mesh: Mesh, *, unit: Unit, any_size: bool = False) -> None:
    """Write a mesh as a binary msh 2.2 file with physical groups.

    Args:
        path: file to write; an old one is replaced when the new one is complete.
        mesh: mesh to write.
        unit: length unit of the file.
        any_size: write meshes too that are too large or too small for a vessel.

    Raises:
        ValueError: the mesh cannot be a vessel in cm, its meta are not plain values, or a label
            has the name of a region.
    """
    path = pathlib.Path(path)
    check_unit(unit)
    clash = sorted(set(mesh.label_names) & set(_REGION_NAMES))
    if clash:
        raise MeshFileError(
            f"the label {clash[0]!r} has the name of a region in msh files. Give it another name."
        )
    cells: list[tuple[str, ArrayLike] | meshio.CellBlock] = [("tetra", mesh.tets)]
    tags: list[ArrayLike] = [mesh.region + 1]
    if len(mesh.faces):
        cells.append(("triangle", mesh.faces))
        tags.append(mesh.face_label + _FIRST_LABEL)
    names = {name: np.array([region + 1, 3]) for name, region in _REGION_NAMES.items()}
    names |= {name: np.array([i + _FIRST_LABEL, 2]) for i, name in enumerate(mesh.label_names)}
    file = meshio.Mesh(
        points_in(mesh, unit, path, any_size),
        cells,
        point_data={} if mesh.node_ids is None else {NODE_ID: mesh.node_ids.astype(float)},
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data=names,
    )
    comment = _COMMENT + entry_text(mesh, unit, wedges=True).encode() + b"\n$EndComments\n"
    with staged(path) as folder:
        new = folder / path.name
        meshio.gmsh.write(str(new), file, fmt_version="2.2", binary=True)
        new.write_bytes(comment + new.read_bytes())


def read_msh(
    path: str | pathlib.Path,
    *,
    unit: Unit,
    regions: Mapping[str, Region] | None = None,
    labels: Mapping[str, str] | None = None,
    any_size: bool = False,
    damaged: bool = False,
) -> Mesh:
    """Read a mesh with physical groups from a gmsh file, version 2.2 or 4.1.

    A file from `write_msh` comes back as it was. In any other file the surface groups are the
    labels, turned to point outwards; interface and outer wall are completed from the
    tetrahedra, and nodes without a tetrahedron are left out.

    Args:
        path: the file.
        unit: length unit of the file.
        regions: region of each volume group; None: the groups ``fluid`` and ``solid``.
        labels: label of surface groups that have other names in the file.
        any_size: read meshes too that are too large or too small for a vessel.
        damaged: read meshes with faults too, to examine them with `jaxfsi.meshing.check_topology`.

    Raises:
        ValueError: the file is missing, empty, truncated, malformed or in another unit, has no
            physical groups, its groups do not label the boundary, or its mesh is damaged.
    """
    path = pathlib.Path(path)
    check_unit(unit)
    with reading(path, "a gmsh mesh"):
        raw = regular_bytes(path)
        _check_sections(raw, path)
        _check_numbers(raw, path)
        entry = _entry_of(raw)
        file = meshio.gmsh.read(str(path))
    if entry is not None:
        check_stored_unit(unit, entry.unit, path)
    tets, faces = cells_of(file, path)
    points = np.asarray(file.points, dtype=float)
    if not any_size:
        check_extent(points, unit, path)
    points = points * UNITS_CM[unit]
    groups = _groups(file)
    region = _regions(file, groups, dict(regions or _REGION_NAMES), path)
    tags = cell_values(file, "gmsh:physical", "triangle", path)
    tags = np.zeros(len(faces), dtype=np.int64) if tags is None else tags
    ids = node_ids_of(file, path)
    if entry is not None:
        label = tags - _FIRST_LABEL
        names, meta = entry.label_names, entry.meta
        mesh = built(path, points, tets, region, faces, label, names, ids, meta, entry.wedges)
        return accepted(mesh, labels, path, damaged=damaged)
    named = _named_faces(faces, tags, groups, dict(labels or {}), path)
    bare = built(path, points, tets, region, np.zeros((0, 3), int), np.zeros(0, int), (), ids, {})
    check_cells(bare, path)
    mesh = complete_labels(points, bare.tets, bare.region, named)
    mesh = without_unused(dataclasses.replace(mesh, node_ids=ids))
    return accepted(mesh, None, path, damaged=damaged)


def _check_sections(raw: bytes, path: pathlib.Path) -> None:
    for name in _SECTIONS:
        if b"$" + name not in raw or b"$End" + name not in raw:
            raise MeshFileError(
                f"{path} is truncated or no gmsh mesh: its section ${name.decode()} is missing or"
                " does not end. Write it again."
            )


def _check_numbers(raw: bytes, path: pathlib.Path) -> None:
    """Refuse counts beyond the file's size, and node numbers for which no table can be made."""
    for name in _SECTIONS[1:]:
        start = raw.index(b"$" + name) + len(name) + 1
        section = raw[start : raw.find(b"$End" + name)].lstrip()
        counts = section.split(b"\n", 1)[0].split()
        if all(re.fullmatch(rb"-?\d+", count) for count in counts):
            wrong = [
                int(count[:20]) for count in counts[:2] if not 0 <= int(count[:20]) <= len(raw)
            ]
            long = _LONG_NUMBER.search(section)
            if wrong or long:
                number = wrong[0] if wrong else long[1].decode()[:20] if long else ""
                raise MeshFileError(
                    f"{path} has the number {number} in its section ${name.decode()}, of more"
                    " nodes or elements than it can hold. Number them anew from one."
                )


def _entry_of(raw: bytes) -> SideEntry | None:
    if not raw.startswith(_COMMENT):
        return None
    line = raw[len(_COMMENT) :].split(b"\n", 1)[0]
    return parsed_entry(json.loads(line))


def _groups(file: meshio.Mesh) -> _Groups:
    named = {(int(data[0]), int(data[1])): name for name, data in file.field_data.items()}
    return _Groups(
        {tag: name for (tag, dimension), name in named.items() if dimension == 3},
        {tag: name for (tag, dimension), name in named.items() if dimension == 2},
    )


def _regions(
    file: meshio.Mesh, groups: _Groups, regions: dict[str, Region], path: pathlib.Path
) -> Int[np.ndarray, " tets"]:
    tags = cell_values(file, "gmsh:physical", "tetra", path)
    if tags is None:
        raise MeshFileError(
            f"{path} has no physical groups. Name its volumes and surfaces in gmsh and save again."
        )
    present = [int(tag) for tag in np.unique(tags)]
    held = [groups.volumes.get(tag, f"number {tag}") for tag in present]
    unknown = [name for name in held if name not in regions]
    if unknown:
        raise MeshFileError(
            f"the volume groups of {path} are {', '.join(held)}; regions are known of"
            f" {', '.join(regions)}. Name the groups so, or tell the reader the region of each."
        )
    values = np.array([int(regions[name]) for name in held])
    return values[np.searchsorted(present, tags)]


def _named_faces(
    faces: Int[np.ndarray, "faces 3"],
    tags: Int[np.ndarray, " faces"],
    groups: _Groups,
    labels: dict[str, str],
    path: pathlib.Path,
) -> dict[str, Int[np.ndarray, "_ 3"]]:
    """Faces under each label; groups that are given the same label are joined."""
    check_names(labels, groups.surfaces.values(), path, what="surface group")
    named: dict[str, list[np.ndarray]] = {}
    for tag, name in groups.surfaces.items():
        named.setdefault(labels.get(name, name), []).append(faces[tags == tag])
    walls = [name for name in (INTERFACE, OUTER_WALL) if name in named]
    order = [*(name for name in named if name not in walls), *walls]
    return {name: np.concatenate(named[name]) for name in order}
