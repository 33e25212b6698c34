"""Quadratic tetrahedra of the wall whose edge unknowns are hierarchical, and do not lock.

The displacement is that of the linear element plus one vector w on each edge (a, b), which bows
it; the blood sees the vertices alone::

    d = Σ_a N_a d_a + Σ_(a,b) 4 N_a N_b w_ab

Strain is linear in an element, so that one layer bends. Four quadrature points, point g nearest to
corner g, integrate exactly what is quadratic (Hammer, Marlowe & Stroud 1956): with N_b = n there
and far-off weight f = (5 − √5)/20, near weight n = (5 + 3√5)/20 the gradient is::

    ∇d(g) = Σ_a ∇N_a (d_a + 4 f Σ_b w_ab) + 4 (n − f) Σ_{a≠g} ∇N_a w_ag

Near ν = 1/2 the resistance to changes of volume beyond λ = 2G acts on the volume averaged round
each vertex v, q_v = ∫ N_v q dV / ∫ N_v dV, with energy Σ_v k U(q_v) ∫ N_v dV: one pressure a
vertex, as in the element of Taylor & Hood 1973 with a lumped mass of the pressure, which has enough
displacements for each pressure. λ up to 2G stays in the elements: averaging alone would leave out
the part of the volume's change that varies across one layer, and be 28 % too soft at ν = 0.3.

Measured against converged solutions (benchmarks/wall.py): a strip, a squeezed ring and a tube,
one to three layers, ν = 0.3 to 0.4999, are right to 5 % where the linear element reaches 2 to 32 %
of the deflection.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import (
    Corners,
    Geometry,
    added,
    corners,
    fusion_barrier,
    gathered,
    gradient,
    scatter,
    total,
)
from jaxfsi.core.elements.wall import AbstractWallElement, Pressure
from jaxfsi.core.laws.materials import AbstractMaterial, Tensor

EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
"""Corners of the six edges of a tetrahedron."""

FAR = (5.0 - 5.0**0.5) / 20.0
"""N_a at the quadrature point of another corner."""

NEAR = (5.0 + 3.0 * 5.0**0.5) / 20.0
"""N_a at the quadrature point of corner a."""

_SPREAD = 4.0 * (NEAR - FAR)
_EDGE = {pair: k for k, (a, b) in enumerate(EDGES) for pair in ((a, b), (b, a))}


class QuadraticElement(AbstractWallElement):
    """Quadratic tetrahedra with hierarchical edges.

    Attributes:
        tets: corners of the elements.
        edges: place of the unknown of each edge among the nodes.
    """

    tets: Int[Array, "4 tets"]
    edges: Int[Array, "6 tets"]

    def gradients(self, field: Float[Array, "3 nodes"], shape: Geometry) -> Tensor:
        """Gradient ∂f_i/∂X_j of a field at the quadrature points."""
        values = [
            (corners(component, self.tets), self._edge_values(component)) for component in field
        ]
        rows = []
        for d, w in fusion_barrier(values, shape):
            common = gradient(
                tuple(d[a] + 4.0 * FAR * self._at_corner(w, a) for a in range(4)), shape
            )
            bow = [jnp.stack([self._bow(w, g, shape.grad[j]) for g in range(4)]) for j in range(3)]
            rows.append([common[j] + _SPREAD * bow[j] for j in range(3)])
        return fusion_barrier(rows, shape)

    def _bow(self, w: list[Float[Array, " tets"]], g: int, grad: Corners) -> Float[Array, " tets"]:
        """Σ_{a≠g} ∂N_a/∂X_j w_ag."""
        return added(w[_EDGE[a, g]] * grad[a] for a in range(4) if a != g)

    def law(self, material: AbstractMaterial) -> AbstractMaterial:
        """The material with λ ≤ 2G."""
        return material.split()[0]

    def pressures(
        self, F: Tensor, material: AbstractMaterial, shape: Geometry, n: int
    ) -> tuple[Pressure, ...]:
        """Pressures k U′(q_v) of what λ has beyond 2G."""
        moduli = material.split()[1]
        result = []
        for volume, k, response in zip(
            material.volumes(F), moduli, material.responses, strict=True
        ):
            inside = self._averaged(volume.value, shape, n)
            quarter = shape.volume / 4.0
            modulus = scatter((k * quarter,) * 4, self.tets, n) / self._share(shape, n)
            # Where no element is, any measure that is not singular will do.
            used = modulus > 0.0
            inside = jnp.where(used, inside, 1.0)
            p, slope = jax.jvp(response, (inside,), (jnp.ones_like(inside),))
            p, slope = (jnp.where(used, modulus * value, 0.0) for value in (p, slope))
            result.append(Pressure(self._at_points(p), slope))
        return tuple(result)

    def spread(
        self,
        q: Float[Array, "points tets"],
        stiffness: Float[Array, " nodes"],
        shape: Geometry,
    ) -> Float[Array, "points tets"]:
        """Change of a pressure at the quadrature points, of its measure's change q there."""
        return self._at_points(stiffness * self._averaged(q, shape, stiffness.shape[0]))

    def _share(self, shape: Geometry, n: int) -> Float[Array, " nodes"]:
        """∫ N_v dV of each vertex, 1 elsewhere."""
        share = scatter((shape.volume / 4.0,) * 4, self.tets, n)
        return jnp.where(share > 0.0, share, 1.0)

    def _averaged(
        self, q: Float[Array, "points tets"], shape: Geometry, n: int
    ) -> Float[Array, " nodes"]:
        """q_v of each vertex."""
        part = shape.volume / 4.0 * (FAR * jnp.sum(q, axis=0) + (NEAR - FAR) * q)
        return scatter(tuple(part), self.tets, n) / self._share(shape, n)

    def _at_points(self, p: Float[Array, " nodes"]) -> Float[Array, "points tets"]:
        """A linear field of the vertices at the quadrature points."""
        at_corner = corners(p, self.tets)
        return FAR * total(at_corner) + (NEAR - FAR) * jnp.stack(at_corner)

    def forces(
        self,
        stress: Tensor,
        a: Float[Array, "3 nodes"],
        mass: Float[Array, " tets"],
        shape: Geometry,
    ) -> Float[Array, "3 nodes"]:
        """∫ P ∇N dV + ∫ ρ_s N a dV [dyn]."""
        grad = shape.grad
        rows = []
        for i, row in enumerate(fusion_barrier(stress, shape)):
            P = [shape.volume / 4.0 * value for value in row]
            whole = [added(value) for value in P]
            pull = [added(whole[j] * grad[j][c] for j in range(3)) for c in range(4)]
            vertex, edge = self._inertia(a[i], mass)
            vertex = tuple(m + p for m, p in zip(vertex, pull, strict=True))
            for k, (b, c) in enumerate(EDGES):
                own = added(P[j][c] * grad[j][b] + P[j][b] * grad[j][c] for j in range(3))
                edge[k] = edge[k] + 4.0 * FAR * (pull[b] + pull[c]) + _SPREAD * own
            values = scatter(vertex, self.tets, a.shape[1])
            rows.append(values + scatter(edge, self.edges, a.shape[1]))
        return jnp.stack(rows)

    def _inertia(
        self, a: Float[Array, " nodes"], mass: Float[Array, " tets"]
    ) -> tuple[Corners, list[Float[Array, " tets"]]]:
        """∫ ρ_s N a dV for vertices and edges of each element, the consistent mass.

        Of ∫ N_aⁱ N_bʲ … dV = 6V i! j! …/(i + j + … + 3)!: an edge's function has the integral V/15
        with that of its ends and V/30 with the others, 8V/105 with itself, 4V/105 with that of an
        edge that shares a corner and 2V/105 with the opposite one.
        """
        v, w = corners(a, self.tets), self._edge_values(a)
        whole, bowed = total(v), added(w)
        at = [self._at_corner(w, c) for c in range(4)]
        vertex = tuple(mass * ((v[c] + whole) / 20.0 + (bowed + at[c]) / 30.0) for c in range(4))
        edge = []
        for b, c in EDGES:
            near = 2.0 / 105.0 * (bowed + at[b] + at[c] + w[_EDGE[b, c]])
            edge.append(mass * ((whole + v[b] + v[c]) / 30.0 + near))
        return vertex, edge

    def _edge_values(self, component: Float[Array, " nodes"]) -> list[Float[Array, " tets"]]:
        return list(gathered(component, self.edges))

    def _at_corner(self, w: list[Float[Array, " tets"]], a: int) -> Float[Array, " tets"]:
        """Sum over the edges that meet at a corner."""
        return added(w[_EDGE[a, b]] for b in range(4) if b != a)


