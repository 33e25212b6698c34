"""Balance of momentum of the wall in its reference configuration.

::

    ∫ ρ_s N_a a dV + ∫ (P(F) + F S₀ + P_v) ∇N_a dV = loads

with the first Piola-Kirchhoff stress P of the material, a prestress S₀ (second Piola-Kirchhoff,
Hsu & Bazilevs 2011, eq. 8) and Kelvin-Voigt damping P_v = F 2η Ė.
"""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import Geometry, fusion_barrier
from jaxfsi.core.elements.wall import AbstractWallElement, Points
from jaxfsi.core.laws.materials import (
    AbstractMaterial,
    Tensor,
    combined,
    determinant,
    plus_identity,
    product,
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

    F: Points
    rate: Points


def wall_motion(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    element: AbstractWallElement,
    shape: Geometry,
) -> WallMotion:
    """Deformation of velocities u [cm/s] and displacements d [cm]."""
    rate = tuple(combined((1.0, H)) for H in element.gradients(u, shape))
    return WallMotion(deformation_gradients(d, element, shape), rate)


def deformation_gradients(
    d: Float[Array, "3 nodes"], element: AbstractWallElement, shape: Geometry
) -> Points:
    """F = I + ∂d/∂X at the quadrature points of each element."""
    return tuple(plus_identity(H, 1.0) for H in element.gradients(d, shape))


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
    stress = tuple(
        combined((1.0, P), (1.0, inelastic_stress(F[g], rate[g], wall, prestress_at(prestress, g))))
        for g, P in enumerate(elastic)
    )
    stress = fusion_barrier(stress, shape)
    return element.forces(stress, a, wall.rho_s * shape.volume, shape)


def elastic_stress(
    F: Points, material: AbstractMaterial, element: AbstractWallElement, shape: Geometry, n: int
) -> Points:
    """First Piola-Kirchhoff stress of elasticity at the quadrature points [dyn/cm²].

    Args:
        F: deformation gradients.
        material: elastic law.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        n: number of nodes.
    """
    pressures = element.pressures(F, material, shape, n)
    return tuple(
        local_stress(f, tuple(p.value[g] for p in pressures), material, element)
        for g, f in enumerate(F)
    )


def local_stress(
    F: Tensor,
    pressures: Sequence[Float[Array, " tets"]],
    material: AbstractMaterial,
    element: AbstractWallElement,
) -> Tensor:
    """First Piola-Kirchhoff stress of elasticity where pressures act on the measures of volume."""
    stress = element.law(material).stress(F)
    if pressures:
        for p, volume in zip(pressures, material.volumes(F), strict=True):
            stress = combined((1.0, stress), (p, volume.slope))
    return stress


def prestress_at(
    prestress: Float[Array, "3 3 points tets"] | None, point: int
) -> Float[Array, "3 3 tets"] | None:
    """Prestress at a quadrature point, where there is one."""
    return None if prestress is None else prestress[:, :, point]


def inelastic_stress(
    F: Tensor, rate: Tensor, wall: Wall, prestress: Float[Array, "3 3 tets"] | None
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
    elastic = elastic_stress(F, wall.material, element, shape, d.shape[1])
    points = []
    for g, P in enumerate(elastic):
        whole = P
        if prestress is not None:
            whole = combined((1.0, P), (1.0, product(F[g], prestress[:, :, g])))
        J = determinant(F[g])
        points.append(
            jnp.stack([jnp.stack([s / J for s in r]) for r in product(whole, transposed(F[g]))])
        )
    return jnp.stack(points, axis=2)
