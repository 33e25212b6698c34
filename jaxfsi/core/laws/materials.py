"""Elastic materials of the wall: stress from the deformation gradient.

With C = FᵀF, E = (C − I)/2, J = det F, shear modulus G, Lamé's λ and bulk modulus κ = λ + 2G/3:

| material | first Piola-Kirchhoff stress | source |
|---|---|---|
| `LinearElastic` | λ tr(ε) I + 2 G ε, ε = sym(F − I) | Hooke |
| `SaintVenantKirchhoff` | F (λ tr(E) I + 2 G E + κ_p (J² − 1)/2 C⁻¹) | Bonet & Wood 2008, 6.28 |
| `NeoHookean` | F (G J^(−2/3) (I − tr(C)/3 C⁻¹) + κ (J² − 1)/2 C⁻¹) | Simo & Taylor 1991 |

`laws.fibres` has the neo-Hookean material with collagen fibres.

svMultiPhysics (2026) adds a volumetric penalty κ_p (J² − 1)/2 C⁻¹ to the stress of every material
of its displacement-based wall, also to the whole St. Venant-Kirchhoff stress; unless the case says
otherwise κ_p is the bulk modulus E/(3 (1 − 2ν)). Its predecessor svFSI leaves the penalty out of
this material. The wall becomes stiffer than E and ν say: at ν = 0.3 it acts like one with E 7 %
higher and ν = 0.39. With the penalty the fields of an elastic tube agree with those of that
program to 0.7 %, without it they are 4 to 23 % apart. `volumetric_penalty` is there to compare.

An element that does not lock takes the resistance to changes of volume beyond λ = 2G (ν = 1/3) out
of the law and lets it act on averaged volumes instead. For that each law can be split into one with
less λ and the rest, a sum of energies k U(q) of measures q of the volume::

    Hooke: q = tr(ε), U = q²/2    St. Venant-Kirchhoff: q = tr(E), U = q²/2, and, like
    neo-Hookean: q = J, U = (q² − 1)/4 − ln(q)/2
"""

import abc
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import added
from lumped.parameters import Parameter, Range, check_range, is_traced, parameter

Tensor = Sequence[Sequence[Float[Array, "*points tets"]]] | Float[Array, "3 3 *points tets"]
"""Components of a tensor at each point of the elements: rows of arrays, or one array."""

_AXES = range(3)


