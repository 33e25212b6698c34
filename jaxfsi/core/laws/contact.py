"""A least gap between the sides of a lumen: below it they repel each other.

Each vertex i of the interface is paired with the point of the opposite side at which the normal n
into the blood meets it in the reference shape, with weights w_k at the corners of the triangle
there. The gap of a pair is linear in the displacement, and below the least gap g_m a pressure
presses its ends apart::

    g = n·(Σ_k w_k x_k − x_i),   s = max(0, 1 − g/g_m)
    p = κ s²                     (κ at contact, a quarter of it at half the least gap)

It is minus the derivative of the energy A κ g_m s³/3 with A the area of the vertex, of which a pair
has half, since the opposite side has pairs of its own. The forces on the two ends are A p n/2 and
its opposite: they have no resultant, and they do no work round a closed path. There is no friction,
n keeps its direction and a vertex its partner, so that sliding and turning must be small against
the width of the lumen. A pair that is closer than 2 g_m in the reference shape, as at the edge of a
slit, counts half of its own gap as the least one.

The law is our own; of its kind is the penalty of Wriggers 2006, Computational Contact Mechanics,
section 6.3.
"""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from jaxfsi.core.elements.linear import area_vectors
from lumped.parameters import Parameter, Range, check_range, parameter

REACH = 15.0
"""Gaps of the reference shape that are watched, over the least gap: wider lumens do not close."""

_FACING = 0.5
"""Cosine between a ray and the normal of the triangle that it meets at least."""

_CHUNK = 4096


