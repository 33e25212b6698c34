"""Centre lines with branches in VTK's PolyData XML files (vtp), as VMTK and SlicerVMTK write them.

Each branch is one poly line, from the common source to a tip; `RADIUS` is the radius of the largest
sphere within the vessel, at points.
"""

import pathlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped

from jaxfsi.mesh_files.refusal import MeshFileError, reading
from jaxfsi.mesh_files.vtk_xml import VtkXml, check_vtk_xml, open_vtk_xml
from jaxfsi.mesh_files.vtp import array_in, data_in, write_poly_data
from jaxfsi.text_files import Malformed

RADIUS = "MaximumInscribedSphereRadius"
"""VMTK's name of the radius at a point of a centre line."""


class PolylineFile(NamedTuple):
    """Poly lines as a file holds them.

    Attributes:
        points: positions in the unit of the file.
        lines: points of each line, in its order.
        point_data: values at points by name.
        cell_data: values of lines by name.
    """

    points: Float[np.ndarray, "points 3"]
    lines: tuple[Int[np.ndarray, " nodes"], ...]
    point_data: dict[str, Shaped[np.ndarray, "points ..."]]
    cell_data: dict[str, Shaped[np.ndarray, "lines ..."]]

    @property
    def radius(self) -> Float[np.ndarray, " points"] | None:
        """Radius of the largest inscribed sphere, in the unit of the file; None: not given."""
        values = self.point_data.get(RADIUS)
        return None if values is None else values.astype(float)


def read_polylines(path: str | pathlib.Path) -> PolylineFile:
    """Read centre lines; of several pieces the first that holds lines.

    Args:
        path: a vtp file: ascii, base64 or appended; zlib, lzma or uncompressed.

    Returns:
        Points (float64, in the unit of the file), lines and data arrays.

    Raises:
        MeshFileError: the file is missing, empty, truncated or malformed, or holds no lines.
    """
    path = pathlib.Path(path)
    with reading(path, "a vtp file of centre lines"):
        check_vtk_xml(path, "PolyData")
        file = open_vtk_xml(path, "PolyData")
        pieces = file.root.iterfind("PolyData/Piece")
        piece = next((p for p in pieces if int(p.get("NumberOfLines", 0))), None)
        if piece is None:
            raise MeshFileError(
                f"{path} holds no lines. Give the centre lines, not the surface of the vessel."
            )
        return _piece(file, piece)


def _piece(file: VtkXml, piece: ET.Element) -> PolylineFile:
    points = array_in(file, piece, "Points", None).astype(float).reshape(-1, 3)
    nodes = array_in(file, piece, "Lines", "connectivity").astype(np.int64)
    ends = array_in(file, piece, "Lines", "offsets").astype(np.int64)
    count = int(piece.get("NumberOfLines", 0))
    steps = np.diff(ends, prepend=0)
    if len(ends) != count or np.any(steps < 2) or (len(ends) and ends[-1] != len(nodes)):
        raise Malformed(f"{len(nodes)} nodes do not make {count} lines")
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(points):
        raise Malformed("lines name points that are not there")
    if not np.all(np.isfinite(points)):
        raise Malformed("a point is not finite")
    point_data = data_in(file, piece, "PointData")
    first = int(piece.get("NumberOfVerts", 0))
    cells = data_in(file, piece, "CellData")
    short = [n for n, values in point_data.items() if len(values) != len(points)]
    short += [n for n, values in cells.items() if len(values) < first + count]
    if short:
        raise Malformed(f"data have the wrong length: {', '.join(short)}")
    return PolylineFile(
        points,
        tuple(np.split(nodes, ends[:-1])),
        point_data,
        {name: values[first : first + count] for name, values in cells.items()},
    )


def write_polylines(
    path: str | pathlib.Path,
    points: Float[np.ndarray, "points 3"],
    lines: Sequence[Int[np.ndarray, " _"]],
    *,
    point_data: Mapping[str, np.ndarray] | None = None,
    cell_data: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write centre lines as base64 with zlib; everything is kept to the last bit.

    Args:
        path: file to write; an old one is replaced when the new one is complete.
        points: positions in the unit wanted in the file.
        lines: points of each line.
        point_data: values at points by name.
        cell_data: values of lines by name.

    Raises:
        MeshFileError: data of another length than points or lines, or lines of points that are
            not there.
    """
    nodes = np.concatenate([np.asarray(line, np.int64) for line in lines] or [np.zeros(0, int)])
    if nodes.size == 0 or not 0 <= nodes.min() <= nodes.max() < len(points):
        raise MeshFileError("the lines are empty or name points that are not there. Correct them.")
    ends = np.cumsum([len(line) for line in lines])
    write_poly_data(path, points, "Lines", nodes, ends, point_data, cell_data, "lines")
