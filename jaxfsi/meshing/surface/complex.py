"""A piecewise-linear complex: the surfaces of blood and wall over shared points.

The interface closes with the discs to the surface of the blood, and, turned round, with the outer
wall and the annuli to the surface of the wall.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy import Anatomy
from jaxfsi.anatomy.surfaces.crossings import crossing_faces
from jaxfsi.faces import boundary_of, find_rows
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX, Region
from jaxfsi.mesh_checks import place
from jaxfsi.meshing.columns.stack import Stack, no_stack, sides_over, stack_sides
from jaxfsi.meshing.isolate import MeshingError
from jaxfsi.meshing.structured.prisms import tets_of_wedges
from jaxfsi.meshing.surface.caps import annulus, disc
from jaxfsi.meshing.surface.clipping import ClippedSurface
from jaxfsi.meshing.surface.projection import triangle_qualities
from jaxfsi.meshing.surface.sizes import SizeField
from jaxfsi.meshing.surface.topology import surface_topology


class Complex(NamedTuple):
    """Labelled triangles over shared points.

    Attributes:
        points: vertices [cm].
        triangles: normals out of the fluid for the interface, out of the domain elsewhere.
        label: index into ``label_names`` of each triangle.
        label_names: interface, outer wall, then disc and ring of each opening.
        wedges: columns in the wall, if any: three points inside, then those above them.
    """

    points: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    label: Int[np.ndarray, " triangles"]
    label_names: tuple[str, ...]
    wedges: Int[np.ndarray, "wedges 6"] = np.zeros((0, 6), dtype=np.int64)

    @property
    def wedge_tets(self) -> Int[np.ndarray, "tets 4"]:
        """The tetrahedra that fill the wedges, three each."""
        return tets_of_wedges(self.wedges, self.points)


class RegionSurface(NamedTuple):
    """The closed surface of one region.

    Attributes:
        points: the vertices used [cm].
        triangles: normals outwards.
        label: of each triangle.
        nodes: index of each vertex in the complex.
    """

    points: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    label: Int[np.ndarray, " triangles"]
    nodes: Int[np.ndarray, " points"]


def assemble(
    anatomy: Anatomy,
    lumen: ClippedSurface,
    wall: ClippedSurface,
    field: SizeField,
    *,
    wall_layers: int,
    columns: Stack | None = None,
) -> Complex:
    """Close the clipped surfaces of lumen and wall by caps and join them.

    Args:
        anatomy: its openings are closed.
        lumen: surface of the blood.
        wall: outer surface of the wall.
        field: element size.
        wall_layers: least number of layers across an annulus.
        columns: wedges between the two surfaces; where they line the rim of an opening, their
            sides are its ring.
    """
    shift = len(lumen.surface.points)
    columns = columns or no_stack()
    points = [lumen.surface.points, wall.surface.points, columns.levels]
    triangles = [lumen.surface.triangles, wall.surface.triangles + shift]
    names = [INTERFACE, OUTER_WALL]
    count = sum(len(part) for part in points)
    sides = stack_sides(columns, np.concatenate(points))
    for opening, inner, outer in zip(anatomy.openings, lumen.loops, wall.loops, strict=True):
        inner_points, outer_points = lumen.surface.points[inner], wall.surface.points[outer]
        cap = disc(inner_points, opening, field)
        index = np.concatenate([inner, count + np.arange(len(cap.added))])
        points.append(cap.added)
        triangles.append(index[cap.triangles])
        names.append(opening.name)
        count += len(cap.added)
        names.append(opening.name + RING_SUFFIX)
        ring = sides_over(columns, sides, inner)
        if len(ring):
            triangles.append(ring)
            continue
        cap = annulus(inner_points, outer_points, opening, field, layers=wall_layers)
        added = count + np.arange(len(cap.added))
        index = np.concatenate([inner, outer + shift, added])
        points.append(cap.added)
        triangles.append(index[cap.triangles])
        count += len(cap.added)
    label = np.repeat(np.arange(len(triangles)), [len(part) for part in triangles])
    return Complex(
        np.concatenate(points),
        np.concatenate(triangles),
        label,
        tuple(names),
        columns.wedges,
    )


def region_surface(complex_: Complex, region: Region) -> RegionSurface:
    """The closed surface of the blood or of the wall, normals outwards."""
    names = np.array(complex_.label_names)
    interface = complex_.label == 0
    of_wall = (names == OUTER_WALL) | np.char.endswith(names, RING_SUFFIX)
    if region == Region.FLUID:
        rows = ~of_wall[complex_.label]
        triangles = complex_.triangles[rows]
    else:
        rows = of_wall[complex_.label] | interface
        turned = interface[rows, None]
        triangles = complex_.triangles[rows]
        triangles = np.where(turned, triangles[:, ::-1], triangles)
    nodes, back = np.unique(triangles, return_inverse=True)
    return RegionSurface(complex_.points[nodes], back.reshape(-1, 3), complex_.label[rows], nodes)


def unfilled_surface(complex_: Complex) -> RegionSurface | None:
    """The surface of what no wedge fills of the wall, normals outwards; None where they fill all.

    The sides of wedges in it have a label of their own after those of the complex.
    """
    whole = region_surface(complex_, Region.SOLID)
    if len(complex_.wedges) == 0:
        return whole
    outside, filled = whole.nodes[whole.triangles], boundary_of(complex_.wedge_tets)
    kept = find_rows(outside, filled) < 0
    sides = filled[find_rows(filled, outside) < 0][:, ::-1]
    nodes, back = np.unique(np.concatenate([outside[kept], sides]), return_inverse=True)
    label = np.concatenate([whole.label[kept], np.full(len(sides), len(complex_.label_names))])
    if len(label) == 0:
        return None
    return RegionSurface(complex_.points[nodes], back.reshape(-1, 3), label, nodes)


def check_complex(complex_: Complex, anatomy: Anatomy, *, least_quality: float) -> None:
    """Refuse a complex that no mesher can fill well.

    Raises:
        MeshingError: a region is not closed, has a wrong Euler number, the surfaces cross, or a
            triangle is too poor.
    """
    faults = []
    expected = {Region.FLUID: 2, Region.SOLID: 2 * (2 - len(anatomy.openings))}
    for region in Region:
        surface = region_surface(complex_, region)
        name = region.name.lower()
        topology = surface_topology(surface.points, surface.triangles)
        if not topology.is_closed_manifold:
            faults.append(f"the surface of the {name} is not closed or touches itself")
        if topology.euler != expected[region]:
            faults.append(
                f"the surface of the {name} has Euler number {topology.euler} instead of"
                f" {expected[region]}"
            )
    quality = triangle_qualities(complex_.points, complex_.triangles)
    if quality.min() < least_quality:
        faults.append(f"a triangle has quality {quality.min():.3f} (least {least_quality})")
    outside = _outside(complex_, anatomy)
    if outside:
        faults.append(f"{outside} triangles of lumen or wall lie on the wrong side of the other")
    unfilled = unfilled_surface(complex_)
    triangles = complex_.triangles
    if unfilled is not None and len(complex_.wedges):
        if not surface_topology(unfilled.points, unfilled.triangles).is_closed_manifold:
            faults.append("the surface of the wall beside its wedges is not closed")
        sides = unfilled.label == len(complex_.label_names)
        triangles = np.concatenate([triangles, unfilled.nodes[unfilled.triangles[sides]]])
    crossing = np.unique(crossing_faces(complex_.points, triangles)[:, 1])
    if len(crossing):
        at = complex_.points[triangles[crossing[0]]].mean(axis=0)
        faults.append(f"{len(crossing)} triangles cut others, the first at {place(at)}")
    if faults:
        raise MeshingError(
            f"the surface of {anatomy.name!r} cannot be filled: {'; '.join(faults)}. Use a finer"
            " preset; a septum or wall thinner than the smallest element needs one."
        )


def _outside(complex_: Complex, anatomy: Anatomy) -> int:
    """Triangles of the interface outside the wall, and of the wall inside the lumen."""
    centre = complex_.points[complex_.triangles].mean(axis=1)
    interface, wall = (complex_.label == i for i in (0, 1))
    outside = anatomy.wall(centre[interface]) >= 0.0
    inside = anatomy.lumen(centre[wall]) <= 0.0
    return int(outside.sum() + inside.sum())