class LeastGap(eqx.Module):
    """Least gap between the sides of a lumen.

    Attributes:
        gap: g_m, at which repulsion begins [cm].
        stiffness: κ, pressure at contact [dyn/cm²]. With 10⁶ a wall that 100 mmHg press on stays
            away by 0.63 of the least gap.
    """

    ranges: ClassVar[Range] = Range(above=("gap", "stiffness"))
    gap: Parameter = parameter()
    stiffness: Parameter = parameter(default=1e6)

    def __check_init__(self):
        """Refuse numbers that are not positive; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)


class Contact(eqx.Module):
    """The least gap and the pairs that it holds for.

    Attributes:
        law: see `LeastGap`.
        node: vertex i of each pair.
        opposite: corners of the triangle opposite to it.
        weight: w_k of these corners.
        normal: n, from the vertex into the blood.
        faces: triangles of the interface, for the areas of their vertices.
    """

    law: LeastGap
    node: Int[Array, " pairs"]
    opposite: Int[Array, "3 pairs"]
    weight: Float[Array, "3 pairs"]
    normal: Float[Array, "3 pairs"]
    faces: Int[Array, "3 faces"]


def contact_pairs(
    law: LeastGap, points: Float[np.ndarray, "nodes 3"], faces: Int[np.ndarray, "faces 3"]
) -> Contact:
    """Find the pairs of an interface.

    Args:
        law: the least gap; its number must be concrete.
        points: reference positions of the nodes [cm].
        faces: triangles of the interface that point out of the blood.
    """
    corner = points[faces]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = np.zeros_like(points)
    for k in range(3):
        np.add.at(inward, faces[:, k], -area)
    nodes = np.unique(faces)
    normal = inward[nodes] / np.linalg.norm(inward[nodes], axis=1, keepdims=True)
    reach = REACH * float(law.gap)
    found = list(_hits(points[nodes], normal, corner, area, reach))
    i, face, weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return Contact(
        law,
        jnp.asarray(nodes[i], jnp.int32),
        jnp.asarray(faces[face].T, jnp.int32),
        jnp.asarray(weight.T),
        jnp.asarray(normal[i].T),
        jnp.asarray(faces.T, jnp.int32),
    )


_Hits = tuple[Int[np.ndarray, " hits"], Int[np.ndarray, " hits"], Float[np.ndarray, "hits 3"]]


def _hits(x, normal, corner, area, reach: float) -> Iterator[_Hits]:
    """First triangle that each ray from a vertex meets within reach, and the weights there."""
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    centre = corner.mean(axis=1)
    size = np.max(np.linalg.norm(corner - centre[:, None], axis=2))
    tree = KDTree(centre)
    for start in range(0, len(x), _CHUNK):
        near = tree.query_ball_point(x[start : start + _CHUNK], reach + size)
        i = start + np.repeat(np.arange(len(near)), [len(n) for n in near])
        face = np.concatenate([np.asarray(n, int) for n in near])
        facing = np.sum(normal[i] * unit[face], axis=1) > _FACING
        i, face = i[facing], face[facing]
        # Solve a + u e₁ + v e₂ = x + t n for u, v, t (Möller & Trumbore 1997).
        a, b, c = np.moveaxis(corner[face], 1, 0)
        solved = np.linalg.solve(
            np.stack([b - a, c - a, -normal[i]], axis=2), (x[i] - a)[:, :, None]
        )[:, :, 0]
        u, v, t = solved.T
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t > 0.0) & (t <= reach)
        order = np.flatnonzero(hit)[np.lexsort((t[hit], i[hit]))]
        first = order[np.unique(i[order], return_index=True)[1]]
        yield i[first], face[first], np.stack([1.0 - u - v, u, v], axis=1)[first]


def gaps(x: Float[Array, "3 nodes"], contact: Contact) -> Float[Array, " pairs"]:
    """Gap of each pair with node positions x [cm]."""
    away = -x[:, contact.node]
    for k in range(3):
        away = away + contact.weight[k] * x[:, contact.opposite[k]]
    return jnp.sum(contact.normal * away, axis=0)


def contact_force(
    d: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], contact: Contact
) -> Float[Array, "3 nodes"]:
    """Derivative of the energy of contact by the displacement [dyn].

    Args:
        d: displacement [cm].
        x: reference positions of the nodes [cm].
        contact: see `Contact`.
    """
    _, s = _closeness(d, x, contact)
    p = contact.law.stiffness * s**2
    return _spread(-_pair_area(x, contact) * p, d, contact)


def contact_slope(
    d: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], contact: Contact
) -> Float[Array, " pairs"]:
    """Stiffness of each pair at a displacement, change of its force over that of its gap."""
    least, s = _closeness(d, x, contact)
    return 2.0 * _pair_area(x, contact) * contact.law.stiffness * s / least


def contact_product(
    slope: Float[Array, " pairs"], v: Float[Array, "3 nodes"], contact: Contact
) -> Float[Array, "3 nodes"]:
    """Change of `contact_force` along a change v, with the stiffness of `contact_slope`."""
    return _spread(slope * gaps(v, contact), v, contact)


def _closeness(d, x, contact: Contact) -> tuple[Float[Array, " pairs"], Float[Array, " pairs"]]:
    """Least gap [cm] and s of each pair."""
    least = jnp.minimum(contact.law.gap, gaps(x, contact) / 2.0)
    return least, jnp.maximum(1.0 - gaps(x + d, contact) / least, 0.0)


def _pair_area(x: Float[Array, "3 nodes"], contact: Contact) -> Float[Array, " pairs"]:
    """Half the area of the vertex of each pair [cm²]."""
    sixth = jnp.linalg.norm(area_vectors(x, contact.faces), axis=0) / 6.0
    at = jnp.zeros(x.shape[1], x.dtype)
    for k in range(3):
        at = at.at[contact.faces[k]].add(sixth)
    return at[contact.node]


def _spread(
    force: Float[Array, " pairs"], like: Float[Array, "3 nodes"], contact: Contact
) -> Float[Array, "3 nodes"]:
    """Nodal forces of a force along the gap of each pair: the transpose of `gaps`."""
    along = contact.normal * force
    total = jnp.zeros_like(like).at[:, contact.node].add(-along)
    for k in range(3):
        total = total.at[:, contact.opposite[k]].add(contact.weight[k] * along)
    return total
