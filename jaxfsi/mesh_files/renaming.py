"""Other names for the labels of a mesh file, whatever its format."""

import dataclasses
import pathlib
from collections.abc import Iterable, Mapping

import numpy as np

from jaxfsi.mesh import INTERFACE, RING_SUFFIX, Mesh, Region
from jaxfsi.mesh_files.refusal import MeshFileError


def check_names(
    labels: Mapping[str, str], held: Iterable[str], path: pathlib.Path, *, what: str
) -> None:
    """Refuse to rename what a file does not have.

    Args:
        labels: new label by name in the file.
        held: names in the file.
        path: the file, for the message.
        what: what carries the names, for the message.

    Raises:
        MeshFileError: a name is not in the file.
    """
    held = tuple(held)
    absent = ", ".join(repr(name) for name in sorted(set(labels).difference(held)))
    if absent:
        raise MeshFileError(
            f"{path}: there is no {what} {absent}; there are {', '.join(held) or 'none'}. Name one"
            " of these in labels."
        )


def renamed(mesh: Mesh, labels: Mapping[str, str] | None, path: pathlib.Path) -> Mesh:
    """The same mesh with other names of its labels; those that get the same name are joined.

    The ring of an opening is named after it, unless it is given a name of its own.

    Args:
        mesh: mesh of a file.
        labels: new label by old one; None or empty leaves the mesh as it is.
        path: the file, for messages.

    Raises:
        MeshFileError: the mesh has no such label, or the interface of blood and wall would change.
    """
    if not labels:
        return mesh
    check_names(labels, mesh.label_names, path, what="label")
    moved = [name for name, new in labels.items() if (name == INTERFACE) != (new == INTERFACE)]
    if moved and len(np.unique(mesh.region)) == len(Region):
        raise MeshFileError(
            f"{path}: {moved[0]!r} cannot become {labels[moved[0]]!r}, since {INTERFACE!r} is where"
            " blood and wall meet. Leave it out of labels."
        )
    rings = {f"{name}{RING_SUFFIX}": f"{labels[name]}{RING_SUFFIX}"
             for name in mesh.openings if name in labels}  # fmt: skip
    rules = rings | dict(labels)
    names = [rules.get(name, name) for name in mesh.label_names]
    kept = tuple(dict.fromkeys(names))
    position = np.array([kept.index(name) for name in names], dtype=mesh.face_label.dtype)
    return dataclasses.replace(mesh, face_label=position[mesh.face_label], label_names=kept)
