"""Reading and writing of labelled meshes: vtu, msh, xdmf, mesh-complete folders, vtp surfaces.

Every reader and writer of a mesh asks for the length unit of the file; nothing is guessed.
"""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.mesh_files.any_format import read_mesh, write_mesh
    from jaxfsi.mesh_files.axes import AXES, Axes, stated_axes, turned
    from jaxfsi.mesh_files.joining import JoinedNodes, join_nodes
    from jaxfsi.mesh_files.lengths import UNITS_CM, Unit, check_extent, check_unit
    from jaxfsi.mesh_files.markups import Markup, read_markups
    from jaxfsi.mesh_files.mesh_complete import read_mesh_complete, write_mesh_complete
    from jaxfsi.mesh_files.msh import read_msh, write_msh
    from jaxfsi.mesh_files.polylines import RADIUS, PolylineFile, read_polylines, write_polylines
    from jaxfsi.mesh_files.refusal import MeshFileError, reading, staged
    from jaxfsi.mesh_files.vtp import TriangleFile, read_vtp, write_vtp
    from jaxfsi.mesh_files.vtu import read_vtu, write_vtu
    from jaxfsi.mesh_files.xdmf import read_xdmf, write_xdmf

__all__ = [
    "AXES",
    "RADIUS",
    "UNITS_CM",
    "Axes",
    "JoinedNodes",
    "Markup",
    "MeshFileError",
    "PolylineFile",
    "TriangleFile",
    "Unit",
    "check_extent",
    "check_unit",
    "join_nodes",
    "read_markups",
    "read_mesh",
    "read_mesh_complete",
    "read_msh",
    "read_polylines",
    "read_vtp",
    "read_vtu",
    "read_xdmf",
    "reading",
    "staged",
    "stated_axes",
    "turned",
    "write_mesh",
    "write_mesh_complete",
    "write_msh",
    "write_polylines",
    "write_vtp",
    "write_vtu",
    "write_xdmf",
]

import_on_first_use(__name__)