def edges_of_faces(
    element: QuadraticElement, faces: Int[np.ndarray, "3 faces"]
) -> Int[np.ndarray, "3 faces"]:
    """Places of the unknowns of the edges opposite to the corners of faces.

    An edge that no element has gets the place behind the last one.
    """
    tets, edges = (np.asarray(a, np.int64) for a in (element.tets, element.edges))
    n = int(edges.max()) + 1
    ends = np.sort(tets[np.asarray(EDGES)], axis=1)  # edge of the element, end, element
    keys, first = np.unique(ends[:, 0] * n + ends[:, 1], return_index=True)
    wanted = np.sort(np.asarray(faces, np.int64)[[[1, 2], [2, 0], [0, 1]]], axis=1)
    key = wanted[:, 0] * n + wanted[:, 1]
    place = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
    return np.where(keys[place] == key, edges.ravel()[first[place]], n)


def numbered_edges(
    tets: Int[np.ndarray, "tets 4"],
) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, "tets 6"]]:
    """Ends of each edge of a set of tetrahedra, and which edges each element has."""
    ends = np.sort(tets[:, np.asarray(EDGES)].reshape(-1, 2), axis=1)
    distinct, index = np.unique(ends, axis=0, return_inverse=True)
    return distinct, index.reshape(-1, 6)
