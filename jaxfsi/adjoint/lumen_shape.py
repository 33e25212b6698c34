"""The lumen as a shape that can be varied on a fixed mesh, and derivatives by it.

A displacement v of the lumen is spread over the mesh by harmonic fields with a coefficient 1/V, as
the mesh motion of the core spreads that of the wall: nodes of the openings stay, and the outside of
the wall goes along, so that the wall keeps its thickness::

    ∇·((1/V) ∇v) = 0 in blood and wall,  v given on the lumen,  v = 0 on the openings of the blood

With the derivative G of a number by all node positions, G·v = Σ g·v over the lumen's nodes, where g
gathers what the others take along (the transposed field). A shift of a surface along itself does
not change the shape; what is left is the normal part, per area the density of the derivative::

    d = ∫ q h dA,   q = g·n / A,   for a shift h outwards

It is smoothed by (1 − ℓ² Δ) on the surface, which leaves ∫ q dA unchanged: a node alone moves the
mesh rather than the vessel.

The thickness of the wall varies where its outside is shifted along the normal of the lumen, by its
own distance from it; between two lumens it does not, since there it is their distance.

Source: harmonic extension as in Stein, Tezduyar & Benney 2003; smoothing of shape gradients:
Schmidt & Schulz 2009, section 4.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxfsi.core.elements.assembly import assembled, host_geometry, stiffness
from jaxfsi.mesh import INTERFACE, OUTER_WALL, Mesh, Region

_LENGTH = 0.1
"""Length ℓ over which a density is smoothed [cm]."""


class LumenSurface(NamedTuple):
    """The wetted wall of a mesh.

    Attributes:
        nodes: its nodes, ascending.
        triangles: its triangles, as indices into `nodes`.
        points: where they are [cm].
        normal: unit normals, out of the blood.
        area: area that belongs to each node [cm²].
    """

    nodes: Int[np.ndarray, " nodes"]
    triangles: Int[np.ndarray, "triangles 3"]
    points: Float[np.ndarray, "nodes 3"]
    normal: Float[np.ndarray, "nodes 3"]
    area: Float[np.ndarray, " nodes"]


def lumen_surface(mesh: Mesh) -> LumenSurface:
    """The wetted wall of a mesh.

    Raises:
        ValueError: the mesh has none.
    """
    nodes, inverse = np.unique(mesh.labelled(INTERFACE), return_inverse=True)
    triangles = inverse.reshape(-1, 3)
    a, b, c = (mesh.points[nodes[triangles[:, i]]] for i in range(3))
    vector = np.cross(b - a, c - a) / 2.0
    normal, area = np.zeros((len(nodes), 3)), np.zeros(len(nodes))
    for i in range(3):
        np.add.at(normal, triangles[:, i], vector)
        np.add.at(area, triangles[:, i], np.linalg.norm(vector, axis=1) / 3.0)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.maximum(length, 1e-300)
    return LumenSurface(nodes, triangles, mesh.points[nodes], normal, area)


class HarmonicExtension:
    """A displacement of some nodes spread harmonically over elements, and its transpose."""

    def __init__(
        self,
        mesh: Mesh,
        given: Int[np.ndarray, " given"],
        zero: Int[np.ndarray, " zero"],
        elements: Bool[np.ndarray, " tets"] | None = None,
    ):
        """Factor the field's equations.

        Args:
            mesh: the mesh.
            given: nodes whose displacement is given.
            zero: nodes that stay, also where they are among those given.
            elements: over which it is spread; None: all. Other nodes stay.
        """
        n = len(mesh.points)
        tets = mesh.tets if elements is None else mesh.tets[elements]
        shape = host_geometry(mesh.points, tets)
        K = assembled(tets, stiffness(shape, 1.0 / shape.volume), n)
        inside = np.zeros(n, bool)
        inside[tets.ravel()] = True
        stays = np.zeros(n, bool)
        stays[zero] = True
        self.given = np.asarray(given)
        self._moves = ~stays[self.given]
        inside[self.given] = False
        self._free = np.flatnonzero(inside & ~stays)
        self._factor = spla.splu(sp.csc_matrix(K[self._free][:, self._free]))
        self._coupling = K[self._free][:, self.given]
        self._n = n

    def __call__(self, shift: Float[np.ndarray, "given 3"]) -> Float[np.ndarray, "nodes 3"]:
        """Displacement of all nodes [cm] from that of the given ones."""
        kept = shift * self._moves[:, None]
        field = np.zeros((self._n, 3))
        field[self.given] = kept
        field[self._free] = -self._factor.solve(self._coupling @ kept)
        return field

    def gathered(self, G: Float[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "given 3"]:
        """Derivative by the given nodes, from that by all: the transpose of the field."""
        own = G[self.given] - self._coupling.T @ self._factor.solve(G[self._free], trans="T")
        return own * self._moves[:, None]


def lumen_spread(mesh: Mesh, surface: LumenSurface) -> HarmonicExtension:
    """The field of a shift of the lumen: openings stay, the wall goes along."""
    caps = [mesh.labelled(name).ravel() for name in mesh.openings]
    return HarmonicExtension(mesh, surface.nodes, np.unique(np.concatenate(caps)))


def density(
    g: Float[np.ndarray, "nodes 3"], surface: LumenSurface, *, length: float = _LENGTH
) -> Float[np.ndarray, " nodes"]:
    """Derivative per shift outwards and area, smoothed [1/cm³ times the unit of the number].

    Args:
        g: derivative by the nodes of the surface, see `HarmonicExtension.gathered`.
        surface: the surface.
        length: over which it is smoothed [cm]; 0 leaves it as it is.
    """
    force = np.sum(g * surface.normal, axis=1)
    A = sp.diags_array(surface.area) + length**2 * surface_stiffness(surface)
    return spla.splu(sp.csc_matrix(A)).solve(force)


def surface_stiffness(surface: LumenSurface) -> sp.csr_matrix:
    """∫ ∇N_a·∇N_b dA of the linear functions on the surface: e_a·e_b / 4A of each triangle."""
    corner = surface.points[surface.triangles]
    edge = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)  # opposite to each corner
    area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1) / 2.0
    values = np.einsum("tai,tbi->tab", edge, edge) / (4.0 * area)[:, None, None]
    rows = np.repeat(surface.triangles, 3, axis=1).ravel()
    columns = np.tile(surface.triangles, (1, 3)).ravel()
    n = len(surface.nodes)
    return sp.csr_matrix((values.ravel(), (rows, columns)), shape=(n, n))


def thickness_field(mesh: Mesh, surface: LumenSurface) -> Float[np.ndarray, "nodes 3"]:
    """Displacement of all nodes [cm] by which the wall doubles its thickness, if it were linear.

    Raises:
        ValueError: the mesh has no outside of a wall.
    """
    outer = np.unique(mesh.labelled(OUTER_WALL))
    outer = outer[~np.isin(outer, surface.nodes)]
    near = KDTree(surface.points).query(mesh.points[outer])[1]
    normal = surface.normal[near]
    away = np.sum((mesh.points[outer] - surface.points[near]) * normal, axis=1)
    spread = HarmonicExtension(mesh, outer, surface.nodes, mesh.region == Region.SOLID)
    return spread(np.maximum(away, 0.0)[:, None] * normal)


def vessel_nodes(
    surface: LumenSurface, axis: Float[np.ndarray, "points 3"], *, reach: float = 0.4
) -> Bool[np.ndarray, " nodes"]:
    """Which nodes of the lumen belong to the vessel round an axis.

    Those near it whose normal points away from it: the lumen of another vessel beside it, across a
    shared wall, turns the other way.

    Args:
        surface: the lumen.
        axis: points along the middle of the vessel.
        reach: largest distance from the axis [cm].
    """
    distance, place = KDTree(axis).query(surface.points)
    away = np.sum((surface.points - axis[place]) * surface.normal, axis=1)
    return (distance < reach) & (away > 0.0)


def widening(q: Float[np.ndarray, " nodes"], surface: LumenSurface, chosen: np.ndarray) -> float:
    """Change of a number when part of the lumen is shifted outwards by 0.1 mm.

    Args:
        q: density of its derivative, see `density`.
        surface: the lumen.
        chosen: nodes of the part.
    """
    return float(0.01 * np.sum(q[chosen] * surface.area[chosen]))
