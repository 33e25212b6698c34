"""Solid-shell wedges: six nodes, three displacements each, that bend with one layer.

Nodes 0 to 2 lie on one face (ζ = −1), 3 to 5 above them on the other (ζ = +1). With the covariant
base vectors g_i = ∂x/∂(r, s, ζ), G_i in the reference configuration, Green's strain
E_ij = (g_i·g_j − G_i·G_j)/2 is sampled where it does not lock::

    in plane    E_11, E_22, E_12 at the middle of the triangle, ζ = ±1/√3
    shear       E_13 at A = (1/2, 0), E_23 at B = (0, 1/2), E_23 − E_13 at C = (1/2, 1/2), ζ = 0:
                c = E_23(B) − E_13(A) − (E_23 − E_13)(C),
                E_13 = E_13(A) + c/3,   E_23 = E_23(B) − c/3
    thickness   E_33 at the three columns, ζ = 0; their mean acts in the element

and enhanced by a strain α ζ (j₀/j) G³⊗G³ that is linear through the thickness, with α such that
the stored energy is least. Two points ζ = ±1/√3 with the weights j/2, j = det[G₁ G₂ G₃], integrate
the energy.

One point in the plane leaves out how the thickness strain varies between the columns; on meshes
whose triangles can be coloured with three colours two modes would have no energy. They get that of
a one-dimensional stress::

    W_s = (E/2) V/24 Σ_i (e_i − ē)² |G³|⁴,     e_i = E_33 at column i

Where columns are parallel it vanishes for every uniform strain, and patch tests are passed exactly;
where they spread, uniform strain is met with an error of second order in the angle between them.

Every sampled strain is half a product of two legs, linear in the nodes, less its value in the
reference configuration; no deformation gradient is formed.

Sources: Ko & Lee 2017, A 6-node triangular solid-shell element (MITC-S6), IJNME 111:1203, for the
shear and thickness samples; Sze & Chan 2001 and Vu-Quoc & Tan 2003 for the enhanced strain.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import added, gathered, scatter
from jaxfsi.core.laws.materials import Tensor, determinant_and_cofactor, product, transposed

Vector = tuple[Float[Array, "*points wedges"], ...]
"""The three components of a vector in each wedge, or at its points."""

WedgeCorners = tuple[Vector, ...]
"""A vector at each of the six nodes."""

Samples = tuple[Float[Array, " wedges"], ...]
"""The twelve sampled covariant strains, or what works on them.

In plane at both points (11, 22, 12), shear at A, B and C, thickness at the three columns."""

N_SAMPLES = 12
POINTS = (-(3.0**-0.5), 3.0**-0.5)
"""ζ of the two quadrature points."""

_AXES = range(3)


class WedgeElement(eqx.Module):
    """The wedges of a wall.

    Attributes:
        nodes: of each wedge, those of one face first.
    """

    nodes: Int[Array, "6 wedges"]

    @property
    def n(self) -> int:
        """Number of wedges."""
        return self.nodes.shape[1]


class WedgeGeometry(NamedTuple):
    """Shape of the wedges in the reference configuration.

    Attributes:
        corners: positions of the nodes [cm].
        contravariant: G^i in row i, at the two points [1/cm].
        weight: of the two points [cm³].
        enhanced: ζ j₀/j at the two points.
        normal: |G³|² at the middle [1/cm²].
        volume: sum of the weights [cm³].
    """

    corners: WedgeCorners
    contravariant: Tensor
    weight: Float[Array, "2 wedges"]
    enhanced: Float[Array, "2 wedges"]
    normal: Float[Array, " wedges"]
    volume: Float[Array, " wedges"]


def wedge_corners(field: Float[Array, "3 nodes"], wedges: WedgeElement) -> WedgeCorners:
    """Values of a vector field at the nodes of the wedges."""
    x, y, z = (gathered(component, wedges.nodes) for component in field)
    return tuple(zip(x, y, z, strict=True))


def wedge_geometry(x: Float[Array, "3 nodes"], wedges: WedgeElement) -> WedgeGeometry:
    """Shape of wedges with node positions x [cm]."""
    X = wedge_corners(x, wedges)
    det_0, cofactor_0 = determinant_and_cofactor(_base(X, 0.0))
    zeta = _both_points(x)
    det, cofactor = determinant_and_cofactor(_base(X, zeta))
    weight = det / 2.0
    enhanced = zeta * det_0 / det
    normal = added((cofactor_0[2][i] / det_0) ** 2 for i in _AXES)
    # Rows of the base are G_i; the inverse transposed has G^i as rows.
    inverse = [[c / det for c in row] for row in cofactor]
    return WedgeGeometry(X, inverse, weight, enhanced, normal, weight[0] + weight[1])


def _both_points(like: Array) -> Float[Array, "2 1"]:
    """ζ of the quadrature points in the precision of an array."""
    return jnp.asarray(POINTS, like.dtype)[:, None]


def _base(x: WedgeCorners, zeta: float | Float[Array, "2 1"]) -> list[Vector]:
    """g_1, g_2, g_3 at the middle of the triangle."""
    g_1, g_2 = _in_plane(x, zeta)
    d = [_minus(x[i + 3], x[i]) for i in _AXES]
    g_3 = tuple((d[0][k] + d[1][k] + d[2][k]) / 6.0 for k in _AXES)
    return [g_1, g_2, g_3]


def compatible_gradient(x: WedgeCorners, shape: WedgeGeometry) -> Tensor:
    """F = Σ g_i ⊗ G^i of the nodes' positions at the quadrature points."""
    return product(transposed(_base(x, _both_points(x[0][0]))), shape.contravariant)


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(p - q for p, q in zip(a, b, strict=True))


