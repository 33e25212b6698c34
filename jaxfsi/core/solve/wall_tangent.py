"""Derivative of the wall's forces: a tensor of moduli in each element.

::

    δ force = ∫ (A : ∇δv + Σ_m δp_m ∂q_m/∂F) ∇N dV + w_a ∫ ρ_s N δv dV

with A_ijkl = ∂P_ij/∂H_kl about the mean deformation of an element and the pressures δp_m of the
volumes that its kind averages. For linear elements, and where the strain is uniform, that is the
exact derivative; of an element that bends it lacks the part of the strain that varies in it, half a
percent on the elastic tube, and the product takes half the time. The material's law is not
evaluated in a product.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.bending import BendingElement
from jaxfsi.core.elements.linear import Geometry, added, fusion_barrier
from jaxfsi.core.elements.wall import AbstractWallElement, Weights
from jaxfsi.core.laws.materials import Tensor, combined, plus_identity
from jaxfsi.core.laws.solid import Wall, inelastic_stress, local_stress, wall_motion
from jaxfsi.core.laws.wall_balance import WallElements, WallPrestress, WallShape, by_part
from jaxfsi.core.laws.wedge_solid import WedgeTangent, apply_wedges, wedge_tangent

_AXES = range(3)

Moduli = Sequence[Sequence[Float[Array, "9 tets"]]]


class WallTangent(NamedTuple):
    """Derivative of the wall's forces about a motion.

    Attributes:
        moduli: change of each component of the stress by the nine of ∂v_i/∂X_j, row by row
            [dyn·s/cm³].
        gradients: ∂q_m/∂F of each averaged measure of the volume.
        stiffness: change of its pressure round each vertex [dyn·s/cm²].
        mass: of the elements, times the weight of the acceleration [g/s].
    """

    moduli: Moduli
    gradients: tuple[Tensor, ...]
    stiffness: tuple[Float[Array, " nodes"], ...]
    mass: Float[Array, " tets"]


class BendingTangent(NamedTuple):
    """Derivative of the forces of a wall that bends.

    Attributes:
        wedges: of its wedges.
        rest: of its other tetrahedra.
    """

    wedges: WedgeTangent
    rest: "WallTangent | RestTangent"


def wall_tangent(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    weights: Weights,
    wall: Wall,
    element: WallElements,
    shape: WallShape,
    prestress: WallPrestress = None,
) -> WallTangent | BendingTangent:
    """Derivative of `wall_residual` by the unknown.

    Args:
        u: velocity about which it is taken [cm/s].
        d: displacement [cm].
        weights: what a change of the unknown does to acceleration, velocity and displacement.
        wall: what the wall is made of.
        element: elements of the wall.
        shape: their geometry in the reference configuration.
        prestress: see `wall_residual`.
    """
    if isinstance(element, BendingElement):
        return BendingTangent(
            *by_part(
                element,
                wall,
                shape,
                prestress,
                lambda *part: wedge_tangent(u, d, weights, *part),
                lambda *part: _tet_tangent(u, d, weights, *part),
            )
        )
    return _tet_tangent(u, d, weights, wall, element, shape, prestress)


def _tet_tangent(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    weights: Weights,
    wall: Wall,
    element: AbstractWallElement,
    shape: Geometry,
    prestress: Float[Array, "3 3 points tets"] | None,
) -> WallTangent:
    motion = wall_motion(u, d, element, shape)
    pressures = element.pressures(motion.F, wall.material, shape, u.shape[1])
    F, rate = fusion_barrier((_mean(motion.F), _mean(motion.rate)), shape)
    p = [jnp.mean(pressure.value, axis=0) for pressure in pressures]
    S = None if prestress is None else jnp.mean(prestress, axis=2)

    def stress(F: Tensor, rate: Tensor) -> Tensor:
        elastic = local_stress(F, p, wall.material, element)
        return combined((1.0, elastic), (1.0, inelastic_stress(F, rate, wall, S)))

    one = jnp.ones_like(F[0][0])

    def change(unit: Float[Array, "3 3"]) -> Sequence[Sequence[Array]]:
        along = [[unit[i, j] * one for j in _AXES] for i in _AXES]
        weighted = combined((weights.d, along)), combined((weights.u, along))
        _, (x, y, z) = jax.jvp(stress, (F, rate), weighted)
        return [list(x), list(y), list(z)]

    # All nine at once: the law is compiled once.
    moduli = jax.vmap(change)(jnp.eye(9, dtype=one.dtype).reshape(9, 3, 3))
    gradients = tuple(v.slope for v in wall.material.volumes(F)) if pressures else ()
    return WallTangent(
        fusion_barrier(moduli, shape),
        fusion_barrier(gradients, shape),
        tuple(weights.d * pressure.stiffness for pressure in pressures),
        weights.a * wall.rho_s * shape.volume,
    )


class RestTangent(NamedTuple):
    """The derivative about a wall at rest in its reference shape: it is isotropic.

    Attributes:
        lam: Lamé's first parameter of what acts point by point [dyn·s/cm³].
        G: shear modulus, damping included [dyn·s/cm³].
        slopes: ∂q_m/∂(tr H) of each averaged measure of the volume.
        stiffness: see `WallTangent`.
        mass: see `WallTangent`.
    """

    lam: Float[Array, " tets"]
    G: Float[Array, " tets"]
    slopes: tuple[Float[Array, " tets"], ...]
    stiffness: tuple[Float[Array, " nodes"], ...]
    mass: Float[Array, " tets"]


def rest_tangent(tangent: WallTangent | BendingTangent) -> RestTangent | BendingTangent:
    """The derivative about a motion without displacement, velocity and prestress."""
    if isinstance(tangent, BendingTangent):
        assert isinstance(tangent.rest, WallTangent)
        rest = rest_tangent(tangent.rest)
        assert isinstance(rest, RestTangent)
        return BendingTangent(tangent.wedges, rest)
    A = tangent.moduli
    slopes = tuple(slope[0][0] for slope in tangent.gradients)
    return RestTangent(A[0][0][4], A[0][1][1], slopes, tangent.stiffness, tangent.mass)


def apply_rest(
    tangent: RestTangent | BendingTangent,
    v: Float[Array, "3 nodes"],
    element: WallElements,
    shape: WallShape,
) -> Float[Array, "3 nodes"]:
    """Change of the forces of a wall at rest along v."""
    if isinstance(tangent, BendingTangent) and isinstance(element, BendingElement):
        assert isinstance(tangent.rest, RestTangent)
        forces = apply_wedges(tangent.wedges, v, element.wedges, shape.wedges)
        return forces + apply_rest(tangent.rest, v, element.rest, shape.rest)
    assert isinstance(tangent, RestTangent)
    assert isinstance(element, AbstractWallElement)
    H = element.gradients(v, shape)
    trace = added(H[i][i] for i in _AXES)
    mean = tangent.lam * trace
    for slope, stiffness in zip(tangent.slopes, tangent.stiffness, strict=True):
        mean = mean + slope * element.spread(slope * trace, stiffness, shape)
    P = [[tangent.G * (H[i][j] + H[j][i]) for j in _AXES] for i in _AXES]
    return element.forces(plus_identity(P, mean), v, tangent.mass, shape)


def _mean(tensor: Tensor) -> Tensor:
    """Mean of the quadrature points."""
    return [[jnp.mean(value, axis=0) for value in row] for row in tensor]


def apply_wall(
    tangent: WallTangent | BendingTangent,
    v: Float[Array, "3 nodes"],
    element: WallElements,
    shape: WallShape,
) -> Float[Array, "3 nodes"]:
    """Change of the wall's forces along v."""
    if isinstance(tangent, BendingTangent) and isinstance(element, BendingElement):
        forces = apply_wedges(tangent.wedges, v, element.wedges, shape.wedges)
        assert isinstance(tangent.rest, WallTangent)
        return forces + _apply_tets(tangent.rest, v, element.rest, shape.rest, _contracted)
    assert isinstance(tangent, WallTangent)
    assert isinstance(element, AbstractWallElement)
    return _apply_tets(tangent, v, element, shape, _contracted)