def product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of the tensors of each element."""
    return [
        [a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] for j in _AXES] for i in _AXES
    ]


def transposed(a: Tensor) -> Tensor:
    """Transpose of the tensor of each element."""
    return [[a[j][i] for j in _AXES] for i in _AXES]


def combined(*terms: tuple[Parameter, Tensor]) -> Tensor:
    """Sum of tensors, each times a number or one value an element."""
    return [[added(c * a[i][j] for c, a in terms) for j in _AXES] for i in _AXES]


def plus_identity(a: Tensor, c: Parameter) -> Tensor:
    """Add c times the identity."""
    return [[a[i][j] + c if i == j else a[i][j] for j in _AXES] for i in _AXES]


def stacked(a: Tensor) -> Float[Array, "3 3 *points tets"]:
    """A tensor as one array."""
    return jnp.stack([jnp.stack(list(row)) for row in a])


def _trace(a: Tensor) -> Float[Array, " tets"]:
    return a[0][0] + a[1][1] + a[2][2]


def determinant_and_cofactor(a: Tensor) -> tuple[Float[Array, " tets"], Tensor]:
    """Determinant, and the transposed inverse times it."""
    cofactor = [
        [
            a[(i + 1) % 3][(j + 1) % 3] * a[(i + 2) % 3][(j + 2) % 3]
            - a[(i + 1) % 3][(j + 2) % 3] * a[(i + 2) % 3][(j + 1) % 3]
            for j in _AXES
        ]
        for i in _AXES
    ]
    return added(a[0][j] * cofactor[0][j] for j in _AXES), cofactor


class Volume(NamedTuple):
    """A measure of the volume at a deformation gradient.

    Attributes:
        value: q.
        slope: ∂q/∂F.
    """

    value: Float[Array, " tets"]
    slope: Tensor


Response = Callable[[Float[Array, " n"]], Float[Array, " n"]]
"""Derivative U′ of the energy of a measure of the volume, at unit modulus."""

LOCAL_LAME_RATIO = 2.0
"""λ/G up to which the resistance to changes of volume stays with the law when it is split."""


def determinant(a: Tensor) -> Float[Array, " tets"]:
    """Determinant of the tensor of each element."""
    return determinant_and_cofactor(a)[0]


def right_triangular(E: Tensor) -> Tensor:
    """Upper triangular U with UᵀU = I + 2E."""
    zero = jnp.zeros_like(E[0][0])
    a = jnp.sqrt(1.0 + 2.0 * E[0][0])
    b, c = 2.0 * E[0][1] / a, 2.0 * E[0][2] / a
    d = jnp.sqrt(1.0 + 2.0 * E[1][1] - b * b)
    e = (2.0 * E[1][2] - b * c) / d
    f = jnp.sqrt(1.0 + 2.0 * E[2][2] - c * c - e * e)
    return [[a, b, c], [zero, d, e], [zero, zero, f]]


def triangular_solve(U: Tensor, a: Tensor) -> Tensor:
    """U⁻¹ a of an upper triangular U."""
    last = [value / U[2][2] for value in a[2]]
    middle = [(a[1][j] - U[1][2] * last[j]) / U[1][1] for j in _AXES]
    first = [(a[0][j] - U[0][1] * middle[j] - U[0][2] * last[j]) / U[0][0] for j in _AXES]
    return [first, middle, last]


class AbstractMaterial(eqx.Module):
    """An elastic material; its numbers may be scalars or one value an element."""

    ranges: ClassVar[Range] = Range(above=("E",))
    E: eqx.AbstractVar[Parameter]
    nu: eqx.AbstractVar[Parameter]

    def __check_init__(self):
        """Refuse constants without a finite, positive stiffness; traced ones pass.

        Raises:
            ValueError: E is not above zero, or ν does not lie between −1 and 0.5.
        """
        check_range(self)
        if is_traced(self.nu):
            return
        nu = np.asarray(self.nu)
        if not np.all((nu > -1.0) & (nu < 0.5)):
            raise ValueError(
                f"{type(self).__name__}.nu = {self.nu} must lie between -1 and 0.5, both excluded."
                " A wall that cannot change its volume has no finite stiffness; take 0.49."
            )

    @abc.abstractmethod
    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""

    @property
    def is_small_strain(self) -> bool:
        """Whether strain is linear in the displacement."""
        return False

    def second_stress(self, E: Tensor) -> Tensor:
        """Second Piola-Kirchhoff stress [dyn/cm²] at Green's strain, S = U⁻¹ P(U).

        U is the triangular factor of C = I + 2E = UᵀU: the stress of an objective law does not
        depend on the rotation that is left out. Not a number where C is not positive definite. A
        law written in E takes fewer operations and compiles faster.
        """
        U = right_triangular(E)
        return triangular_solve(U, self.stress(U))

    @property
    @abc.abstractmethod
    def moduli(self) -> tuple[Parameter, Parameter]:
        """Lamé's λ and the shear modulus G about the undeformed state [dyn/cm²]."""

    @abc.abstractmethod
    def split(self) -> tuple["AbstractMaterial", tuple[Parameter, ...]]:
        """The same law with λ ≤ 2G, and the modulus k [dyn/cm²] left over for each measure."""

    @abc.abstractmethod
    def volumes(self, F: Tensor) -> tuple[Volume, ...]:
        """Measures of the volume on which what `split` takes out acts."""

    @property
    @abc.abstractmethod
    def responses(self) -> tuple[Response, ...]:
        """U′ of each measure of the volume."""


def _lame(E: Parameter, nu: Parameter) -> tuple[Parameter, Parameter]:
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def _young_and_poisson(lam: Parameter, G: Parameter) -> tuple[Parameter, Parameter]:
    return G * (3.0 * lam + 2.0 * G) / (lam + G), lam / (2.0 * (lam + G))


def _proportional(q: Float[Array, " n"]) -> Float[Array, " n"]:
    return q


def _dilatation(J: Float[Array, " n"]) -> Float[Array, " n"]:
    return (J - 1.0 / J) / 2.0


def _green_trace(F: Tensor) -> Volume:
    return Volume((added(F[i][j] ** 2 for i in _AXES for j in _AXES) - 3.0) / 2.0, F)


def _jacobian(F: Tensor) -> Volume:
    return Volume(*determinant_and_cofactor(F))


