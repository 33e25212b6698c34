"""Balance of momentum of a wall of solid-shell wedges, and its derivative.

The stresses S at the two points of a wedge are second Piola-Kirchhoff stresses of the material at
its assumed strain Ẽ(α), of the prestress S₀ and of Kelvin-Voigt damping 2η dẼ/dt, in which α is
taken as constant. They work on twelve sampled strains e of a wedge (`core.elements.wedge`)::

    force = Bᵀ t(e, α),   g(e, α) = 0,   B = ∂e/∂x
    δ force = Bᵀ (∂t/∂e − ∂t/∂α ∂g/∂e / (∂g/∂α)) B δx + (δB)ᵀ t

α is found by Newton's method. The last step is differentiated, which gives forces and derivatives
of the converged α.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import added, fusion_barrier
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.elements.wedge import (
    N_SAMPLES,
    Samples,
    WedgeCorners,
    WedgeElement,
    WedgeGeometry,
    Work,
    compatible_gradient,
    gathered_forces,
    inertia,
    nodal_forces,
    point_strain,
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
    product,
    right_triangular,
    transposed,
    triangular_solve,
)
from jaxfsi.core.laws.solid import Wall

_STEPS = 3
"""Newton steps for α before the one that is differentiated: 1e-10 at strains of 0.2."""

Prestress = Float[Array, "3 3 2 wedges"] | None


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


def _strains(e: Samples, alpha: Array, shape: WedgeGeometry) -> Tensor:
    """Green's strain at the first points of all wedges, followed by the second ones."""
    points = [point_strain(e, alpha, shape, point) for point in (0, 1)]
    strain = jax.tree.map(lambda low, high: jnp.concatenate([low, high]), *points)
    return fusion_barrier(strain, shape)


def _at_points(tensor: Tensor) -> list[Tensor]:
    """A tensor at the two points of the wedges, of one that has them one after the other."""
    n = tensor[0][0].shape[-1] // 2
    return [[[v[..., part] for v in row] for row in tensor] for part in (slice(n), slice(n, None))]


def _twice(material: AbstractMaterial) -> AbstractMaterial:
    """The material at the first points of all wedges, followed by the second ones."""
    return jax.tree.map(lambda a: jnp.concatenate([a, a], -1) if jnp.ndim(a) else a, material)


def _stresses(
    e: Samples, alpha: Array, material: AbstractMaterial, shape: WedgeGeometry
) -> list[Tensor]:
    stress = _twice(material).second_stress(_strains(e, alpha, shape))
    return _at_points(fusion_barrier(stress, shape))


def _elastic(
    e: Samples,
    alpha: Array,
    material: AbstractMaterial,
    shape: WedgeGeometry,
    prestress: Prestress,
) -> Work:
    """Work of elasticity and prestress."""
    stress = _stresses(e, alpha, material, shape)
    if prestress is not None:
        stress = [combined((1.0, S), (1.0, prestress[:, :, g])) for g, S in enumerate(stress)]
    return worked(stress, shape)


def enhancement(
    e: Samples, material: AbstractMaterial, shape: WedgeGeometry, prestress: Prestress = None
) -> Float[Array, " wedges"]:
    """α at which it is in equilibrium."""

    def step(e, alpha, material, shape, prestress):
        def force(alpha):
            return _elastic(e, alpha, material, shape, prestress).g

        g, slope = jax.jvp(force, (alpha,), (jnp.ones_like(alpha),))
        return alpha - g / jax.lax.stop_gradient(slope)

    known = jax.lax.stop_gradient((e, material, shape, prestress))
    alpha = jnp.zeros_like(shape.volume)
    n_steps = 1 if material.is_small_strain else _STEPS
    alpha = jax.lax.fori_loop(0, n_steps, lambda _, a: step(known[0], a, *known[1:]), alpha)
    return step(e, jax.lax.stop_gradient(alpha), material, shape, prestress)


def _viscous(rate: Samples, wall: Wall, shape: WedgeGeometry) -> Work:
    """Work of Kelvin-Voigt damping at rates of the samples."""
    rates = _at_points(_strains(rate, jnp.zeros_like(shape.volume), shape))
    return worked([combined((2.0 * wall.damping, E)) for E in rates], shape)


def _young(wall: Wall) -> Array:
    lam, G = (jnp.asarray(m) for m in wall.material.moduli)
    return G * (3.0 * lam + 2.0 * G) / (lam + G)


def _all_work(
    e: Samples, rate: Samples, alpha: Array, wall: Wall, shape: WedgeGeometry, prestress: Prestress
) -> Work:
    """Work of all stresses; on α that of elasticity and prestress alone."""
    elastic = _elastic(e, alpha, wall.material, shape, prestress)
    parts = elastic.t, stabilised(e, _young(wall), shape), _viscous(rate, wall, shape).t
    return Work(tuple(added(values) for values in zip(*parts, strict=True)), elastic.g)


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
    alpha = fusion_barrier(enhancement(e, wall.material, shape, prestress), shape)
    elastic = None if small else prestress
    t = fusion_barrier(_all_work(e, rate, alpha, wall, shape, elastic).t, shape)
    forces = nodal_forces(t, at)
    if small and prestress is not None:  # it turns with the wall also where strains are small
        held = worked([prestress[:, :, 0], prestress[:, :, 1]], shape).t
        forces = _sum(forces, nodal_forces(held, x))
    forces = _sum(forces, inertia(wedge_corners(a, wedges), wall.rho_s * shape.volume))
    return gathered_forces(forces, wedges, d.shape[1])


