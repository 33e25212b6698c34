"""Anatomy, and the fluid-structure core that shares the boundary blocks of `lumped`."""

from jaxfsi.contours import read_ivus_contours
from jaxfsi.lumen import Calipers, EllipseAxes, Lumen
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Mesh, Region, tet_faces, tet_volumes
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.mesh_parts import Submesh, node_order, reordered, scaled, submesh, used_nodes
