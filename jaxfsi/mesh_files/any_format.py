"""One reader and one writer for single mesh files, by the ending of their name."""

import pathlib
from collections.abc import Mapping

from jaxfsi.mesh import Mesh
from jaxfsi.mesh_files.lengths import Unit
from jaxfsi.mesh_files.msh import read_msh, write_msh
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_files.vtu import read_vtu, write_vtu
from jaxfsi.mesh_files.xdmf import read_xdmf, write_xdmf

_FORMATS = {
    ".vtu": (read_vtu, write_vtu),
    ".msh": (read_msh, write_msh),
    ".xdmf": (read_xdmf, write_xdmf),
}


def _suffix(path: pathlib.Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        raise MeshFileError(
            f"{path} ends in none of {', '.join(_FORMATS)}. Choose one of these formats, or a"
            " mesh-complete folder."
        )
    return suffix


def read_mesh(
    path: str | pathlib.Path,
    *,
    unit: Unit,
    labels: Mapping[str, str] | None = None,
    any_size: bool = False,
    damaged: bool = False,
) -> Mesh:
    """Read a mesh from a vtu, msh or xdmf file; see `read_vtu`, `read_msh`, `read_xdmf`.

    Args:
        path: the file.
        unit: length unit of the file.
        labels: label of faces that have other names in the file.
        any_size: read meshes too that are too large or too small for a vessel.
        damaged: read meshes with faults too, to examine them with `jaxfsi.meshing.check_topology`.

    Raises:
        ValueError: the ending is not known, or the reader of the format refuses the file.
    """
    path = pathlib.Path(path)
    reader, _ = _FORMATS[_suffix(path)]
    return reader(path, unit=unit, labels=labels, any_size=any_size, damaged=damaged)


def write_mesh(path: str | pathlib.Path, mesh: Mesh, *, unit: Unit, any_size: bool = False) -> None:
    """Write a mesh to a vtu, msh or xdmf file; see `write_vtu`, `write_msh`, `write_xdmf`.

    Args:
        path: the file; its ending chooses the format.
        mesh: mesh to write.
        unit: length unit of the file.
        any_size: write meshes too that are too large or too small for a vessel.

    Raises:
        ValueError: the ending is not known, or the writer of the format refuses the mesh.
    """
    path = pathlib.Path(path)
    _, writer = _FORMATS[_suffix(path)]
    writer(path, mesh, unit=unit, any_size=any_size)
