"""Stress and strain of the wall on its elements.

::

    σ = (P(F) + F S₀ + F 2η Ė) Fᵀ / J,     E = (FᵀF − I)/2,     Ė = sym(Fᵀ ∂u/∂X)
    von Mises:  √(3/2 s:s),  s = σ − tr(σ)/3 I

P: first Piola-Kirchhoff stress of the material, S₀: prestress, η: Kelvin-Voigt viscosity.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.bending import BendingElement
from jaxfsi.core.elements.linear import Geometry, added
from jaxfsi.core.elements.wall import AbstractWallElement
from jaxfsi.core.laws.materials import (
    Tensor,
    combined,
    determinant,
    plus_identity,
    product,
    stacked,
    transposed,
)
from jaxfsi.core.laws.solid import Wall, cauchy_stress, deformation_gradients, inelastic_stress
from jaxfsi.core.laws.wall_balance import WallElements, WallPrestress, WallShape, by_part
from jaxfsi.core.laws.wedge_solid import wedge_stress_and_strain
from lumped.parameters import Parameter


class WallStress(NamedTuple):
    """Stress and strain on each element of the wall.

    Attributes:
        sigma: Cauchy stress [dyn/cm²].
        von_mises: its von Mises stress [dyn/cm²].
        strain: Green's strain.
    """

    sigma: Float[Array, "3 3 tets"]
    von_mises: Float[Array, " tets"]
    strain: Float[Array, "3 3 tets"]


def wall_stress(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    element: WallElements,
    shape: WallShape,
    prestress: WallPrestress = None,
    P_ambient: Parameter = 0.0,
) -> WallStress:
    """Stress and strain of the wall, the mean of its quadrature points; differentiable.

    Args:
        u: velocity [cm/s].
        d: displacement [cm].
        wall: what the wall is made of.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: second Piola-Kirchhoff stress that is there without deformation [dyn/cm²].
        P_ambient: pressure from which the stress of the equations counts, see `Model` [dyn/cm²].
    """
    if isinstance(element, BendingElement):
        wedges, rest = by_part(
            element,
            wall,
            shape,
            prestress,
            lambda *part: wedge_stress_and_strain(u, d, *part),
            lambda *part: _tet_stress(u, d, *part),
        )
        sigma = element.by_tets(wedges.sigma, rest[0])
        strain = element.by_tets(wedges.strain, rest[1])
    else:
        sigma, strain = _tet_stress(u, d, wall, element, shape, prestress)
    sigma = plus_identity(sigma, -P_ambient)
    deviator = plus_identity(sigma, -(sigma[0][0] + sigma[1][1] + sigma[2][2]) / 3.0)
    square = 1.5 * added(deviator[i][j] ** 2 for i in range(3) for j in range(3))
    loaded = square > 0.0
    von_mises = jnp.where(loaded, jnp.sqrt(jnp.where(loaded, square, 1.0)), 0.0)
    return WallStress(stacked(sigma), von_mises, strain)


def _tet_stress(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None,
) -> tuple[Float[Array, "3 3 tets"], Float[Array, "3 3 tets"]]:
    """Cauchy stress and Green's strain, the mean of the quadrature points."""
    F = deformation_gradients(d, element, shape)
    elastic = cauchy_stress(d, wall, element, shape, prestress)
    sigma = combined((1.0, elastic), (1.0, _viscous(F, element.gradients(u, shape), wall)))
    strain = combined((0.5, plus_identity(product(transposed(F), F), -1.0)))
    return jnp.mean(stacked(sigma), axis=2), jnp.mean(stacked(strain), axis=2)


def _viscous(F: Tensor, gradients: Tensor, wall: Wall) -> Tensor:
    """Cauchy stress of the Kelvin-Voigt viscosity."""
    stress = inelastic_stress(F, gradients, wall, None)
    return combined((1.0 / determinant(F), product(stress, transposed(F))))
