"""Axes of a patient's coordinates: RAS or LPS, as files of 3D Slicer say in their header.

Both have z to the head; x and y point to the right and front (RAS) or to the left and back (LPS),
so that one becomes the other by a half turn about z. Slicer writes `SPACE=LPS` into the header of
STL and PLY files, and a field `SPACE` into VTK's XML files; most other programs say nothing.
"""

import os
import pathlib
import re
import xml.etree.ElementTree as ET
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from jaxfsi.mesh_files.refusal import MeshFileError, reading
from jaxfsi.mesh_files.vtk_xml import open_vtk_xml, read_array
from jaxfsi.text_files import regular_bytes

Axes = Literal["LPS", "RAS"]
AXES: tuple[Axes, ...] = get_args(Axes)

_HEADER = re.compile(rb"SPACE\s*=\s*([A-Za-z]{3})")
_LENGTH = {".stl": 80, ".ply": 4096, ".obj": 4096}
"""Bytes in which a header lies, by the suffix of the file."""


def stated_axes(path: str | os.PathLike[str]) -> Axes | None:
    """Axes that the header of a surface or of centre lines states; None: it says nothing.

    Args:
        path: STL, PLY, OBJ or VTP file.

    Raises:
        MeshFileError: the file states axes that are neither LPS nor RAS, or cannot be read.
    """
    path = pathlib.Path(path)
    with reading(path, "a surface"):
        if path.suffix.lower() == ".vtp":
            said = _vtk_field(path)
        else:
            found = _HEADER.search(regular_bytes(path)[: _LENGTH.get(path.suffix.lower(), 0)])
            said = "" if found is None else found[1].decode()
    if not said:
        return None
    for axes in AXES:
        if said.upper() == axes:
            return axes
    raise MeshFileError(
        f"{path} states the axes {said!r}, which are not known. Export it in LPS or RAS."
    )


def _vtk_field(path: pathlib.Path) -> str:
    """The text of the field `SPACE` of a VTK file; empty where there is none."""
    file = open_vtk_xml(path, "PolyData")
    for element in file.root.iterfind("PolyData/FieldData/*"):
        if element.get("Name") == "SPACE" and element.get("type") == "String":
            codes = ET.Element("DataArray", {**element.attrib, "type": "UInt8"})
            codes.text = element.text
            return bytes(read_array(file, codes).tolist()).split(b"\0")[0].decode("latin-1")
    return ""


def turned(
    points: Float[np.ndarray, "*batch 3"], given: Axes, wanted: Axes
) -> Float[np.ndarray, "*batch 3"]:
    """Coordinates in other axes: a half turn about z where the two differ.

    Args:
        points: positions or directions.
        given: their axes.
        wanted: axes of the result.
    """
    return points if given == wanted else points * np.array([-1.0, -1.0, 1.0])
