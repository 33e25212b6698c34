"""Balance of momentum of the wall on linear tetrahedra in its reference configuration.

::

    ∫ ρ_s N_a a dV + ∫ (P(F) + F S₀ + P_v) ∇N_a dV = loads

with the first Piola-Kirchhoff stress P of the material, a prestress S₀ (second Piola-Kirchhoff,
Hsu & Bazilevs 2011, eq. 8) and Kelvin-Voigt damping P_v = F 2η Ė.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements import Geometry, added, gradient, scatter, total, vector_corners
from jaxfsi.core.materials import (
    AbstractMaterial,
    Tensor,
    combined,
    plus_identity,
    product,
    transposed,
)
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


def deformation_gradient(
    d: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"], shape: Geometry
) -> Tensor:
    """F = I + ∂d/∂X on each element."""
    return plus_identity(_slopes(d, tets, shape), 1.0)


def _slopes(d: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"], shape: Geometry) -> Tensor:
    return [gradient(component, shape) for component in vector_corners(d, tets)]


def solid_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    tets: Int[Array, "4 tets"],
    shape: Geometry,
    prestress: Float[Array, "3 3 tets"] | None = None,
) -> Float[Array, "3 nodes"]:
    """Internal and inertial forces of the wall on each node [dyn].

    Args:
        u: velocity [cm/s].
        a: acceleration [cm/s²].
        d: displacement from the reference configuration [cm].
        wall: what the wall is made of.
        tets: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: second Piola-Kirchhoff stress that is there without deformation [dyn/cm²].
    """
    n_nodes = u.shape[1]
    F = deformation_gradient(d, tets, shape)
    strain_rate = product(transposed(F), _slopes(u, tets, shape))
    S = combined((wall.damping, strain_rate), (wall.damping, transposed(strain_rate)))
    if prestress is not None:
        S = combined((1.0, S), (1.0, prestress))
    V = shape.volume
    stress = combined((V, wall.material.stress(F)), (V, product(F, S)))
    mass = wall.rho_s * shape.volume / 20.0
    rows = []
    for i, corner in enumerate(vector_corners(a, tets)):
        whole = total(corner)
        force = tuple(
            mass * (corner[b] + whole) + added(shape.grad[j, b] * stress[i][j] for j in range(3))
            for b in range(4)
        )
        rows.append(scatter(force, tets, n_nodes))
    return jnp.stack(rows)
