"""Elements of the wall: how displacements become strains, and stresses forces.

Two choices behind one interface:

- `LinearElement`: linear tetrahedra, as in most codes; strain is uniform in an element. They
  neither bend nor, near ν = 1/2, stretch freely: a strip of length 1 and thickness 0.1 with one to
  three layers has 0.2 to 0.3 of its deflection.
- `QuadraticElement` (`jaxfsi.core.elements.quadratic`): the same vertices and a
  hierarchical mid-edge mode on each edge; strain is linear in an element.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import (
    Geometry,
    added,
    fusion_barrier,
    gradient,
    scatter,
    total,
    vector_corners,
)
from jaxfsi.core.laws.materials import AbstractMaterial, Tensor
from lumped.parameters import Parameter


class Weights(NamedTuple):
    """What a change of the unknown does to acceleration, velocity and displacement.

    Attributes:
        a: derivative of the acceleration.
        u: derivative of the velocity.
        d: derivative of the displacement.
    """

    a: Parameter
    u: Parameter
    d: Parameter


class Pressure(NamedTuple):
    """Pressure with which the wall resists a change of averaged volumes.

    Attributes:
        value: at the quadrature points [dyn/cm²].
        stiffness: its change with the averaged measure of the volume round each vertex [dyn/cm²].
    """

    value: Float[Array, "points tets"]
    stiffness: Float[Array, " nodes"]


class AbstractWallElement(eqx.Module):
    """Kinematics of the wall.

    Quadrature points have equal weights. The components of a tensor have them as their first axis.
    """

    tets: eqx.AbstractVar[Int[Array, "4 tets"]]

    @abc.abstractmethod
    def gradients(self, field: Float[Array, "3 nodes"], shape: Geometry) -> Tensor:
        """Gradient ∂f_i/∂X_j of a field at the quadrature points."""

    @abc.abstractmethod
    def law(self, material: AbstractMaterial) -> AbstractMaterial:
        """The part of the material that acts point by point."""

    @abc.abstractmethod
    def pressures(
        self, F: Tensor, material: AbstractMaterial, shape: Geometry, n: int
    ) -> tuple[Pressure, ...]:
        """Nodally averaged volumetric pressures of the material, one for each volume measure.

        Args:
            F: deformation gradients.
            material: elastic law.
            shape: of the elements in the reference configuration.
            n: number of nodes.
        """

    @abc.abstractmethod
    def spread(
        self,
        q: Float[Array, "points tets"],
        stiffness: Float[Array, " nodes"],
        shape: Geometry,
    ) -> Float[Array, "points tets"]:
        """Change of a pressure at the quadrature points.

        Args:
            q: change of its measure of the volume there.
            stiffness: see `Pressure`.
            shape: of the elements in the reference configuration.
        """

    @abc.abstractmethod
    def forces(
        self,
        stress: Tensor,
        a: Float[Array, "3 nodes"],
        mass: Float[Array, " tets"],
        shape: Geometry,
    ) -> Float[Array, "3 nodes"]:
        """∫ P ∇N dV + ∫ ρ_s N a dV [dyn].

        Args:
            stress: first Piola-Kirchhoff stress at the quadrature points [dyn/cm²].
            a: acceleration [cm/s²].
            mass: of the elements [g].
            shape: of the elements in the reference configuration.
        """


class LinearElement(AbstractWallElement):
    """Linear tetrahedra.

    Attributes:
        tets: corners of the elements.
    """

    tets: Int[Array, "4 tets"]

    def gradients(self, field: Float[Array, "3 nodes"], shape: Geometry) -> Tensor:
        """Gradient ∂f_i/∂X_j of a field at the quadrature points."""
        along = [gradient(component, shape) for component in vector_corners(field, self.tets)]
        return [[value[None] for value in row] for row in along]

    def law(self, material: AbstractMaterial) -> AbstractMaterial:
        """All of the material."""
        return material

    def pressures(
        self, F: Tensor, material: AbstractMaterial, shape: Geometry, n: int
    ) -> tuple[Pressure, ...]:
        """None: no volumes are averaged."""
        return ()

    def spread(
        self,
        q: Float[Array, "points tets"],
        stiffness: Float[Array, " nodes"],
        shape: Geometry,
    ) -> Float[Array, "points tets"]:
        """The change itself: no volumes are averaged."""
        return q

    def forces(
        self,
        stress: Tensor,
        a: Float[Array, "3 nodes"],
        mass: Float[Array, " tets"],
        shape: Geometry,
    ) -> Float[Array, "3 nodes"]:
        """∫ P ∇N dV + ∫ ρ_s N a dV [dyn]."""
        grad, V = shape
        # m/20 (a_b + Σ a): the first part needs no element, the second is the same at all corners
        share = mass / 20.0
        own = scatter((share,) * 4, self.tets, a.shape[1])
        inertia = [share * total(corner) for corner in vector_corners(a, self.tets)]
        rows = []
        for i, (row, whole) in enumerate(zip(stress, fusion_barrier(inertia, shape), strict=True)):
            force = tuple(
                whole + V * added(grad[j][b] * row[j][0] for j in range(3)) for b in range(4)
            )
            rows.append(own * a[i] + scatter(force, self.tets, a.shape[1]))
        return jnp.stack(rows)
