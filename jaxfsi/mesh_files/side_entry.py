"""What mesh formats cannot hold: unit, label names and meta, as JSON.

For ``NAME.vtu`` and ``NAME.xdmf`` it lies in ``NAME.json`` beside them, under the name of the file.
"""

import json
import pathlib
from typing import NamedTuple

import numpy as np

from jaxfsi.mesh import Mesh
from jaxfsi.mesh_files.refusal import MeshFileError, reading
from jaxfsi.text_files import Malformed, regular_text

_FORMAT = "jaxfsi mesh"
_MOST_NODES = 2**31


class SideEntry(NamedTuple):
    """Unit, label names and meta of a mesh in a file.

    Attributes:
        unit: length unit of the file.
        label_names: names that the labels in the file count through.
        meta: meta of the mesh.
        wedges: nodes of each wedge of the wall, where the file holds none itself.
    """

    unit: str
    label_names: tuple[str, ...]
    meta: dict[str, object]
    wedges: tuple[tuple[int, ...], ...] = ()


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} is no plain value")


def entry_text(mesh: Mesh, unit: str, *, wedges: bool = False) -> str:
    """Side entry of a mesh as one line of JSON.

    Args:
        mesh: what is written.
        unit: length unit of the file.
        wedges: name the wedges, since the file holds only the tetrahedra that fill them.

    Raises:
        MeshFileError: the meta of the mesh holds what JSON cannot.
    """
    entry = {"unit": unit, "label_names": list(mesh.label_names), "meta": mesh.meta}
    if wedges and len(mesh.wedges):
        entry["wedges"] = mesh.wedges.tolist()
    try:
        return json.dumps(entry, default=_plain, allow_nan=False)
    except (TypeError, ValueError) as error:
        reason = str(error) if isinstance(error, TypeError) else "a number is not finite"
        raise MeshFileError(
            f"the meta of the mesh cannot be written: {reason}. Keep to text, numbers, lists and"
            " dictionaries of them."
        ) from error


def parsed_entry(entry: object) -> SideEntry:
    """Side entry from parsed JSON; raises `Malformed` on anything else."""
    if not isinstance(entry, dict):
        raise Malformed("its side entry is no table")
    lacks = [key for key in ("unit", "label_names", "meta") if key not in entry]
    if lacks:
        raise Malformed(f"its side entry lacks {', '.join(lacks)}")
    names, meta = entry["label_names"], entry["meta"]
    if not isinstance(names, list) or not isinstance(meta, dict):
        raise Malformed("label_names of its side entry is no list, or meta no table")
    wedges = entry.get("wedges", [])
    if not isinstance(wedges, list) or not all(_is_wedge(wedge) for wedge in wedges):
        raise Malformed("wedges of its side entry are not six whole numbers each")
    nodes = tuple(tuple(wedge) for wedge in wedges)
    return SideEntry(str(entry["unit"]), tuple(str(name) for name in names), meta, nodes)


def _is_wedge(nodes: object) -> bool:
    return (
        isinstance(nodes, list)
        and len(nodes) == 6
        and all(type(node) is int and 0 <= node < _MOST_NODES for node in nodes)
    )


def side_path(path: pathlib.Path) -> pathlib.Path:
    """Where the side entry of a mesh file lies."""
    return path.with_suffix(".json")


def _table_beside(path: pathlib.Path) -> dict[str, object] | None:
    """The JSON beside a mesh file: ours, or None if there is none or another's."""
    beside = side_path(path)
    if not beside.is_file():
        return None
    with reading(beside, "JSON beside a mesh"):
        table = json.loads(regular_text(beside))
    return table if isinstance(table, dict) and table.get("format") == _FORMAT else None


def read_side_entry(path: pathlib.Path) -> SideEntry | None:
    """Side entry of a mesh file; None where the file has none.

    Raises:
        MeshFileError: the entry is malformed.
    """
    table = _table_beside(path)
    if table is None or path.name not in table:
        return None
    with reading(side_path(path), "JSON beside a mesh"):
        return parsed_entry(table[path.name])


def write_side_entry(path: pathlib.Path, folder: pathlib.Path, mesh: Mesh, unit: str) -> None:
    """Write the side entry of a mesh file into a staging folder; entries of its siblings stay.

    Args:
        path: the mesh file at its final place.
        folder: where to write for now.
        mesh: mesh in the file.
        unit: length unit of the file.

    Raises:
        MeshFileError: another program's file lies where the entry has to go.
    """
    beside = side_path(path)
    table = _table_beside(path)
    if table is None and beside.exists():
        raise MeshFileError(
            f"{beside} is in the way: it was not written with a mesh. Choose another name for"
            f" {path.name}, or move that file."
        )
    table = dict(table or {"format": _FORMAT})
    table[path.name] = json.loads(entry_text(mesh, unit))
    (folder / beside.name).write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
