"""What every mesh from a file passes before anyone has it: other names, then an examination.

Every reader ends in `accepted`. The faults are those of `jaxfsi.meshing.check.topology`.
"""

import pathlib
from collections.abc import Mapping, Sequence

from jaxfsi.mesh import Mesh
from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.mesh_files.renaming import renamed
from jaxfsi.meshing.check.topology import TopologyFault, check_topology, unlabelled_faults


def accepted(
    mesh: Mesh, labels: Mapping[str, str] | None, path: pathlib.Path, *, damaged: bool
) -> Mesh:
    """The mesh of a file with its labels renamed, if nothing is wrong with it.

    Args:
        mesh: mesh as the file has it.
        labels: new label by old one; None or empty leaves the names.
        path: the file, for messages.
        damaged: let meshes with faults pass too.

    Raises:
        MeshFileError: labels cannot be renamed so, or the mesh has faults; all are listed.
    """
    mesh = renamed(mesh, labels, path)
    if not damaged:
        refuse_faults(check_topology(mesh).faults, path)
    return mesh


def check_cells(mesh: Mesh, path: pathlib.Path) -> None:
    """Refuse tetrahedra that are damaged, before labels are made for them.

    Raises:
        MeshFileError: lists every fault.
    """
    refuse_faults(unlabelled_faults(mesh), path)


def refuse_faults(faults: Sequence[TopologyFault], path: pathlib.Path) -> None:
    """Raise one error that lists faults with their places, and their cures.

    Raises:
        MeshFileError: there are faults.
    """
    if faults:
        said = "; ".join(f"{fault.where}: {fault.what}" for fault in faults)
        cures = "; ".join(dict.fromkeys(fault.cure for fault in faults))
        raise MeshFileError(f"{path} holds a damaged mesh: {said}. {cures}.")
