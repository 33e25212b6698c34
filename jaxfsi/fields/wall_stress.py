"""Stress and strain of the wall on its elements.

::

    σ = (P(F) + F S₀ + F 2η Ė) Fᵀ / J,     E = (FᵀF − I)/2,     Ė = sym(Fᵀ ∂u/∂X)
    von Mises:  √(3/2 s:s),  s = σ − tr(σ)/3 I

P: first Piola-Kirchhoff stress of the material, S₀: prestress, η: Kelvin-Voigt viscosity.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements import added, geometry, gradient, vector_corners
from jaxfsi.core.materials import combined, plus_identity, product, transposed
from jaxfsi.core.solid import Wall, deformation_gradient


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
    x: Float[Array, "3 nodes"],
    wall: Wall,
    tets: Int[Array, "4 tets"],
    prestress: Float[Array, "3 3 tets"] | None = None,
) -> WallStress:
    """Stress and strain of the wall; differentiable.

    Args:
        u: velocity [cm/s].
        d: displacement [cm].
        x: reference positions [cm].
        wall: what the wall is made of.
        tets: elements of the wall.
        prestress: second Piola-Kirchhoff stress that is there without deformation [dyn/cm²].
    """
    shape = geometry(x, tets)
    F = deformation_gradient(d, tets, shape)
    slopes = [gradient(component, shape) for component in vector_corners(u, tets)]
    strain_rate = product(transposed(F), slopes)
    S = combined((wall.damping, strain_rate), (wall.damping, transposed(strain_rate)))
    if prestress is not None:
        S = combined((1.0, S), (1.0, prestress))
    P = combined((1.0, wall.material.stress(F)), (1.0, product(F, S)))
    J = added(
        F[0][i] * (F[1][(i + 1) % 3] * F[2][(i + 2) % 3] - F[1][(i + 2) % 3] * F[2][(i + 1) % 3])
        for i in range(3)
    )
    sigma = combined((1.0 / J, product(P, transposed(F))))
    deviator = plus_identity(sigma, -(sigma[0][0] + sigma[1][1] + sigma[2][2]) / 3.0)
    square = 1.5 * added(deviator[i][j] ** 2 for i in range(3) for j in range(3))
    loaded = square > 0.0
    von_mises = jnp.where(loaded, jnp.sqrt(jnp.where(loaded, square, 1.0)), 0.0)
    strain = combined((0.5, plus_identity(product(transposed(F), F), -1.0)))
    return WallStress(_stacked(sigma), von_mises, _stacked(strain))


def _stacked(tensor) -> Float[Array, "3 3 tets"]:
    return jnp.stack([jnp.stack(list(row)) for row in tensor])
