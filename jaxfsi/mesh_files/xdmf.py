"""Meshes in XDMF files with their arrays in HDF5, names beside them in JSON."""

import importlib.util
import math
import pathlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import meshio

from jaxfsi.mesh import Mesh
from jaxfsi.mesh_files.acceptance import accepted
from jaxfsi.mesh_files.arrays import arrays_to_mesh, mesh_to_arrays, points_in
from jaxfsi.mesh_files.lengths import Unit, check_unit
from jaxfsi.mesh_files.refusal import MeshFileError, reading, staged
from jaxfsi.mesh_files.side_entry import read_side_entry, write_side_entry
from jaxfsi.mesh_files.vtk_xml import LARGEST_ARRAY, check_xml
from jaxfsi.opening import Opening
from jaxfsi.text_files import Malformed, regular_bytes


def _need_h5py() -> None:
    if importlib.util.find_spec("h5py") is None:
        raise MeshFileError(
            "xdmf files need the package h5py, which is not installed. Install it, or use vtu."
        )


def read_xdmf(
    path: str | pathlib.Path,
    *,
    unit: Unit,
    openings: Sequence[Opening] | None = None,
    labels: Mapping[str, str] | None = None,
    any_size: bool = False,
    damaged: bool = False,
) -> Mesh:
    """Read a mesh from an xdmf file; the arguments and errors are those of `read_vtu`."""
    path = pathlib.Path(path)
    check_unit(unit)
    _need_h5py()
    with reading(path, "an xdmf mesh"):
        _check_sources(path)
        file = meshio.xdmf.read(str(path))
    entry = read_side_entry(path)
    mesh = arrays_to_mesh(file, path, unit=unit, entry=entry, openings=openings, any_size=any_size)
    return accepted(mesh, labels, path, damaged=damaged)


def _check_sources(path: pathlib.Path) -> None:
    """Refuse arrays that are larger than allowed or lie elsewhere than beside the file.

    Raises:
        MeshFileError: says which array.
    """
    text = regular_bytes(path)
    check_xml(text, path)
    total = 0
    for item in ET.fromstring(text).iter("DataItem"):
        form, source = item.get("Format", "XML"), (item.text or "").strip()
        given = item.get("Dimensions", "0")
        if not re.fullmatch(r"\s*\d{1,18}(\s+\d{1,18})*\s*", given, re.ASCII):
            raise Malformed(f"the Dimensions {given[:40]!r} of an array are no whole numbers")
        counts = [int(count) for count in given.split()]
        total += 8 * math.prod(counts)
        if total > LARGEST_ARRAY:
            raise MeshFileError(
                f"{path} announces arrays of {total} bytes, the last of"
                f" {' x '.join(map(str, counts))} numbers; {LARGEST_ARRAY} bytes are read. Write a"
                " smaller mesh."
            )
        if form == "XML":
            continue
        name, _, place = source.partition(":")
        if name != pathlib.PurePath(name).name or name in ("", ".", ".."):
            raise MeshFileError(
                f"{path} takes an array from {name!r}, outside its own folder. Copy that file"
                " beside it and name it alone."
            )
        if form == "HDF":
            _check_dataset(path.parent / name, place, math.prod(counts), path)


def _check_dataset(store: pathlib.Path, place: str, size: int, path: pathlib.Path) -> None:
    import h5py

    with h5py.File(store, "r") as file:
        held = file.get(place)
        if not isinstance(held, h5py.Dataset) or held.size != size:
            raise MeshFileError(
                f"{path} announces {size} numbers under {place} of {store.name}, which does not"
                " hold so many. Write the mesh again."
            )


def write_xdmf(path: str | pathlib.Path, mesh: Mesh, *, unit: Unit, any_size: bool = False) -> None:
    """Write a mesh as ``NAME.xdmf``, ``NAME.h5`` and ``NAME.json``; as `write_vtu` does."""
    path = pathlib.Path(path)
    check_unit(unit)
    _need_h5py()
    arrays = mesh_to_arrays(mesh, points_in(mesh, unit, path, any_size))
    with staged(path) as folder:
        write_side_entry(path, folder, mesh, unit)
        meshio.xdmf.write(str(folder / path.name), arrays)