def _mean(a: Vector, b: Vector) -> Vector:
    return tuple((p + q) / 2.0 for p, q in zip(a, b, strict=True))


def _in_plane(x: WedgeCorners, zeta: float | Float[Array, "2 1"]) -> tuple[Vector, Vector]:
    low, high = (1.0 - zeta) / 2.0, (1.0 + zeta) / 2.0

    def along(k: int) -> Vector:
        return tuple(low * (x[k][i] - x[0][i]) + high * (x[k + 3][i] - x[3][i]) for i in _AXES)

    return along(1), along(2)


def _legs(x: WedgeCorners) -> list[tuple[Vector, Vector]]:
    """Both legs of every sampled strain, linear in the nodes."""
    pairs = []
    for zeta in POINTS:
        g_1, g_2 = _in_plane(x, zeta)
        pairs += [(g_1, g_1), (g_2, g_2), (g_1, g_2)]
    g_1, g_2 = _in_plane(x, 0.0)
    d = [tuple(v / 2.0 for v in _minus(x[i + 3], x[i])) for i in _AXES]
    pairs.append((g_1, _mean(d[0], d[1])))
    pairs.append((g_2, _mean(d[0], d[2])))
    pairs.append((_minus(g_2, g_1), _mean(d[1], d[2])))
    return [*pairs, *((leg, leg) for leg in d)]


def _dot(a: Vector, b: Vector) -> Float[Array, " wedges"]:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def strain_change(v: WedgeCorners, x: WedgeCorners) -> Samples:
    """Change of the sampled strains along v where the nodes are at x, B v."""
    return tuple(
        (_dot(a, q) + _dot(p, b)) / 2.0 for (a, b), (p, q) in zip(_legs(v), _legs(x), strict=True)
    )


def sampled_strains(d: WedgeCorners, shape: WedgeGeometry, *, small: bool = False) -> Samples:
    """Sampled strains of a displacement.

    Args:
        d: displacements of the nodes [cm].
        shape: of the wedges.
        small: leave out what is quadratic in the displacement.
    """
    linear = strain_change(d, shape.corners)
    if small:
        return linear
    return tuple(e + _dot(a, b) / 2.0 for e, (a, b) in zip(linear, _legs(d), strict=True))


def nodal_forces(t: Samples, x: WedgeCorners) -> WedgeCorners:
    """Forces on the nodes at x of stresses that work on the sampled strains, Bᵀ t [dyn]."""
    zero = tuple(tuple(jnp.zeros_like(t[0]) for _ in _AXES) for _ in range(6))
    _, pull = jax.vjp(lambda v: strain_change(v, x), zero)
    return pull(tuple(t))[0]


