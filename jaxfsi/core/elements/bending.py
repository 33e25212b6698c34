"""A wall that bends: wedges where it stands in columns, quadratic tetrahedra elsewhere.

Wedges have no unknowns but those of their nodes. On faces that they share with tetrahedra, the
mid-edge modes of these are held, so that displacements agree but on quadrilateral sides: there a
wedge's are bilinear and those of the two tetrahedra linear on each triangle.
"""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.linear import Geometry, geometry
from jaxfsi.core.elements.quadratic import (
    EDGES,
    QuadraticElement,
    edges_of_faces,
    numbered_edges,
)
from jaxfsi.core.elements.wedge import (
    WedgeElement,
    WedgeGeometry,
    WedgePrestress,
    wedge_geometry,
)

Tree = TypeVar("Tree")


class BendingShape(NamedTuple):
    """Shape of the elements in the reference configuration.

    Attributes:
        wedges: of the wedges.
        rest: of the other tetrahedra.
    """

    wedges: WedgeGeometry
    rest: Geometry

    @property
    def volume(self) -> Float[Array, " wedges"]:
        """Volumes of the wedges [cm³]; there are some."""
        return self.wedges.volume


class BendingPrestress(NamedTuple):
    """Second Piola-Kirchhoff stress of the undeformed wall [dyn/cm²].

    Attributes:
        wedges: at the two points of the wedges.
        columns: along the three columns of the wedges, see `WedgePrestress`.
        rest: at the points of the other tetrahedra.
    """

    wedges: Float[Array, "3 3 2 wedges"]
    columns: Float[Array, "3 wedges"]
    rest: Float[Array, "3 3 4 rest"]

    @property
    def of_wedges(self) -> WedgePrestress:
        """That of the wedges."""
        return WedgePrestress(self.wedges, self.columns)


class BendingElement(eqx.Module):
    """Wedges and quadratic tetrahedra.

    Attributes:
        tets: corners of all tetrahedra of the wall, those that fill wedges among them.
        wedges: the wedges.
        wedge_tets: the three tetrahedra of each wedge, as positions in ``tets``.
        upper: share of a wedge's upper point in each of them: 0, 1/2 or 1.
        rest: the tetrahedra outside wedges.
        rest_tets: their positions in ``tets``.
    """

    tets: Int[Array, "4 tets"]
    wedges: WedgeElement
    wedge_tets: Int[Array, "3 wedges"]
    upper: Float[Array, "3 wedges"]
    rest: QuadraticElement
    rest_tets: Int[Array, " rest"]

    def geometry(self, x: Float[Array, "3 nodes"]) -> BendingShape:
        """Shape of the elements with node positions x [cm]."""
        return BendingShape(wedge_geometry(x, self.wedges), geometry(x, self.rest.tets))

    def in_wedges(self, values: Tree) -> Tree:
        """Values of the wedges where there is one a tetrahedron: the mean of its three."""
        return self._shared(values, lambda a: jnp.mean(a[..., self.wedge_tets], axis=-2))

    def in_rest(self, values: Tree) -> Tree:
        """Values of the tetrahedra outside wedges where there is one a tetrahedron."""
        return self._shared(values, lambda a: a[..., self.rest_tets])

    def _shared(self, values, pick):
        n = self.tets.shape[1]

        def part(leaf):
            varies = eqx.is_array_like(leaf) and jnp.ndim(leaf) and jnp.shape(leaf)[-1] == n
            return pick(jnp.asarray(leaf)) if varies else leaf

        return jax.tree.map(part, values)

    def by_tets(
        self, wedges: Float[Array, "3 3 2 wedges"], rest: Float[Array, "3 3 rest"]
    ) -> Float[Array, "3 3 tets"]:
        """One tensor a tetrahedron: that of the nearer point of its wedge, or of the middle."""
        low, high = wedges[:, :, 0, None], wedges[:, :, 1, None]
        filled = low + self.upper * (high - low)
        whole = jnp.zeros((3, 3, self.tets.shape[1]), rest.dtype)
        return whole.at[:, :, self.wedge_tets].set(filled).at[:, :, self.rest_tets].set(rest)


class BendingParts(NamedTuple):
    """A bending element and the edges that carry its unknowns.

    Attributes:
        element: the element.
        ends: ends of each edge.
        held: which of them lie on wedges.
    """

    element: BendingElement
    ends: Int[np.ndarray, "edges 2"]
    held: Bool[np.ndarray, " edges"]


def bending_element(
    tets: Int[np.ndarray, "tets 4"],
    wedges: Int[np.ndarray, "wedges 6"],
    wedge_tets: Int[np.ndarray, "wedges 3"],
    n_nodes: int,
) -> BendingParts:
    """Elements of a wall of which some tetrahedra fill wedges.

    Args:
        tets: tetrahedra of the wall.
        wedges: nodes of the wedges.
        wedge_tets: positions in ``tets`` of those that fill each wedge.
        n_nodes: nodes of the mesh, after which edges are numbered.
    """
    rest_tets = np.setdiff1d(np.arange(len(tets)), wedge_tets)
    ends, index = numbered_edges(tets[rest_tets])
    on_wedges = np.sort(tets[wedge_tets.ravel()][:, np.asarray(EDGES)].reshape(-1, 2), axis=1)
    held = np.isin(ends[:, 0] * n_nodes + ends[:, 1], on_wedges[:, 0] * n_nodes + on_wedges[:, 1])
    tops = np.any(tets[wedge_tets][..., None] == wedges[:, None, None, 3:], axis=3).sum(axis=2)
    rest = QuadraticElement(
        jnp.asarray(tets[rest_tets].T, jnp.int32), jnp.asarray(n_nodes + index.T, jnp.int32)
    )
    element = BendingElement(
        jnp.asarray(tets.T, jnp.int32),
        WedgeElement(jnp.asarray(wedges.T, jnp.int32)),
        jnp.asarray(wedge_tets.T, jnp.int32),
        jnp.asarray((tops.T - 1) / 2.0),
        rest,
        jnp.asarray(rest_tets, jnp.int32),
    )
    return BendingParts(element, ends, held)


def mid_edges(element: object, faces: Int[np.ndarray, "3 faces"]) -> Int[Array, "3 faces"] | None:
    """Unknowns of the edges opposite to the corners of faces.

    None where the wall has no such modes; edges of wedges have the unknown that is held, the last.

    Args:
        element: elements of the wall.
        faces: corners of faces of the wall.
    """
    quadratic = element.rest if isinstance(element, BendingElement) else element
    if not isinstance(quadratic, QuadraticElement) or not quadratic.tets.shape[1]:
        return None
    return jnp.asarray(edges_of_faces(quadratic, faces), jnp.int32)
