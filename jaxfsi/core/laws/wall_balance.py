"""Forces and stresses of a wall of any elements: tetrahedra, or wedges and tetrahedra.

`laws.solid` has the balance of tetrahedra, `laws.wedge_solid` that of wedges.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from jaxtyping import Array, Float

from jaxfsi.core.elements.bending import BendingElement, BendingPrestress, BendingShape
from jaxfsi.core.elements.linear import Geometry, geometry
from jaxfsi.core.elements.wall import AbstractWallElement
from jaxfsi.core.laws.materials import AbstractMaterial, stacked
from jaxfsi.core.laws.solid import (
    Wall,
    deformation_gradients,
    elastic_stress,
    solid_residual,
)
from jaxfsi.core.laws.wedge_solid import wedge_prestress, wedge_residual

WallElements = AbstractWallElement | BendingElement
WallShape = Any
"""`Geometry` of tetrahedra, `BendingShape` of a wall that bends."""

WallPrestress = Any
"""An array (3, 3, points, tets) of tetrahedra, `BendingPrestress` of a wall that bends, or None."""

OfWedges = TypeVar("OfWedges")
OfRest = TypeVar("OfRest")


def wall_geometry(x: Float[Array, "3 nodes"], element: WallElements) -> WallShape:
    """Shape of the elements of a wall with node positions x [cm]."""
    if isinstance(element, BendingElement):
        return element.geometry(x)
    return geometry(x, element.tets)


def by_part(
    element: BendingElement,
    wall: Wall,
    shape: BendingShape,
    prestress: BendingPrestress | None,
    of_wedges: Callable[..., OfWedges],
    of_rest: Callable[..., OfRest],
) -> tuple[OfWedges, OfRest]:
    """What two functions give of the wedges and of the rest, each with (wall, element, shape, S₀).

    Args:
        element: elements of the wall.
        wall: what it is made of.
        shape: of the elements.
        prestress: of the wall.
        of_wedges: applied to the wedges.
        of_rest: applied to the other tetrahedra.
    """
    S = (None, None) if prestress is None else (prestress.of_wedges, prestress.rest)
    return (
        of_wedges(element.in_wedges(wall), element.wedges, shape.wedges, S[0]),
        of_rest(element.in_rest(wall), element.rest, shape.rest, S[1]),
    )


def wall_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    element: WallElements,
    shape: WallShape,
    prestress: WallPrestress = None,
) -> Float[Array, "3 nodes"]:
    """Internal and inertial forces of the wall on each node [dyn].

    Args:
        u: velocity [cm/s].
        a: acceleration [cm/s²].
        d: displacement from the reference configuration [cm].
        wall: what the wall is made of; its numbers may have one value a tetrahedron.
        element: elements of the wall.
        shape: see `wall_geometry`, in the reference configuration.
        prestress: second Piola-Kirchhoff stress that is there without deformation [dyn/cm²].
    """
    if not isinstance(element, BendingElement):
        return solid_residual(u, a, d, wall, element, shape, prestress)
    forces = by_part(
        element,
        wall,
        shape,
        prestress,
        lambda *part: wedge_residual(u, a, d, *part),
        lambda *part: solid_residual(u, a, d, *part),
    )
    return forces[0] + forces[1]


def second_stress(
    d: Float[Array, "3 nodes"],
    material: AbstractMaterial,
    element: WallElements,
    shape: WallShape,
) -> Float[Array, "3 3 points tets"] | BendingPrestress:
    """Stress of small displacements at the quadrature points [dyn/cm²], as a prestress has it.

    Args:
        d: displacement [cm].
        material: Hooke's law.
        element: elements of the wall.
        shape: see `wall_geometry`.
    """
    if isinstance(element, BendingElement):
        in_wedges, in_rest = element.in_wedges(material), element.in_rest(material)
        return BendingPrestress(
            *wedge_prestress(d, in_wedges, element.wedges, shape.wedges),
            _tet_stress(d, in_rest, element.rest, shape.rest),
        )
    return _tet_stress(d, material, element, shape)


def _tet_stress(
    d: Float[Array, "3 nodes"],
    material: AbstractMaterial,
    element: AbstractWallElement,
    shape: Geometry,
) -> Float[Array, "3 3 points tets"]:
    F = deformation_gradients(d, element, shape)
    return stacked(elastic_stress(F, material, element, shape, d.shape[1]))
