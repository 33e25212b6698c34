"""An artery's wall with two families of collagen fibres.

::

    W = W_matrix(C) + Σ_{i=1,2} k₁/(2k₂) (exp(k₂ ⟨E_i⟩²) − 1)
    E_i = κ (tr C − 3) + (1 − 3κ) (a_i·C a_i − 1),      ⟨E⟩ = max(E, 0)
    S = S_matrix + Σ_i 2 k₁ ⟨E_i⟩ exp(k₂ ⟨E_i⟩²) (κ I + (1 − 3κ) a_i⊗a_i)

with the neo-Hookean matrix of `NeoHookean` and unit vectors a_i = cos θ c ± sin θ z in the plane of
the wall: c along its circumference, z along its axis. Dispersion κ goes from 0, fibres aligned, to
1/3, fibres in all directions. Fibres bear no compression.

Departure from the sources: invariants of C act in the fibres, not those of C with its volume taken
out. In a wall that can change its volume the latter make fibres shrink when the wall swells, and
pull a sphere of it out of shape under uniform tension (Nolan, Gower, Destrade, Ogden & McGarry
2014, A robust anisotropic hyperelastic formulation for the modelling of soft tissue, J Mech Behav
Biomed Mater 39:48).

Source: Gasser, Ogden & Holzapfel 2006, Hyperelastic modelling of arterial layers with distributed
collagen fibre orientations, J R Soc Interface 3:15, eqs 4.1-4.4; κ = 0 is Holzapfel, Gasser &
Ogden 2000, J Elasticity 61:1.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import added
from jaxfsi.core.laws.materials import (
    AbstractMaterial,
    NeoHookean,
    Response,
    Tensor,
    Volume,
    combined,
    plus_identity,
    product,
    transposed,
)
from lumped.parameters import Parameter, Range, is_traced, parameter

_AXES = range(3)


class HolzapfelGasserOgden(AbstractMaterial):
    """A neo-Hookean matrix with two families of fibres that stiffen exponentially.

    The media of a rabbit's carotid has G = 3.0 kPa, k₁ = 2.3632 kPa, k₂ = 0.8393, θ = 29° without
    dispersion; its adventitia 0.3 kPa, 0.562 kPa, 0.7112, 62° (Holzapfel et al. 2000). The
    numbers hold from the unloaded artery: where the reference shape of a wall carries a prestress,
    its fibres are as slack as without.

    Attributes:
        E: Young's modulus of the matrix [dyn/cm²].
        nu: Poisson's ratio of the matrix.
        k1: stiffness of the fibres [dyn/cm²].
        k2: how fast they stiffen.
        angle: θ of the fibres to the circumference [rad].
        circumference: direction c in each tetrahedron of the wall; of any length.
        axis: direction z, across c.
        dispersion: κ.
    """

    ranges: ClassVar[Range] = Range(above=("E",), least=("k1", "k2", "dispersion"))
    E: Parameter = parameter()
    nu: Parameter = parameter()
    k1: Parameter = parameter()
    k2: Parameter = parameter()
    angle: Parameter = parameter()
    circumference: Float[Array, "3 tets"] = parameter()
    axis: Float[Array, "3 tets"] = parameter()
    dispersion: Parameter = parameter(default=0.0)

    def __check_init__(self):
        """Refuse a dispersion beyond that of fibres in all directions, and frames of other shapes.

        Raises:
            ValueError: κ is above 1/3, or there is not one direction an element of the wall.
        """
        if not is_traced(self.dispersion) and np.any(np.asarray(self.dispersion) > 1.0 / 3.0):
            raise ValueError(
                f"HolzapfelGasserOgden.dispersion = {self.dispersion} must lie between 0, aligned,"
                " and 1/3, fibres in all directions."
            )
        shapes = np.shape(self.circumference), np.shape(self.axis)
        if shapes[0] != shapes[1] or len(shapes[0]) != 2 or shapes[0][0] != 3:
            raise ValueError(
                f"HolzapfelGasserOgden.circumference and axis have the shapes {shapes[0]} and"
                f" {shapes[1]}; give both (3, tets), one direction for each tetrahedron of the"
                " wall, as jaxfsi.fields.wall_frame does."
            )

    @property
    def matrix(self) -> NeoHookean:
        """What lies between the fibres."""
        return NeoHookean(self.E, self.nu)

    @property
    def fibres(self) -> tuple[Float[Array, "3 tets"], Float[Array, "3 tets"]]:
        """Unit vectors along the two families."""
        frame = jnp.asarray(self.circumference), jnp.asarray(self.axis)
        c, z = (v / jnp.sqrt(added(v[i] ** 2 for i in _AXES)) for v in frame)
        along, across = jnp.cos(self.angle) * c, jnp.sin(self.angle) * z
        return along + across, along - across

    @property
    def moduli(self) -> tuple[Parameter, Parameter]:
        """Lamé's λ and the shear modulus G of the matrix; fibres are slack at rest [dyn/cm²]."""
        return self.matrix.moduli

    def fibre_stress(self, E: Tensor) -> Tensor:
        """Second Piola-Kirchhoff stress of the fibres [dyn/cm²] at Green's strain."""
        trace = 2.0 * (E[0][0] + E[1][1] + E[2][2])
        aligned = 1.0 - 3.0 * self.dispersion
        terms = []
        for a in self.fibres:
            stretch = 2.0 * added(a[i] * E[i][j] * a[j] for i in _AXES for j in _AXES)
            e = self.dispersion * trace + aligned * stretch
            e = jnp.where(e > 0.0, e, 0.0)
            tension = 2.0 * self.k1 * e * jnp.exp(self.k2 * e**2)
            structure = plus_identity(
                [[aligned * a[i] * a[j] for j in _AXES] for i in _AXES], self.dispersion
            )
            terms.append((tension, structure))
        return combined(*terms)

    def second_stress(self, E: Tensor) -> Tensor:
        """Second Piola-Kirchhoff stress [dyn/cm²] at Green's strain."""
        return combined((1.0, self.matrix.second_stress(E)), (1.0, self.fibre_stress(E)))

    def stress(self, F: Tensor) -> Tensor:
        """First Piola-Kirchhoff stress [dyn/cm²] at a deformation gradient."""
        twice = plus_identity(product(transposed(F), F), -1.0)
        fibres = product(F, self.fibre_stress(combined((0.5, twice))))
        return combined((1.0, self.matrix.stress(F)), (1.0, fibres))

    def split(self) -> tuple["HolzapfelGasserOgden", tuple[Parameter, ...]]:
        """The same law with λ ≤ 2G, and the modulus k [dyn/cm²] left over for each measure."""
        matrix, left = self.matrix.split()
        rest = (self.k1, self.k2, self.angle, self.circumference, self.axis, self.dispersion)
        return HolzapfelGasserOgden(matrix.E, matrix.nu, *rest), left

    def volumes(self, F: Tensor) -> tuple[Volume, ...]:
        """Measures of the volume on which what `split` takes out acts."""
        return self.matrix.volumes(F)

    @property
    def responses(self) -> tuple[Response, ...]:
        """U′ of each measure of the volume."""
        return self.matrix.responses
