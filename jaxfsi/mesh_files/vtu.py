"""Meshes in VTK's unstructured-grid XML files (vtu), with names beside them in JSON."""

import pathlib
from collections.abc import Mapping, Sequence

import meshio

from jaxfsi.mesh import Mesh
from jaxfsi.mesh_files.acceptance import accepted
from jaxfsi.mesh_files.arrays import arrays_to_mesh, mesh_to_arrays, points_in
from jaxfsi.mesh_files.lengths import Unit, check_unit
from jaxfsi.mesh_files.refusal import reading, staged
from jaxfsi.mesh_files.side_entry import read_side_entry, write_side_entry
from jaxfsi.mesh_files.vtk_xml import check_vtk_xml
from jaxfsi.opening import Opening


def read_vtu(
    path: str | pathlib.Path,
    *,
    unit: Unit,
    openings: Sequence[Opening] | None = None,
    labels: Mapping[str, str] | None = None,
    any_size: bool = False,
    damaged: bool = False,
) -> Mesh:
    """Read a mesh from a vtu file.

    A file from `write_vtu` comes back as it was. In any other file ``region`` on the cells tells
    fluid (0) from solid (1); without it all is fluid. Its labels are made anew, and its wedges are
    cut into tetrahedra.

    Args:
        path: file; ``NAME.json`` beside it is read too if it belongs to it.
        unit: length unit of the file.
        openings: cap planes for a file without labels [cm]; None: found by
            `jaxfsi.meshing.find_openings` where a wall surrounds the blood.
        labels: other names for labels, the ones made anew among them (``opening_1``, ...).
        any_size: read meshes too that are too large or too small for a vessel.
        damaged: read meshes with faults too, to examine them with `jaxfsi.meshing.check_topology`.

    Raises:
        ValueError: the file is missing, empty, truncated, malformed or in another unit, or its
            boundary cannot be labelled or has no such label.
    """
    path = pathlib.Path(path)
    check_unit(unit)
    with reading(path, "a vtu mesh"):
        check_vtk_xml(path, "UnstructuredGrid")
        file = meshio.vtu.read(str(path))
    entry = read_side_entry(path)
    mesh = arrays_to_mesh(file, path, unit=unit, entry=entry, openings=openings, any_size=any_size)
    return accepted(mesh, labels, path, damaged=damaged)


def write_vtu(path: str | pathlib.Path, mesh: Mesh, *, unit: Unit, any_size: bool = False) -> None:
    """Write a mesh as ``NAME.vtu`` with its names, meta and unit in ``NAME.json`` beside it.

    In cm every number is kept to the last bit; in mm coordinates are rounded once. Wedges of the
    wall are cells in place of the tetrahedra that fill them.

    Args:
        path: file to write; an old one is replaced when the new one is complete.
        mesh: mesh to write.
        unit: length unit of the file.
        any_size: write meshes too that are too large or too small for a vessel.

    Raises:
        ValueError: the mesh cannot be a vessel in cm, its meta are not plain values, or
            ``NAME.json`` belongs to something else.
    """
    path = pathlib.Path(path)
    check_unit(unit)
    arrays = mesh_to_arrays(mesh, points_in(mesh, unit, path, any_size))
    with staged(path) as folder:
        write_side_entry(path, folder, mesh, unit)
        meshio.vtu.write(str(folder / path.name), arrays)