def green_strain(e: Samples, alpha: Array, shape: WedgeGeometry) -> Tensor:
    """Green's strain at the quadrature points in Cartesian components, enhanced by α."""
    e_11, e_22, e_12 = (jnp.stack([e[k], e[k + 3]]) for k in _AXES)
    c = (e[7] - e[6] - e[8]) / 3.0
    e_13, e_23 = e[6] + c, e[7] - c
    e_33 = (e[9] + e[10] + e[11]) / 3.0 + alpha * shape.enhanced
    covariant = [[e_11, e_12, e_13], [e_12, e_22, e_23], [e_13, e_23, e_33]]
    G = shape.contravariant
    return product(transposed(G), product(covariant, G))


class WedgePrestress(NamedTuple):
    """Stress of undeformed wedges [dyn/cm²].

    Attributes:
        stress: second Piola-Kirchhoff stress at the two points.
        columns: stress along the three columns, less its mean, see `column_stress`.
    """

    stress: Float[Array, "3 3 2 wedges"]
    columns: Float[Array, "3 wedges"]


class Work(NamedTuple):
    """What works on the sampled strains and on α.

    Attributes:
        t: stresses times volume that work on the samples [dyn·cm].
        g: what works on α; zero where it is in equilibrium [dyn·cm].
    """

    t: Samples
    g: Float[Array, " wedges"]


def worked(stress: Tensor, shape: WedgeGeometry) -> Work:
    """Work of second Piola-Kirchhoff stresses at the two points on samples and α."""
    G, w = shape.contravariant, shape.weight
    (s_11, s_12, s_13), (_, s_22, s_23), (_, _, s_33) = product(G, product(stress, transposed(G)))
    in_plane = [w * s_11, w * s_22, 2.0 * w * s_12]
    shear_1, shear_2 = (2.0 * added(w * s) for s in (s_13, s_23))
    normal, g = added(w * s_33), added(w * shape.enhanced * s_33)
    t = [s[point] for point in (0, 1) for s in in_plane]
    t += [
        (2.0 * shear_1 + shear_2) / 3.0,
        (shear_1 + 2.0 * shear_2) / 3.0,
        (shear_2 - shear_1) / 3.0,
    ]
    return Work((*t, *(normal / 3.0,) * 3), g)


def column_stress(e: Samples, young: Array, shape: WedgeGeometry) -> Float[Array, "3 wedges"]:
    """Stress along the columns, E (e_i − ē) |G³|² [dyn/cm²]."""
    mean = (e[9] + e[10] + e[11]) / 3.0
    return jnp.stack([young * shape.normal * (value - mean) for value in e[9:]])


def column_work(stress: Float[Array, "3 wedges"], shape: WedgeGeometry) -> Samples:
    """Work of stresses along the columns on the samples."""
    zero = jnp.zeros_like(shape.volume)
    return (*(zero,) * 9, *(shape.volume * shape.normal / 24.0 * stress))


def stabilised(e: Samples, young: Array, shape: WedgeGeometry) -> Samples:
    """Work of W_s, by how the thickness strain varies between the columns."""
    return column_work(column_stress(e, young, shape), shape)


def inertia(a: WedgeCorners, mass: Float[Array, " wedges"]) -> WedgeCorners:
    """∫ ρ_s N a dV of each node [dyn], m (1 + δ_ij)(1 + δ_kl)/72 between (i, k) and (j, l).

    i and j are columns, k and l faces; the mass of a wedge is taken as spread evenly.
    """
    rows = []
    for node in range(6):
        i, k = node % 3, node // 3
        rows.append(
            tuple(
                mass
                / 72.0
                * added(
                    (1.0 + (i == j)) * (1.0 + (k == face)) * a[j + 3 * face][axis]
                    for j in _AXES
                    for face in (0, 1)
                )
                for axis in _AXES
            )
        )
    return tuple(rows)


def gathered_forces(
    forces: WedgeCorners, wedges: WedgeElement, n_nodes: int
) -> Float[Array, "3 nodes"]:
    """Sum the forces of all wedges on each node."""
    rows = []
    for axis in _AXES:
        rows.append(scatter([force[axis] for force in forces], wedges.nodes, n_nodes))
    return jnp.stack(rows)
