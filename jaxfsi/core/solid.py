"""Balance of momentum of the wall in its reference configuration.

::

    ∫ ρ_s N_a a dV + ∫ (P(F) + F S₀ + P_v) ∇N_a dV = loads

with the first Piola-Kirchhoff stress P of the material, a prestress S₀ (second Piola-Kirchhoff,
Hsu & Bazilevs 2011, eq. 8) and Kelvin-Voigt damping P_v = F 2η Ė.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements import Geometry, kept_apart
from jaxfsi.core.materials import (
    AbstractMaterial,
    LinearElastic,
    combined,
    determinant,
    plus_identity,
    product,
    transposed,
)
from jaxfsi.core.wall_elements import AbstractWallElement, Points, Weights
from lumped.parameters import Parameter, parameter


class Wall(eqx.Module):
    """What the wall is made of.

    Attributes:
        material: elastic law.
        rho_s: density [g/cm³].
        damping: Kelvin-Voigt viscosity η [g/(cm·s)].
        support_stiffness: of the tissue outside, traction per displacement [dyn/cm³].
        support_damping: of the tissue outside, traction per velocity [dyn·s/cm³].
    """

    material: AbstractMaterial
    rho_s: Parameter = parameter(default=1.1)
    damping: Parameter = parameter(default=0.0)
    support_stiffness: Parameter = parameter(default=0.0)
    support_damping: Parameter = parameter(default=0.0)


def deformation_gradients(
    d: Float[Array, "3 nodes"], element: AbstractWallElement, shape: Geometry
) -> Points:
    """F = I + ∂d/∂X at the quadrature points of each element."""
    return tuple(plus_identity(H, 1.0) for H in element.slopes(d, shape))


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
    F, rate = kept_apart(wall_motion(u, d, element, shape), shape)
    stress = _stress(F, rate, wall, element, shape, prestress, u.shape[1])
    stress = kept_apart(stress, shape)
    return element.forces(stress, a, wall.rho_s * shape.volume, shape)


def _stress(
    F: Points,
    rate: Points,
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None,
    n_nodes: int,
) -> Points:
    """First Piola-Kirchhoff stress of elasticity, damping and prestress [dyn/cm²]."""
    stress = []
    for g, elastic in enumerate(element.stress(F, wall.material, shape, n_nodes)):
        strain_rate = product(transposed(F[g]), rate[g])
        S = combined((wall.damping, strain_rate), (wall.damping, transposed(strain_rate)))
        if prestress is not None:
            S = combined((1.0, S), (1.0, prestress[:, :, g]))
        stress.append(combined((1.0, elastic), (1.0, product(F[g], S))))
    return tuple(stress)


class WallMotion(NamedTuple):
    """Deformation about which the wall's forces are linearised.

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
    rate = tuple(combined((1.0, H)) for H in element.slopes(u, shape))
    return WallMotion(deformation_gradients(d, element, shape), rate)


def solid_tangent(
    v: Float[Array, "3 nodes"],
    weights: Weights,
    motion: WallMotion,
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None = None,
) -> Float[Array, "3 nodes"]:
    """Change of the wall's forces along v.

    Args:
        v: change of the unknown.
        weights: what it does to acceleration, velocity and displacement.
        motion: deformation about which the forces are linearised.
        wall: what the wall is made of.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: see `solid_residual`.
    """

    def stress(motion: WallMotion) -> Points:
        return _stress(*motion, wall, element, shape, prestress, v.shape[1])

    slopes = element.slopes(v, shape)
    along = WallMotion(
        tuple(combined((weights.d, H)) for H in slopes),
        tuple(combined((weights.u, H)) for H in slopes),
    )
    _, change = jax.jvp(stress, (motion,), (along,))
    change = kept_apart(change, shape)
    return element.forces(change, v, weights.a * wall.rho_s * shape.volume, shape)


def reference_tangent(
    v: Float[Array, "3 nodes"],
    weights: Weights,
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None = None,
) -> Float[Array, "3 nodes"]:
    """`solid_tangent` about the undeformed wall at rest, where Hooke's law gives it."""
    n_nodes = v.shape[1]
    slopes = element.slopes(v, shape)
    lam, G = wall.material.moduli
    hooke = LinearElastic.of_moduli(lam, G)
    elastic = element.stress(tuple(plus_identity(H, 1.0) for H in slopes), hooke, shape, n_nodes)
    eta = weights.u * wall.damping
    stress = []
    for g, H in enumerate(slopes):
        P = combined((weights.d, elastic[g]), (eta, H), (eta, transposed(H)))
        if prestress is not None:
            P = combined((1.0, P), (weights.d, product(H, prestress[:, :, g])))
        stress.append(P)
    return element.forces(tuple(stress), v, weights.a * wall.rho_s * shape.volume, shape)


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
    elastic = element.stress(F, wall.material, shape, d.shape[1])
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
