"""Triangulated surfaces in VTK's PolyData XML files (vtp)."""

import pathlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped

from jaxfsi.mesh_files.refusal import MeshFileError, reading, staged
from jaxfsi.mesh_files.vtk_xml import (
    VtkXml,
    array_element,
    check_vtk_xml,
    open_vtk_xml,
    read_array,
)
from jaxfsi.text_files import Malformed

_CELL_KINDS = (
    "Verts",
    "Lines",
    "Strips",
    "Polys",
)  # order of cell data: verts, lines, polys, strips


class TriangleFile(NamedTuple):
    """A triangulated surface as a file holds it.

    Attributes:
        points: positions in the unit of the file.
        triangles: nodes of each triangle.
        point_data: values at points by name.
        cell_data: values on triangles by name.
    """

    points: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    point_data: dict[str, Shaped[np.ndarray, "points ..."]]
    cell_data: dict[str, Shaped[np.ndarray, "triangles ..."]]


def read_vtp(path: str | pathlib.Path) -> TriangleFile:
    """Read a triangulated surface; several pieces become one.

    Args:
        path: a vtp file: ascii, base64 or appended; zlib, lzma or uncompressed.

    Returns:
        Points (float64, in the unit of the file), triangles and data arrays. Loose points and
        lines are left out; text arrays too.

    Raises:
        MeshFileError: the file is missing, empty, truncated or malformed, or has faces that are
            not triangles.
    """
    path = pathlib.Path(path)
    with reading(path, "a vtp surface"):
        check_vtk_xml(path, "PolyData")
        file = open_vtk_xml(path, "PolyData")
        pieces = [_piece(file, piece, path) for piece in file.root.iterfind("PolyData/Piece")]
        if not pieces:
            raise MeshFileError(f"{path} has no piece. Write the surface again.")
        return pieces[0] if len(pieces) == 1 else _joined(pieces)


def _piece(file: VtkXml, piece: ET.Element, path: pathlib.Path) -> TriangleFile:
    count = {name: int(piece.get(f"NumberOf{name}", 0)) for name in ("Points", *_CELL_KINDS)}
    if count["Strips"]:
        raise MeshFileError(
            f"{path} holds triangle strips. Save plain triangles (in ParaView: Triangulate)."
        )
    points = array_in(file, piece, "Points", None).astype(float).reshape(-1, 3)
    connectivity = array_in(file, piece, "Polys", "connectivity").astype(np.int64)
    offsets = array_in(file, piece, "Polys", "offsets").astype(np.int64)
    if len(points) != count["Points"] or len(offsets) != count["Polys"]:
        raise Malformed(
            f"{len(points)} of {count['Points']} points and {len(offsets)} of {count['Polys']}"
            " polygons are there"
        )
    if np.any(np.diff(offsets, prepend=0) != 3) or len(connectivity) != 3 * len(offsets):
        raise MeshFileError(
            f"{path} has faces that are not triangles. Triangulate it (in ParaView: Triangulate)."
        )
    if connectivity.size and not 0 <= connectivity.min() <= connectivity.max() < len(points):
        raise Malformed("triangles name points that are not there")
    first = count["Verts"] + count["Lines"]
    cells = data_in(file, piece, "CellData")
    n_cells = first + len(offsets)
    for where, data, size in (
        ("points", point_data := data_in(file, piece, "PointData"), len(points)),
        ("cells", cells, n_cells),
    ):
        short = [name for name, values in data.items() if len(values) != size]
        if short:
            raise Malformed(f"data on {where} have the wrong length: {', '.join(short)}")
    cell_data = {name: values[first:] for name, values in cells.items()}
    return TriangleFile(points, connectivity.reshape(-1, 3), point_data, cell_data)


def array_in(file: VtkXml, piece: ET.Element, section: str, name: str | None) -> np.ndarray:
    """An array of a piece; None: the first of the section. Cells that are not there are none.

    Raises:
        Malformed: there is no such array.
    """
    for element in piece.iterfind(f"{section}/DataArray"):
        if name is None or element.get("Name") == name:
            return read_array(file, element)
    if section in _CELL_KINDS:
        return np.zeros(0, dtype=np.int64)
    raise Malformed(f"{section} are missing")


