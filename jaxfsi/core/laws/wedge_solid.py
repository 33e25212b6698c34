"""Balance of momentum of a wall of solid-shell wedges, and its derivative.

The stresses S at the two points of a wedge are second Piola-Kirchhoff stresses of the material at
its assumed strain Ẽ(α), of the prestress S₀ and of Kelvin-Voigt damping 2η dẼ/dt, in which α is
taken as constant. They work on twelve sampled strains e of a wedge (`core.elements.wedge`)::

    force = Bᵀ t(e, α),   g(e, α) = 0,   B = ∂e/∂x
    δ force = Bᵀ (∂t/∂e − ∂t/∂α ∂g/∂e / (∂g/∂α)) B δx + (δB)ᵀ t

A prestress works with what keeps the thickness of the wedges even, in the same way along their
columns. α is found by Newton's method. The last step is differentiated, which gives forces and
derivatives of the converged α.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import Tree, added, fusion_barrier
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.elements.wedge import (
    N_SAMPLES,
    Samples,
    WedgeCorners,
    WedgeElement,
    WedgeGeometry,
    WedgePrestress,
    Work,
    column_stress,
    column_work,
    compatible_gradient,
    gathered_forces,
    green_strain,
    inertia,
    nodal_forces,
    sampled_strains,
    stabilised,
    strain_change,
    wedge_corners,
    worked,
)
from jaxfsi.core.laws.materials import (
    AbstractMaterial,
    Tensor,
    combined,
    determinant,
    plus_identity,
    product,
    right_triangular,
    stacked,
    transposed,
    triangular_solve,
)
from jaxfsi.core.laws.solid import Wall

_STEPS = 4
"""Newton steps for α before the one that is differentiated: 1e-12 at strains of 0.2."""

Prestress = WedgePrestress | None


class WedgeTangent(NamedTuple):
    """Derivative of the forces of the wedges about a motion.

    Attributes:
        x: positions of the nodes [cm].
        moduli: change of what works on the second sample along the first.
        work: what works on the samples, times the weight of the displacement.
        mass: of the wedges, times the weight of the acceleration [g/s].
    """

    x: WedgeCorners
    moduli: Float[Array, "12 12 wedges"]
    work: Samples
    mass: Float[Array, " wedges"]


def _stress(e: Samples, alpha: Array, material: AbstractMaterial, shape: WedgeGeometry) -> Tensor:
    """Second Piola-Kirchhoff stress of elasticity."""
    strain = fusion_barrier(green_strain(e, alpha, shape), shape)
    return fusion_barrier(material.second_stress(strain), shape)


def _elastic(
    e: Samples,
    alpha: Array,
    material: AbstractMaterial,
    shape: WedgeGeometry,
    prestress: Prestress,
) -> Work:
    """Work of elasticity and prestress."""
    stress = _stress(e, alpha, material, shape)
    if prestress is None:
        return worked(stress, shape)
    t, g = worked(combined((1.0, stress), (1.0, prestress.stress)), shape)
    return Work(_sum(t, column_work(prestress.columns, shape)), g)


class Enhanced(NamedTuple):
    """A strain α through the thickness and what works there.

    Attributes:
        alpha: α.
        work: of elasticity and prestress on the samples, with α in equilibrium [dyn·cm].
    """

    alpha: Float[Array, " wedges"]
    work: Samples


def enhanced(
    e: Samples, material: AbstractMaterial, shape: WedgeGeometry, prestress: Prestress = None
) -> Enhanced:
    """α at which it is in equilibrium, by Newton's method.

    The last step is differentiated; work is taken along it, t − (∂t/∂α) g/(∂g/∂α).
    """
    known = jax.lax.stop_gradient((e, material, shape, prestress))

    def work(alpha: Array) -> Work:
        return _elastic(known[0], alpha, *known[1:])

    def correct(_, found):
        alpha = found[0]
        (_, g), (t_slope, slope) = jax.jvp(work, (alpha,), (jnp.ones_like(alpha),))
        return alpha - g / slope, t_slope, slope

    alpha = jnp.zeros_like(shape.volume)
    start = alpha, tuple(jnp.zeros_like(value) for value in e), jnp.ones_like(alpha)
    n_steps = 1 if material.is_small_strain else _STEPS
    found = jax.lax.fori_loop(0, n_steps, correct, start)
    alpha, t_slope, slope = jax.lax.stop_gradient(found)
    t, g = _elastic(e, alpha, material, shape, prestress)
    change = -g / slope
    return Enhanced(alpha + change, tuple(a + change * b for a, b in zip(t, t_slope, strict=True)))


def _viscous(rate: Samples, wall: Wall, shape: WedgeGeometry) -> Work:
    """Work of Kelvin-Voigt damping at rates of the samples."""
    E = fusion_barrier(green_strain(rate, jnp.zeros_like(shape.volume), shape), shape)
    return worked(combined((2.0 * wall.damping, E)), shape)


def _young(material: AbstractMaterial) -> Array:
    lam, G = (jnp.asarray(m) for m in material.moduli)
    return G * (3.0 * lam + 2.0 * G) / (lam + G)


def _all_work(
    e: Samples, rate: Samples, elastic: Samples, wall: Wall, shape: WedgeGeometry
) -> Samples:
    """Work of all stresses, that of elasticity and prestress given."""
    parts = elastic, stabilised(e, _young(wall.material), shape), _viscous(rate, wall, shape).t
    return tuple(added(values) for values in zip(*parts, strict=True))


def wedge_residual(
    u: Float[Array, "3 nodes"],
    a: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    wedges: WedgeElement,
    shape: WedgeGeometry,
    prestress: Prestress = None,
) -> Float[Array, "3 nodes"]:
    """Internal and inertial forces of the wedges on each node [dyn]; see `solid_residual`."""
    moved = wedge_corners(d, wedges)
    small = wall.material.is_small_strain
    e = sampled_strains(moved, shape, small=small)
    x = _moved(moved, shape)
    at = shape.corners if small else x
    rate = strain_change(wedge_corners(u, wedges), at)
    e, rate = fusion_barrier((e, rate), shape)
    elastic = fusion_barrier(enhanced(e, wall.material, shape, prestress).work, shape)
    held = _held(prestress, shape) if small else None
    if held is not None:  # it turns with the wall also where strains are small
        elastic = _less(elastic, held)
    t = fusion_barrier(_all_work(e, rate, elastic, wall, shape), shape)
    forces = nodal_forces(t, at)
    if held is not None:
        forces = _sum(forces, nodal_forces(held, x))
    forces = _sum(forces, inertia(wedge_corners(a, wedges), wall.rho_s * shape.volume))
    return gathered_forces(forces, wedges, d.shape[1])


def _held(prestress: Prestress, shape: WedgeGeometry) -> Samples | None:
    """Work of a prestress alone."""
    if prestress is None:
        return None
    return _sum(worked(prestress.stress, shape).t, column_work(prestress.columns, shape))


def _less(a: Samples, b: Samples) -> Samples:
    return tuple(p - q for p, q in zip(a, b, strict=True))


def _moved(d: WedgeCorners, shape: WedgeGeometry) -> WedgeCorners:
    return _sum(shape.corners, d)


def _sum(a: Tree, b: Tree) -> Tree:
    return jax.tree.map(jnp.add, a, b)


def wedge_tangent(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    weights: Weights,
    wall: Wall,
    wedges: WedgeElement,
    shape: WedgeGeometry,
    prestress: Prestress = None,
) -> WedgeTangent:
    """Derivative of `wedge_residual` by the unknown; see `wall_tangent`.

    How the rates of the samples change with the positions of the nodes is left out.
    """
    moved = wedge_corners(d, wedges)
    small = wall.material.is_small_strain
    e = sampled_strains(moved, shape, small=small)
    at = shape.corners if small else _moved(moved, shape)
    rate = strain_change(wedge_corners(u, wedges), at)
    alpha, elastic = enhanced(e, wall.material, shape, prestress)
    e, rate, alpha = fusion_barrier((e, rate, alpha), shape)
    moduli = _condensed(e, alpha, weights, wall, shape)
    if small:
        t = _held(prestress, shape) or tuple(jnp.zeros_like(value) for value in e)
    else:
        t = _all_work(e, rate, elastic, wall, shape)
    turning = tuple(weights.d * value for value in t)
    mass = weights.a * wall.rho_s * shape.volume
    mass = mass * jnp.ones_like(shape.volume)
    return WedgeTangent(at, moduli, fusion_barrier(turning, shape), mass)


def _condensed(
    e: Samples, alpha: Array, weights: Weights, wall: Wall, shape: WedgeGeometry
) -> Float[Array, "12 12 wedges"]:
    """What a change of each sample adds to the work on each, with α in equilibrium."""
    strain = fusion_barrier(green_strain(e, alpha, shape), shape)
    law = _law_moduli(strain, wall.material, shape)
    young, damping = weights.d * _young(wall.material), 2.0 * weights.u * wall.damping
    one = jnp.ones_like(shape.volume)

    def change(unit: Float[Array, " samples"], on_alpha: Array) -> Float[Array, "13 wedges"]:
        along = tuple(value * one for value in unit)
        E = fusion_barrier(green_strain(along, on_alpha * one, shape), shape)
        stress = combined((weights.d, _contracted(law, E)), (damping, E))
        found = worked(fusion_barrier(stress, shape), shape)
        fixed = stabilised(along, young, shape)
        return jnp.stack([*map(jnp.add, found.t, fixed), found.g])

    # All thirteen at once: compiled once.
    units = jnp.eye(N_SAMPLES + 1, dtype=one.dtype)
    J = fusion_barrier(jax.vmap(change)(units[:, :-1], units[:, -1]), shape)
    return fusion_barrier(J[:-1, :-1] - J[:-1, -1:] * (J[-1:, :-1] / J[-1, -1]), shape)


_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _law_moduli(strain: Tensor, material: AbstractMaterial, shape: WedgeGeometry) -> list[Tensor]:
    """∂S/∂E along the six components of the strain."""
    one = jnp.ones_like(strain[0][0])

    def along(unit: Float[Array, "3 3"]) -> Tensor:
        direction = [[unit[i, j] * one for j in range(3)] for i in range(3)]
        return jax.jvp(material.second_stress, (strain,), (direction,))[1]

    units = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        units[k, i, j] = units[k, j, i] = 1.0
    found = fusion_barrier(jax.vmap(along)(jnp.asarray(units, one.dtype)), shape)
    return [[[v[k] for v in row] for row in found] for k in range(6)]


def _contracted(D: Sequence[Tensor], E: Tensor) -> Tensor:
    """Change of the stress along a change E of the strain."""
    return combined(*((E[i][j], part) for (i, j), part in zip(_PAIRS, D, strict=True)))


def apply_wedges(
    tangent: WedgeTangent, v: Float[Array, "3 nodes"], wedges: WedgeElement, shape: WedgeGeometry
) -> Float[Array, "3 nodes"]:
    """Change of the forces of the wedges along v."""
    moved = wedge_corners(v, wedges)
    e = fusion_barrier(strain_change(moved, tangent.x), shape)
    t = fusion_barrier(_changed(tangent, e), shape)
    return gathered_forces(_wedge_forces(tangent, moved, t), wedges, v.shape[1])


def _changed(tangent: WedgeTangent, e: Samples) -> Samples:
    """Change of what works on the samples."""
    D = tangent.moduli
    return tuple(added(D[k, i] * e[k] for k in range(N_SAMPLES)) for i in range(N_SAMPLES))


def _wedge_forces(tangent: WedgeTangent, moved: WedgeCorners, t: Samples) -> WedgeCorners:
    forces = _sum(nodal_forces(t, tangent.x), nodal_forces(tangent.work, moved))
    return _sum(forces, inertia(moved, tangent.mass))


def element_matrices(tangent: WedgeTangent) -> Float[Array, "wedges 18 18"]:
    """Matrix of each wedge, unknowns node by node."""

    def column(unit: Float[Array, "6 3"]) -> Float[Array, "wedges 18"]:
        one = jnp.ones_like(tangent.mass)
        moved = tuple(tuple(unit[a, i] * one for i in range(3)) for a in range(6))
        e = strain_change(moved, tangent.x)
        forces = _wedge_forces(tangent, moved, _changed(tangent, e))
        return jnp.stack([f for node in forces for f in node], axis=1)

    units = jnp.eye(18, dtype=tangent.mass.dtype).reshape(18, 6, 3)
    return jnp.moveaxis(jax.vmap(column)(units), 0, 2)


def wedge_prestress(
    d: Float[Array, "3 nodes"],
    material: AbstractMaterial,
    wedges: WedgeElement,
    shape: WedgeGeometry,
) -> WedgePrestress:
    """Stress of a displacement as a prestress has it [dyn/cm²]."""
    e = sampled_strains(wedge_corners(d, wedges), shape, small=material.is_small_strain)
    columns = column_stress(e, _young(material), shape)
    return WedgePrestress(wedge_stress(d, material, wedges, shape), columns)


def wedge_stress(
    d: Float[Array, "3 nodes"],
    material: AbstractMaterial,
    wedges: WedgeElement,
    shape: WedgeGeometry,
) -> Float[Array, "3 3 2 wedges"]:
    """Second Piola-Kirchhoff stress of elasticity at the two points [dyn/cm²]."""
    e = sampled_strains(wedge_corners(d, wedges), shape, small=material.is_small_strain)
    return stacked(_stress(e, enhanced(e, material, shape).alpha, material, shape))


class WedgeStress(NamedTuple):
    """Stress and strain at the two points of the wedges.

    Attributes:
        sigma: Cauchy stress of elasticity, prestress and damping [dyn/cm²].
        strain: Green's strain, as assumed and enhanced.
    """

    sigma: Float[Array, "3 3 2 wedges"]
    strain: Float[Array, "3 3 2 wedges"]


def wedge_stress_and_strain(
    u: Float[Array, "3 nodes"],
    d: Float[Array, "3 nodes"],
    wall: Wall,
    wedges: WedgeElement,
    shape: WedgeGeometry,
    prestress: Prestress = None,
) -> WedgeStress:
    """Stress in the deformed wall, σ = F S Fᵀ/det F with F = R U.

    U is the factor of the assumed strain, R the rotation of the compatible gradient left of its own
    triangular factor.
    """
    moved = wedge_corners(d, wedges)
    x = _moved(moved, shape)
    e = sampled_strains(moved, shape)
    small = wall.material.is_small_strain
    measured = sampled_strains(moved, shape, small=True) if small else e
    rate = strain_change(wedge_corners(u, wedges), x)
    alpha = enhanced(measured, wall.material, shape, prestress).alpha
    viscous = green_strain(rate, jnp.zeros_like(alpha), shape)
    S = combined(
        (1.0, _stress(measured, alpha, wall.material, shape)), (2.0 * wall.damping, viscous)
    )
    if prestress is not None:
        S = combined((1.0, S), (1.0, prestress.stress))
    assumed = green_strain(e, alpha, shape)
    F = _deformation(x, shape, assumed)
    sigma = combined((1.0 / determinant(F), product(F, product(S, transposed(F)))))
    return WedgeStress(stacked(sigma), stacked(assumed))


def _deformation(x: WedgeCorners, shape: WedgeGeometry, assumed: Tensor) -> Tensor:
    """R U: the rotation of the nodes' motion and the stretch of the assumed strain."""
    F = compatible_gradient(x, shape)
    C = product(transposed(F), F)
    own = combined((0.5, plus_identity(C, -1.0)))
    stretch = triangular_solve(right_triangular(own), right_triangular(assumed))
    return product(F, stretch)
