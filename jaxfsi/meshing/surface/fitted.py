"""A surface of lumen or wall fitted to its function, its borders in the planes of the openings."""

from jaxfsi.anatomy import Anatomy
from jaxfsi.meshing.surface.clipping import ClippedSurface, find_loops, flatten_loops, on_planes
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import balance, project

NAMES = ("lumen", "wall")


def fitted(surface: Surface, anatomy: Anatomy, which: int) -> ClippedSurface:
    """Move the vertices of a surface onto the zero set of its function.

    Args:
        surface: cut at the openings.
        anatomy: lumen and wall as functions.
        which: 0 for the lumen, 1 for the outer surface of the wall.

    Raises:
        ValueError: the surface has no border at an opening, or several.
    """
    loops = find_loops(surface, anatomy.openings, what=NAMES[which])
    clipped = flatten_loops(ClippedSurface(surface, loops), anatomy.openings)
    f = (anatomy.lumen, anatomy.wall)[which]
    planes = on_planes(clipped, anatomy.openings)
    surface = project(clipped.surface, f, plane_normals=planes)
    return ClippedSurface(balance(surface, f, plane_normals=planes), loops)
