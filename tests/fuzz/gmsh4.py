"""A gmsh file of format 4.1, in text or binary, with one entity for each physical group."""

import struct

import meshio
import numpy as np

_DIMENSION = {"triangle": 2, "tetra": 3}
_TYPE = {"triangle": 2, "tetra": 4}


def _groups(mesh: meshio.Mesh) -> list[tuple[int, int, np.ndarray]]:
    """Dimension, tag and cells of each physical group."""
    found = []
    for block, tags in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        for tag in np.unique(tags):
            found.append((_DIMENSION[block.type], int(tag), block.data[np.asarray(tags) == tag]))
    return found


def gmsh4(mesh: meshio.Mesh, *, binary: bool) -> bytes:
    """The file of a mesh whose triangles and tetrahedra have physical groups."""
    groups = _groups(mesh)
    names = [f'{dim} {tag} "{name}"' for name, (tag, dim) in mesh.field_data.items()]
    head = ["$MeshFormat", f"4.1 {int(binary)} 8"]
    text = "\n".join(head).encode() + b"\n"
    if binary:
        text += struct.pack("<i", 1) + b"\n"
    text += (
        b"$EndMeshFormat\n"
        + "\n".join(["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames", ""]).encode()
    )
    low, high = mesh.points.min(axis=0).tolist(), mesh.points.max(axis=0).tolist()
    parts = (
        _binary_parts(mesh, groups, low, high) if binary else _text_parts(mesh, groups, low, high)
    )
    for name, part in zip(("Entities", "Nodes", "Elements"), parts, strict=True):
        text += f"${name}\n".encode() + part + f"\n$End{name}\n".encode()
    return text


def _text_parts(
    mesh: meshio.Mesh,
    groups: list[tuple[int, int, np.ndarray]],
    low: list[float],
    high: list[float],
) -> list[bytes]:
    count = [sum(dim == d for dim, *_ in groups) for d in range(4)]
    box = " ".join(f"{x:.17g}" for x in (*low, *high))
    entities = [" ".join(map(str, count))]
    entities += [f"{tag} {box} 1 {tag} 0" for dim, tag, _ in sorted(groups, key=lambda g: g[0])]
    n, dim, tag = len(mesh.points), groups[0][0], groups[0][1]
    nodes = [f"1 {n} 1 {n}", f"{dim} {tag} 0 {n}", *(str(k + 1) for k in range(n))]
    nodes += [" ".join(f"{x:.17g}" for x in p) for p in mesh.points]
    total = sum(len(cells) for *_, cells in groups)
    elements, number = [f"{len(groups)} {total} 1 {total}"], 0
    for dim, tag, cells in groups:
        elements.append(f"{dim} {tag} {2 if dim == 2 else 4} {len(cells)}")
        for row in cells.tolist():
            number += 1
            elements.append(" ".join(str(x) for x in (number, *(i + 1 for i in row))))
    return ["\n".join(part).encode() for part in (entities, nodes, elements)]


def _binary_parts(
    mesh: meshio.Mesh,
    groups: list[tuple[int, int, np.ndarray]],
    low: list[float],
    high: list[float],
) -> list[bytes]:
    count = [sum(dim == d for dim, *_ in groups) for d in range(4)]
    entities = struct.pack("<4Q", *count)
    for _, tag, _ in sorted(groups, key=lambda g: g[0]):
        entities += struct.pack("<i6dQiQ", tag, *low, *high, 1, tag, 0)
    n, dim, tag = len(mesh.points), groups[0][0], groups[0][1]
    nodes = struct.pack("<4Q", 1, n, 1, n) + struct.pack("<3iQ", dim, tag, 0, n)
    nodes += np.arange(1, n + 1, dtype="<u8").tobytes() + mesh.points.astype("<f8").tobytes()
    total = sum(len(cells) for *_, cells in groups)
    elements, number = struct.pack("<4Q", len(groups), total, 1, total), 1
    for dim, tag, cells in groups:
        elements += struct.pack("<3iQ", dim, tag, 2 if dim == 2 else 4, len(cells))
        numbers = np.arange(number, number + len(cells))[:, None]
        number += len(cells)
        elements += np.hstack([numbers, cells + 1]).astype("<i8").tobytes()
    return [entities, nodes, elements]
