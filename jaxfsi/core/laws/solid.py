"""Balance of momentum of the wall in its reference configuration.

::

    ∫ ρ_s N_a a dV + ∫ (P(F) + F S₀ + P_v) ∇N_a dV = loads

with the first Piola-Kirchhoff stress P of the material, a prestress S₀ (second Piola-Kirchhoff,
Hsu & Bazilevs 2011, eq. 8) and Kelvin-Voigt damping P_v = F 2η Ė.
"""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import Geometry, fusion_barrier
from jaxfsi.core.elements.wall import AbstractWallElement
from jaxfsi.core.laws.materials import (
    AbstractMaterial,
    Tensor,
    combined,
    determinant,
    plus_identity,
    product,
    stacked,
    transposed,
)
from jaxfsi.nominal import WALL_DENSITY
from lumped.parameters import Parameter, Range, check_range, parameter


class Wall(eqx.Module):
    """What the wall is made of.

    Attributes:
        material: elastic law.
        rho_s: density [g/cm³].
        damping: Kelvin-Voigt viscosity η [g/(cm·s)].
        support_stiffness: of the tissue outside, traction per displacement [dyn/cm³].
        support_damping: of the tissue outside, traction per velocity [dyn·s/cm³].
    """

    ranges: ClassVar[Range] = Range(
        above=("rho_s",), least=("damping", "support_stiffness", "support_damping")
    )
    material: AbstractMaterial
    rho_s: Parameter = parameter(default=WALL_DENSITY)
    damping: Parameter = parameter(default=0.0)
    support_stiffness: Parameter = parameter(default=0.0)
    support_damping: Parameter = parameter(default=0.0)

    def __check_init__(self):
        """Refuse a density that is not positive and negative dampers; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)


class WallMotion(NamedTuple):
    """Deformation of the wall.

    Attributes:
        F: deformation gradients at the quadrature points.
        rate: their rates [1/s].
    """

    F: Tensor
    rate: Tensor


def wall_motion(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    element: AbstractWallElement,
    shape: Geometry,
) -> WallMotion:
    """Deformation of velocities u [cm/s] and displacements d [cm]."""
    return WallMotion(deformation_gradients(d, element, shape), element.gradients(u, shape))


def deformation_gradients(
    d: Float[Array, "3 nodes"], element: AbstractWallElement, shape: Geometry
) -> Tensor:
    """F = I + ∂d/∂X at the quadrature points of each element."""
    return plus_identity(element.gradients(d, shape), 1.0)


def solid_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None = None,
) -> Float[Array, "3 nodes"]:
    """Internal and inertial forces of the wall on each node [dyn].

    Args:
        u: velocity [cm/s].
        a: acceleration [cm/s²].
        d: displacement from the reference configuration [cm].
        wall: what the wall is made of.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: second Piola-Kirchhoff stress that is there without deformation, at each
            quadrature point [dyn/cm²].
    """
    F, rate = fusion_barrier(wall_motion(u, d, element, shape), shape)
    elastic = elastic_stress(F, wall.material, element, shape, u.shape[1])
    stress = combined((1.0, elastic), (1.0, inelastic_stress(F, rate, wall, prestress)))
    return element.forces(fusion_barrier(stress, shape), a, wall.rho_s * shape.volume, shape)


def elastic_stress(
    F: Tensor, material: AbstractMaterial, element: AbstractWallElement, shape: Geometry, n: int
) -> Tensor:
    """First Piola-Kirchhoff stress of elasticity at the quadrature points [dyn/cm²].

    Args:
        F: deformation gradients.
        material: elastic law.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        n: number of nodes.
    """
    pressures = element.pressures(F, material, shape, n)
    return local_stress(F, [p.value for p in pressures], material, element)


def local_stress(
    F: Tensor,
    pressures: Sequence[Float[Array, "*points tets"]],
    material: AbstractMaterial,
    element: AbstractWallElement,
) -> Tensor:
    """First Piola-Kirchhoff stress of elasticity where pressures act on the measures of volume."""
    stress = element.law(material).stress(F)
    if pressures:
        for p, volume in zip(pressures, material.volumes(F), strict=True):
            stress = combined((1.0, stress), (p, volume.slope))
    return stress


def inelastic_stress(
    F: Tensor, rate: Tensor, wall: Wall, prestress: Float[Array, "3 3 *points tets"] | None
) -> Tensor:
    """First Piola-Kirchhoff stress of damping and prestress [dyn/cm²]."""
    strain_rate = product(transposed(F), rate)
    S = combined((wall.damping, strain_rate), (wall.damping, transposed(strain_rate)))
    if prestress is not None:
        S = combined((1.0, S), (1.0, prestress))
    return product(F, S)


def cauchy_stress(
    d: Float[Array, "3 nodes"],
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None = None,
) -> Float[Array, "3 3 points tets"]:
    """Elastic stress and prestress in the deformed wall, σ = P Fᵀ/J [dyn/cm²].

    It counts from the ambient pressure of a model, −P_ambient I.

    Args:
        d: displacement from the reference configuration [cm].
        wall: what the wall is made of.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: see `solid_residual`.
    """
    F = deformation_gradients(d, element, shape)
    P = elastic_stress(F, wall.material, element, shape, d.shape[1])
    if prestress is not None:
        P = combined((1.0, P), (1.0, product(F, prestress)))
    return stacked(combined((1.0 / determinant(F), product(P, transposed(F)))))
