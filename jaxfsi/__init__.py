"""Anatomy, and the fluid-structure core that shares the boundary blocks of `lumped`."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.contours import read_ivus_contours
    from jaxfsi.lumen import Calipers, EllipseAxes, Lumen
    from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region, tet_faces, tet_volumes
    from jaxfsi.mesh_checks import check_mesh
    from jaxfsi.mesh_parts import Submesh, node_order, reordered, scaled, submesh, used_nodes

__all__ = [
    "INTERFACE",
    "OUTER_WALL",
    "RING_SUFFIX",
    "Calipers",
    "EllipseAxes",
    "Lumen",
    "Mesh",
    "Region",
    "Submesh",
    "check_mesh",
    "node_order",
    "read_ivus_contours",
    "reordered",
    "scaled",
    "submesh",
    "tet_faces",
    "tet_volumes",
    "used_nodes",
]

import_on_first_use(__name__)
