"""Elastic materials of the wall: stress from the deformation gradient.

With C = FᵀF, E = (C − I)/2, J = det F, shear modulus G, Lamé's λ and bulk modulus κ = λ + 2G/3:

| material | first Piola-Kirchhoff stress | source |
|---|---|---|
| `LinearElastic` | λ tr(ε) I + 2 G ε, ε = sym(F − I) | Hooke |
| `SaintVenantKirchhoff` | F (λ tr(E) I + 2 G E + κ_p (J² − 1)/2 C⁻¹) | Bonet & Wood 2008, 6.28 |
| `NeoHookean` | F (G J^(−2/3) (I − tr(C)/3 C⁻¹) + κ (J² − 1)/2 C⁻¹) | Simo & Taylor 1991 |

svMultiPhysics (2026) adds a volumetric penalty κ_p (J² − 1)/2 C⁻¹ to the stress of every material
of its displacement-based wall, also to the whole St. Venant-Kirchhoff stress; unless the case says
otherwise κ_p is the bulk modulus E/(3 (1 − 2ν)). Its predecessor svFSI leaves the penalty out of
this material. The wall becomes stiffer than E and ν say: at ν = 0.3 it acts like one with E 7 %
higher and ν = 0.39. With the penalty the fields of an elastic tube agree with those of that
program to 0.7 %, without it they are 4 to 23 % apart. `volumetric_penalty` is there to compare.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.parameters import Parameter, parameter

Tensor = Float[Array, "3 3 tets"]


def product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of the tensors of each element."""
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def transposed(a: Tensor) -> Tensor:
    """Transpose of the tensor of each element."""
    return jnp.swapaxes(a, 0, 1)


def _trace(a: Tensor) -> Float[Array, " tets"]:
    return a[0, 0] + a[1, 1] + a[2, 2]


def _isotropic(values: Float[Array, " tets"]) -> Tensor:
    return jnp.eye(3)[:, :, None] * values


def _determinant_and_inverse(a: Tensor) -> tuple[Float[Array, " tets"], Tensor]:
    rows = [jnp.cross(a[:, (i + 1) % 3], a[:, (i + 2) % 3], axis=0) for i in range(3)]
    det = jnp.sum(a[:, 0] * rows[0], axis=0)
    return det, jnp.stack(rows) / det


class AbstractMaterial(eqx.Module):
    """An elastic material; its numbers may be scalars or one value an element."""

    @abc.abstractmethod
    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""

    @property
    @abc.abstractmethod
    def moduli(self) -> tuple[Parameter, Parameter]:
        """Lamé's λ and the shear modulus G about the undeformed state [dyn/cm²]."""


def _lame(E: Parameter, nu: Parameter) -> tuple[Parameter, Parameter]:
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


class LinearElastic(AbstractMaterial):
    """Hooke's law for small displacements.

    Attributes:
        E: Young's modulus [dyn/cm²].
        nu: Poisson's ratio.
    """

    E: Parameter = parameter()
    nu: Parameter = parameter()

    @property
    def moduli(self) -> tuple[Parameter, Parameter]:
        """λ and G [dyn/cm²]."""
        return _lame(self.E, self.nu)

    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""
        lam, G = self.moduli
        displacement_gradient = F - jnp.eye(3)[:, :, None]
        twice_strain = displacement_gradient + transposed(displacement_gradient)
        return G * twice_strain + _isotropic(lam * _trace(displacement_gradient))


class SaintVenantKirchhoff(AbstractMaterial):
    """Hooke's law between the second Piola-Kirchhoff stress and Green's strain.

    Attributes:
        E: Young's modulus [dyn/cm²].
        nu: Poisson's ratio.
        volumetric_penalty: modulus of an added penalty on changes of volume [dyn/cm²].
    """

    E: Parameter = parameter()
    nu: Parameter = parameter()
    volumetric_penalty: Parameter = parameter(default=0.0)

    @property
    def moduli(self) -> tuple[Parameter, Parameter]:
        """λ, with the penalty, and G [dyn/cm²]."""
        lam, G = _lame(self.E, self.nu)
        return lam + self.volumetric_penalty, G

    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""
        lam, G = _lame(self.E, self.nu)
        twice_green = product(transposed(F), F) - jnp.eye(3)[:, :, None]
        S = G * twice_green + _isotropic(lam * _trace(twice_green) / 2.0)
        J, inverse = _determinant_and_inverse(F)
        penalty = self.volumetric_penalty * (J**2 - 1.0) / 2.0
        return product(F, S) + penalty * transposed(inverse)


class NeoHookean(AbstractMaterial):
    """Neo-Hookean material with separate response to changes of shape and volume.

    Attributes:
        E: Young's modulus of small strains [dyn/cm²].
        nu: Poisson's ratio of small strains.
    """

    E: Parameter = parameter()
    nu: Parameter = parameter()

    @property
    def moduli(self) -> tuple[Parameter, Parameter]:
        """λ and G [dyn/cm²]."""
        return _lame(self.E, self.nu)

    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""
        lam, G = self.moduli
        J, inverse = _determinant_and_inverse(F)
        cofactor = transposed(inverse)
        mean_square = jnp.sum(F * F, axis=(0, 1)) / 3.0
        shape = G * J ** (-2.0 / 3.0) * (F - mean_square * cofactor)
        return shape + (lam + 2.0 * G / 3.0) * (J**2 - 1.0) / 2.0 * cofactor