def _moved(d: WedgeCorners, shape: WedgeGeometry) -> WedgeCorners:
    return _sum(shape.corners, d)


def _sum(a: WedgeCorners, b: WedgeCorners) -> WedgeCorners:
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
    alpha = enhancement(e, wall.material, shape, prestress)
    e, rate, alpha = fusion_barrier((e, rate, alpha), shape)
    moduli = _condensed(e, alpha, weights, wall, shape)
    t = _all_work(e, rate, alpha, wall, shape, prestress).t
    if small:
        held = None if prestress is None else worked([prestress[:, :, g] for g in (0, 1)], shape).t
        t = tuple(jnp.zeros_like(value) for value in t) if held is None else held
    turning = tuple(weights.d * value for value in t)
    mass = weights.a * wall.rho_s * shape.volume
    mass = mass * jnp.ones_like(shape.volume)
    return WedgeTangent(at, moduli, fusion_barrier(turning, shape), mass)


def _condensed(
    e: Samples, alpha: Array, weights: Weights, wall: Wall, shape: WedgeGeometry
) -> Float[Array, "12 12 wedges"]:
    """What a change of each sample adds to the work on each, with α in equilibrium."""
    law = _law_moduli(_strains(e, alpha, shape), wall.material, shape)
    young, damping = weights.d * _young(wall), 2.0 * weights.u * wall.damping
    one = jnp.ones_like(shape.volume)

    def change(unit: Float[Array, " samples"], on_alpha: Array) -> Float[Array, "13 wedges"]:
        along = tuple(value * one for value in unit)
        strains = _at_points(_strains(along, on_alpha * one, shape))
        stress = [
            combined((weights.d, _contracted(D, E)), (damping, E))
            for D, E in zip(law, strains, strict=True)
        ]
        found = worked(fusion_barrier(stress, shape), shape)
        fixed = stabilised(along, young, shape)
        return jnp.stack([*map(jnp.add, found.t, fixed), found.g])

    # All thirteen at once: compiled once.
    units = jnp.eye(N_SAMPLES + 1, dtype=one.dtype)
    J = fusion_barrier(jax.vmap(change)(units[:, :-1], units[:, -1]), shape)
    return fusion_barrier(J[:-1, :-1] - J[:-1, -1:] * (J[-1:, :-1] / J[-1, -1]), shape)


_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _law_moduli(
    strain: Tensor, material: AbstractMaterial, shape: WedgeGeometry
) -> list[list[Tensor]]:
    """∂S/∂E along the six components of the strain, at each of the two points."""
    law = _twice(material).second_stress
    one = jnp.ones_like(strain[0][0])

    def along(unit: Float[Array, "3 3"]) -> Tensor:
        direction = [[unit[i, j] * one for j in range(3)] for i in range(3)]
        return jax.jvp(law, (strain,), (direction,))[1]

    units = np.zeros((6, 3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        units[k, i, j] = units[k, j, i] = 1.0
    found = fusion_barrier(jax.vmap(along)(jnp.asarray(units, one.dtype)), shape)
    points = _at_points(found)
    return [[[[v[k] for v in row] for row in D] for k in range(6)] for D in points]


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


def wedge_stress(
    d: Float[Array, "3 nodes"],
    material: AbstractMaterial,
    wedges: WedgeElement,
    shape: WedgeGeometry,
) -> Float[Array, "3 3 2 wedges"]:
    """Second Piola-Kirchhoff stress of elasticity at the two points [dyn/cm²]."""
    e = sampled_strains(wedge_corners(d, wedges), shape, small=material.is_small_strain)
    stress = _stresses(e, enhancement(e, material, shape), material, shape)
    return jnp.stack([_stacked(S) for S in stress], axis=2)


def _stacked(tensor: Tensor) -> Float[Array, "3 3 wedges"]:
    return jnp.stack([jnp.stack(list(row)) for row in tensor])


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
    alpha = enhancement(measured, wall.material, shape, prestress)
    none = jnp.zeros_like(alpha)
    sigma, strain = [], []
    for point, S in enumerate(_stresses(measured, alpha, wall.material, shape)):
        whole = combined((1.0, S), (2.0 * wall.damping, point_strain(rate, none, shape, point)))
        if prestress is not None:
            whole = combined((1.0, whole), (1.0, prestress[:, :, point]))
        assumed = point_strain(e, alpha, shape, point)
        F = _deformation(x, shape, point, assumed)
        cauchy = product(F, product(whole, transposed(F)))
        sigma.append(_stacked(combined((1.0 / determinant(F), cauchy))))
        strain.append(_stacked(assumed))
    return WedgeStress(jnp.stack(sigma, axis=2), jnp.stack(strain, axis=2))


def _deformation(x: WedgeCorners, shape: WedgeGeometry, point: int, assumed: Tensor) -> Tensor:
    """R U: the rotation of the nodes' motion and the stretch of the assumed strain."""
    F = compatible_gradient(x, shape, point)
    C = product(transposed(F), F)
    own = [[(C[i][j] - float(i == j)) / 2.0 for j in range(3)] for i in range(3)]
    stretch = triangular_solve(right_triangular(own), right_triangular(assumed))
    return product(F, stretch)
