"""Arrays of a written frame, read back."""

import pathlib
from collections.abc import Sequence

import numpy as np

from jaxfsi.mesh_files.vtk_xml import open_vtk_xml, read_array


def frame_arrays(path: pathlib.Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Some arrays of a written frame, by name."""
    file = open_vtk_xml(path, "UnstructuredGrid")
    found = {}
    for element in file.root.iter("DataArray"):
        name = element.get("Name", "")
        if name in names:
            found[name] = read_array(file, element)
    return found