def data_in(file: VtkXml, piece: ET.Element, section: str) -> dict[str, np.ndarray]:
    """All arrays of numbers of a section of a piece, by name."""
    return {
        element.get("Name", ""): read_array(file, element)
        for element in piece.iterfind(f"{section}/DataArray")
        if element.get("type") not in ("String", "Bit")
    }


def _joined(pieces: list[TriangleFile]) -> TriangleFile:
    shift = np.cumsum([0, *(len(piece.points) for piece in pieces)])

    def common(data: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        names = [name for name in data[0] if all(name in other for other in data)]
        return {name: np.concatenate([other[name] for other in data]) for name in names}

    return TriangleFile(
        np.concatenate([piece.points for piece in pieces]),
        np.concatenate([piece.triangles + shift[i] for i, piece in enumerate(pieces)]),
        common([piece.point_data for piece in pieces]),
        common([piece.cell_data for piece in pieces]),
    )


def write_vtp(
    path: str | pathlib.Path,
    points: Float[np.ndarray, "points 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    *,
    point_data: Mapping[str, np.ndarray] | None = None,
    cell_data: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write a triangulated surface as base64 with zlib; everything is kept to the last bit.

    Args:
        path: file to write; an old one is replaced when the new one is complete.
        points: positions in the unit wanted in the file.
        triangles: nodes of each triangle.
        point_data: values at points by name.
        cell_data: values on triangles by name.

    Raises:
        MeshFileError: data of another length than points or triangles, or of a type that VTK
            files do not hold.
    """
    ends = 3 * np.arange(1, len(triangles) + 1)
    write_poly_data(
        path, points, "Polys", triangles.reshape(-1), ends, point_data, cell_data, "triangles"
    )


def write_poly_data(
    path: str | pathlib.Path,
    points: Float[np.ndarray, "points 3"],
    kind: str,
    nodes: Int[np.ndarray, " nodes"],
    ends: Int[np.ndarray, " cells"],
    point_data: Mapping[str, np.ndarray] | None,
    cell_data: Mapping[str, np.ndarray] | None,
    what: str,
) -> None:
    """Write points and cells of one kind as a file of PolyData.

    Args:
        path: file to write.
        points: positions.
        kind: "Polys" or "Lines".
        nodes: points of all cells, one cell after another.
        ends: position in `nodes` behind the last point of each cell.
        point_data: values at points by name.
        cell_data: values of cells by name.
        what: name of the cells in messages.

    Raises:
        MeshFileError: data of another length than points or cells.
    """
    path = pathlib.Path(path)
    point_data, cell_data = dict(point_data or {}), dict(cell_data or {})
    for where, data, size in (("points", point_data, len(points)), (what, cell_data, len(ends))):
        wrong = [name for name, values in data.items() if len(values) != size]
        if wrong:
            raise MeshFileError(
                f"{', '.join(wrong)} do not have one value for each of the {size} {where}. Give"
                " arrays of that length."
            )
    root = ET.Element(
        "VTKFile",
        type="PolyData",
        version="0.1",
        byte_order="LittleEndian",
        header_type="UInt32",
        compressor="vtkZLibDataCompressor",
    )
    counts = dict.fromkeys(("Points", "Verts", "Lines", "Strips", "Polys"), 0)
    counts |= {"Points": len(points), kind: len(ends)}
    piece = ET.SubElement(
        ET.SubElement(root, "PolyData"),
        "Piece",
        {f"NumberOf{name}": str(count) for name, count in counts.items()},
    )
    sections: dict[str, dict[str, np.ndarray]] = {
        "PointData": point_data,
        "CellData": cell_data,
        "Points": {"Points": np.asarray(points, dtype=float)},
        kind: {"connectivity": nodes.astype(np.int64), "offsets": ends.astype(np.int64)},
    }
    for section, arrays in sections.items():
        ET.SubElement(piece, section).extend(
            [array_element(name, values) for name, values in arrays.items()]
        )
    with staged(path) as folder:
        ET.ElementTree(root).write(folder / path.name, encoding="utf-8", xml_declaration=True)