def apply_wall_transposed(
    tangent: WallTangent | BendingTangent,
    v: Float[Array, "3 nodes"],
    element: WallElements,
    shape: WallShape,
) -> Float[Array, "3 nodes"]:
    """Product of the transpose of `apply_wall` and v."""
    if isinstance(tangent, WallTangent) and isinstance(element, AbstractWallElement):
        return _apply_tets(tangent, v, element, shape, _contracted_transposed)
    (product,) = jax.linear_transpose(lambda v: apply_wall(tangent, v, element, shape), v)(v)
    return product


def _apply_tets(
    tangent: WallTangent,
    v: Float[Array, "3 nodes"],
    element: AbstractWallElement,
    shape: Geometry,
    contracted: Callable[[Moduli, Tensor], Tensor],
) -> Float[Array, "3 nodes"]:
    H = element.gradients(v, shape)
    stress = contracted(tangent.moduli, H)
    for slope, stiffness in zip(tangent.gradients, tangent.stiffness, strict=True):
        q = added(slope[i][j] * H[i][j] for i in _AXES for j in _AXES)
        stress = combined((1.0, stress), (element.spread(q, stiffness, shape), slope))
    return element.forces(fusion_barrier(stress, shape), v, tangent.mass, shape)


def _contracted(moduli: Moduli, H: Tensor) -> Tensor:
    """A : H."""
    along = [H[i][j] for i in _AXES for j in _AXES]
    return [[added(A[k] * h for k, h in enumerate(along)) for A in row] for row in moduli]


def _contracted_transposed(moduli: Moduli, H: Tensor) -> Tensor:
    """H : A."""
    return [
        [added(moduli[k][m][3 * i + j] * H[k][m] for k in _AXES for m in _AXES) for j in _AXES]
        for i in _AXES
    ]
