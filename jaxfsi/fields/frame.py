"""Frames of a time series on one mesh, as VTU files that appear whole or not at all.

A frame is VTK's XML unstructured grid with appended raw data, each array compressed by zlib. Mesh
and regions are the same in every frame and are compressed once. The same numbers give the same
bytes. Source: "VTK file formats", VTK user's guide, section on XML formats.
"""

import pathlib
import zlib
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.text_files import Malformed, why
from lumped.whole_files import write_whole

_LEVEL = 1  # most of the gain for a fraction of the time
_TETRA = 10
_TRIANGLE = 5
_ONE_TUPLE = ' NumberOfTuples="1"'
_DATA_MARK = b'<AppendedData encoding="raw">\n_'
_HEAD_SIZE = 1 << 16  # holds the head of a frame and its first block, the time
_COMPONENTS = {3: ("x", "y", "z"), 6: ("xx", "yy", "zz", "xy", "yz", "xz")}
_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}

Fields = Mapping[str, np.ndarray]


class Grid:
    """Points and cells that all frames share, compressed once."""

    def __init__(
        self,
        points: Float[np.ndarray, "nodes 3"],
        cells: Int[np.ndarray, "cells corners"],
        cell_data: Fields | None = None,
        names: Mapping[str, Sequence[str]] | None = None,
    ):
        """Take points and cells.

        Args:
            points: positions [cm].
            cells: nodes of tetrahedra (four) or triangles (three).
            cell_data: values of the cells that are the same in every frame.
            names: numbered names that every frame carries: field data ``region_blood`` = 0 and
                ``region_wall`` = 1 for ``{"region": ("blood", "wall")}``. Text arrays would keep
                meshio from reading the file.

        Raises:
            ValueError: the cells are neither.
        """
        if cells.shape[1] not in (3, 4):
            raise ValueError(
                f"cells of {cells.shape[1]} nodes cannot be written. Give triangles or tetrahedra."
            )
        kind = _TRIANGLE if cells.shape[1] == 3 else _TETRA
        offsets = cells.shape[1] * np.arange(1, len(cells) + 1)
        self.n_points, self.n_cells = len(points), len(cells)
        self._points = [_packed("points", points.astype(np.float64))]
        self._cells = [
            _packed("connectivity", cells.astype(np.int64).ravel()),
            _packed("offsets", offsets.astype(np.int64)),
            _packed("types", np.full(len(cells), kind, np.uint8)),
        ]
        self._cell_data = [_packed(name, a) for name, a in (cell_data or {}).items()]
        self._names = "".join(
            _number(f"{group}_{name}", i)
            for group, listed in (names or {}).items()
            for i, name in enumerate(listed)
        )

    def write(
        self, path: pathlib.Path, t: float, point_data: Fields, cell_data: Fields | None = None
    ) -> None:
        """Write one frame; an old file is replaced when the new one is complete.

        Args:
            path: file to write.
            t: time, kept in the file as ``TimeValue``.
            point_data: values at the points; vectors as (points, 3).
            cell_data: values of the cells; symmetric tensors as xx, yy, zz, xy, yz, xz.
        """
        parts = {
            "PointData": [_packed(name, a) for name, a in point_data.items()],
            "CellData": [
                *self._cell_data,
                *(_packed(name, a) for name, a in (cell_data or {}).items()),
            ],
            "Points": self._points,
            "Cells": self._cells,
        }
        time = _packed("TimeValue", np.array([t]))
        head = [
            '<?xml version="1.0"?>',
            '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian"'
            ' header_type="UInt64" compressor="vtkZLibDataCompressor">',
            "<UnstructuredGrid>",
            f"<FieldData>{_entry(time, 0, _ONE_TUPLE)}{self._names}</FieldData>",
            f'<Piece NumberOfPoints="{self.n_points}" NumberOfCells="{self.n_cells}">',
        ]
        blocks, offset = [time[3]], len(time[3])
        for section, arrays in parts.items():
            head.append(f"<{section}>")
            for array in arrays:
                head.append(_entry(array, offset))
                blocks.append(array[3])
                offset += len(array[3])
            head.append(f"</{section}>")
        head += ["</Piece>", "</UnstructuredGrid>", '<AppendedData encoding="raw">', "_"]
        tail = "\n</AppendedData>\n</VTKFile>\n"
        write_whole(path, "\n".join(head).encode() + b"".join(blocks) + tail.encode())


def read_time(path: pathlib.Path) -> float:
    """The time of a frame that `Grid` wrote [s], exactly as it was given.

    Raises:
        ValueError: the file is no such frame.
    """
    with path.open("rb") as file:
        content = file.read(_HEAD_SIZE)
    begin = content.find(_DATA_MARK)
    try:
        if begin < 0:
            raise Malformed("it has no appended data")
        at = begin + len(_DATA_MARK)
        size = int(np.frombuffer(content, "<u8", 4, at)[3])
        return float(np.frombuffer(zlib.decompress(content[at + 32 : at + 32 + size]), "<f8", 1)[0])
    except (ValueError, zlib.error) as error:
        raise ValueError(
            f"{path} is no frame: {why(error)}. Remove it, or write it again."
        ) from None


Packed = tuple[str, str, int, bytes]


def _packed(name: str, values: np.ndarray) -> Packed:
    """Name, type, components and compressed block of an array."""
    values = np.ascontiguousarray(values)
    kind = _TYPES[values.dtype.str[1:]]
    raw = values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes()
    squeezed = zlib.compress(raw, _LEVEL)
    header = np.array([1, len(raw), 0, len(squeezed)], "<u8").tobytes()
    components = values.shape[1] if values.ndim == 2 else 1
    return name, kind, components, header + squeezed


def _entry(array: Packed, offset: int, more: str = "") -> str:
    name, kind, components, _ = array
    said = "" if components == 1 else f' NumberOfComponents="{components}"'
    said += "".join(
        f' ComponentName{i}="{part}"' for i, part in enumerate(_COMPONENTS.get(components, ()))
    )
    return (
        f'<DataArray type="{kind}" Name="{name}"{said}{more} format="appended" offset="{offset}"/>'
    )


def _number(name: str, value: int) -> str:
    return f'<DataArray type="Int32" Name="{name}"{_ONE_TUPLE} format="ascii">{value}</DataArray>'