class LinearElastic(AbstractMaterial):
    """Hooke's law for small displacements.

    Attributes:
        E: Young's modulus [dyn/cm²].
        nu: Poisson's ratio.
    """

    E: Parameter = parameter()
    nu: Parameter = parameter()

    @classmethod
    def of_moduli(cls, lam: Parameter, G: Parameter) -> "LinearElastic":
        """The law with given λ and shear modulus [dyn/cm²]."""
        return cls(*_young_and_poisson(lam, G))

    @property
    def moduli(self) -> tuple[Parameter, Parameter]:
        """λ and G [dyn/cm²]."""
        return _lame(self.E, self.nu)

    @property
    def is_small_strain(self) -> bool:
        """Yes."""
        return True

    def second_stress(self, E: Tensor) -> Tensor:
        """λ tr(ε) I + 2 G ε [dyn/cm²] of the small strain ε in place of E."""
        lam, G = self.moduli
        return plus_identity(combined((2.0 * G, E)), lam * _trace(E))

    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""
        lam, G = self.moduli
        H = plus_identity(F, -1.0)
        return plus_identity(combined((G, H), (G, transposed(H))), lam * _trace(H))

    def split(self) -> tuple["LinearElastic", tuple[Parameter, ...]]:
        """The same law with λ ≤ 2G, and the modulus k [dyn/cm²] left over for each measure."""
        lam, G = self.moduli
        kept = jnp.minimum(lam, LOCAL_LAME_RATIO * G)
        return LinearElastic(*_young_and_poisson(kept, G)), (lam - kept,)

    def volumes(self, F: Tensor) -> tuple[Volume, ...]:
        """Measures of the volume on which what `split` takes out acts."""
        zero = jnp.zeros_like(F[0][0])
        return (Volume(_trace(F) - 3.0, plus_identity([[zero] * 3] * 3, 1.0)),)

    @property
    def responses(self) -> tuple[Response, ...]:
        """U′ of each measure of the volume."""
        return (_proportional,)


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
        twice_green = plus_identity(product(transposed(F), F), -1.0)
        S = plus_identity(combined((G, twice_green)), lam * _trace(twice_green) / 2.0)
        J, cofactor = determinant_and_cofactor(F)
        penalty = self.volumetric_penalty * _dilatation(J)
        return combined((1.0, product(F, S)), (penalty, cofactor))

    def second_stress(self, E: Tensor) -> Tensor:
        """λ tr(E) I + 2 G E + κ_p (J² − 1)/2 C⁻¹ [dyn/cm²] at Green's strain."""
        lam, G = _lame(self.E, self.nu)
        square, cofactor = determinant_and_cofactor(plus_identity(combined((2.0, E)), 1.0))
        penalty = self.volumetric_penalty * (1.0 - 1.0 / square) / 2.0
        return plus_identity(combined((2.0 * G, E), (penalty, cofactor)), lam * _trace(E))

    def split(self) -> tuple["SaintVenantKirchhoff", tuple[Parameter, ...]]:
        """The same law with λ ≤ 2G, and the modulus k [dyn/cm²] left over for each measure."""
        lam, G = _lame(self.E, self.nu)
        share = jnp.minimum(1.0, LOCAL_LAME_RATIO * G / (lam + self.volumetric_penalty))
        kept, penalty = share * lam, share * self.volumetric_penalty
        law = SaintVenantKirchhoff(*_young_and_poisson(kept, G), penalty)
        return law, (lam - kept, self.volumetric_penalty - penalty)

    def volumes(self, F: Tensor) -> tuple[Volume, ...]:
        """Measures of the volume on which what `split` takes out acts."""
        return _green_trace(F), _jacobian(F)

    @property
    def responses(self) -> tuple[Response, ...]:
        """U′ of each measure of the volume."""
        return _proportional, _dilatation


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
        J, cofactor = determinant_and_cofactor(F)
        mean_square = added(F[i][j] ** 2 for i in _AXES for j in _AXES) / 3.0
        shape = G * J ** (-2.0 / 3.0)
        pressure = (lam + 2.0 * G / 3.0) * _dilatation(J)
        return combined((shape, F), (pressure - shape * mean_square / J, cofactor))

    def second_stress(self, E: Tensor) -> Tensor:
        """G J^(−2/3) (I − tr(C)/3 C⁻¹) + κ (J² − 1)/2 C⁻¹ [dyn/cm²] at Green's strain."""
        lam, G = self.moduli
        C = plus_identity(combined((2.0, E)), 1.0)
        square, cofactor = determinant_and_cofactor(C)
        shape = G * square ** (-1.0 / 3.0)
        bulk = (lam + 2.0 * G / 3.0) * (square - 1.0) / 2.0
        along = (bulk - shape * _trace(C) / 3.0) / square
        return plus_identity(combined((along, cofactor)), shape)

    def split(self) -> tuple["NeoHookean", tuple[Parameter, ...]]:
        """The same law with λ ≤ 2G, and the modulus k [dyn/cm²] left over for each measure."""
        lam, G = self.moduli
        kept = jnp.minimum(lam, LOCAL_LAME_RATIO * G)
        return NeoHookean(*_young_and_poisson(kept, G)), (lam - kept,)

    def volumes(self, F: Tensor) -> tuple[Volume, ...]:
        """Measures of the volume on which what `split` takes out acts."""
        return (_jacobian(F),)

    @property
    def responses(self) -> tuple[Response, ...]:
        """U′ of each measure of the volume."""
        return (_dilatation,)
