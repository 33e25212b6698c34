"""A lattice of tetrahedra, fine where the vessel's surfaces need it, that samples L and W.

Cubes are split into six tetrahedra each (Kuhn 1960) and bisected along the edge v₀v_d of a
tetrahedron of type d (Maubach 1995, SIAM J. Sci. Comput. 16, algorithm 2.1)::

    (v₀ … v_d …) -> (v₀ … v_{d−1}, z, v_{d+1} …) and (v₁ … v_d, z, v_{d+1} …),  z = (v₀ + v_d)/2,

the type then counts down from 3 to 1 and starts again: three bisections halve the lattice.
Bisection goes on until no node hangs on an edge, so the lattice conforms and the zero set of a
piecewise-linear function on it is a manifold without any table of cases. W < L at every node
makes the two zero sets nest.

L and W are distances near their zero sets, which decides where to refine:

- a tetrahedron with a node that lies farther from the zero set than its own diameter cannot meet
  it and is dropped;
- one whose linear interpolant has |∇f| well below 1 straddles a ridge of the distance (a thin
  septum, the edge of a slit, a crease) and is bisected further, so that thin parts are resolved
  without knowing where they are;
- else the diameter stays below a share of the local radius.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxfsi.anatomy import Anatomy

_HALVINGS = 7
# Distance functions of bent or elliptic vessels overstate distances by less than this.
_REACH = 1.4
# |∇f| of the interpolant: 1 − O(diameter/radius) where f is resolved, 0..0.7 across a ridge.
_RESOLVED_GRADIENT = 0.7
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


class LatticeSettings(NamedTuple):
    """How finely the lattice samples the anatomy.

    Attributes:
        per_radius: largest diameter of a tetrahedron over the local radius.
        smallest: diameter at which refinement stops even across a ridge [cm].
        largest: diameter that is never exceeded near a surface [cm].
    """

    per_radius: float = 0.5
    smallest: float = 0.01
    largest: float = 0.3

    def finer(self) -> "LatticeSettings":
        """The same with all lengths at 0.7 of what they were."""
        return LatticeSettings(*(0.7 * length for length in self))


class Lattice(NamedTuple):
    """Conforming tetrahedra of either orientation near a surface, with L and W at their nodes.

    Attributes:
        points: nodes [cm].
        tets: nodes of each tetrahedron.
        lumen: L at the nodes [cm].
        wall: W at the nodes [cm].
    """

    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    lumen: Float[np.ndarray, " nodes"]
    wall: Float[np.ndarray, " nodes"]


def sample_lattice(anatomy: Anatomy, settings: LatticeSettings | None = None) -> Lattice:
    """Sample lumen and wall of an anatomy where their surfaces run."""
    growing = _GrowingLattice(anatomy, settings or LatticeSettings())
    growing.drop_far()
    for _ in range(3 * _HALVINGS):
        chosen = np.flatnonzero(growing.coarse())
        if len(chosen) == 0:
            break
        growing.refine(chosen)
        growing.drop_far()
    # A node exactly on a surface would make a triangle without area.
    tiny = 1e-9
    lumen = np.where(np.abs(growing.lumen) < tiny, tiny, growing.lumen)
    wall = np.where(np.abs(growing.wall) < tiny, -tiny, growing.wall)
    return Lattice(growing.points, growing.tets, lumen, wall)


class _GrowingLattice:
    """Nodes on an integer grid with sampled values; tetrahedra with Maubach's types."""

    def __init__(self, anatomy: Anatomy, settings: LatticeSettings):
        low, high = anatomy.bounds + np.array([[-1.0], [1.0]]) * settings.largest
        # The longest edge of a Kuhn tetrahedron is the diagonal of its cube.
        edge = 4.0 * settings.largest / np.sqrt(3.0)
        cubes = np.ceil((high - low) / edge).astype(np.int64)
        self.anatomy, self.settings = anatomy, settings
        self.origin, self.unit = low, edge / 2**_HALVINGS
        self.side = int(cubes.max()) * 2**_HALVINGS + 1
        self.nodes, self.tets = _kuhn_cubes(cubes, 2**_HALVINGS)
        self.type = np.full(len(self.tets), 3)
        self.lumen, self.wall, self.radius = self._sample(self.nodes)

    @property
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        return self.origin + self.unit * self.nodes

    def _sample(self, nodes: Int[np.ndarray, "nodes 3"]) -> list[Float[np.ndarray, " nodes"]]:
        x = self.origin + self.unit * nodes
        functions = (self.anatomy.lumen, self.anatomy.wall, self.anatomy.local_radius)
        return [np.asarray(f(x), dtype=float) for f in functions]

    def _key(self, nodes: Int[np.ndarray, "*any 3"]) -> Int[np.ndarray, "*any"]:
        return (nodes[..., 0] * self.side + nodes[..., 1]) * self.side + nodes[..., 2]

    def refine(self, chosen: Int[np.ndarray, " chosen"]) -> None:
        """Bisect some tetrahedra, then others until no node hangs."""
        split = np.zeros((0, 2), dtype=np.int64)
        while len(chosen):
            split = np.concatenate([split, self._bisect(chosen)])
            chosen = self._hanging(split)

    def _bisect(self, chosen: Int[np.ndarray, " chosen"]) -> Int[np.ndarray, "chosen 2"]:
        """Bisect each chosen tetrahedron once; the edges that were split."""
        tets, kind = self.tets[chosen], self.type[chosen]
        ends = np.stack([tets[:, 0], tets[np.arange(len(tets)), kind]], axis=1)
        z = self._add(self.nodes[ends].sum(axis=1) // 2)
        low, high = tets.copy(), tets.copy()
        for d in (1, 2, 3):
            rows = kind == d
            low[rows, d] = z[rows]
            high[rows, :d] = tets[rows, 1 : d + 1]
            high[rows, d] = z[rows]
        kind = np.where(kind == 1, 3, kind - 1)
        self.tets[chosen], self.type[chosen] = low, kind
        self.tets = np.concatenate([self.tets, high])
        self.type = np.concatenate([self.type, kind])
        return ends

    def _add(self, nodes: Int[np.ndarray, "chosen 3"]) -> Int[np.ndarray, " chosen"]:
        """Indices of nodes, sampled and stored where they are new."""
        keys, first, back = np.unique(self._key(nodes), return_index=True, return_inverse=True)
        known = self._key(self.nodes)
        order = np.argsort(known)
        index = order[np.minimum(np.searchsorted(known[order], keys), len(known) - 1)]
        new = known[index] != keys
        index[new] = len(known) + np.arange(new.sum())
        fresh = nodes[first[new]]
        lumen, wall, radius = self._sample(fresh)
        self.nodes = np.concatenate([self.nodes, fresh])
        self.lumen = np.concatenate([self.lumen, lumen])
        self.wall = np.concatenate([self.wall, wall])
        self.radius = np.concatenate([self.radius, radius])
        return index[back]

    def _hanging(self, split: Int[np.ndarray, "split 2"]) -> Int[np.ndarray, " hanging"]:
        """Tetrahedra that still own an edge that was split."""
        touched = np.zeros(len(self.nodes), dtype=bool)
        touched[split.ravel()] = True
        rows = np.flatnonzero(touched[self.tets].sum(axis=1) >= 2)
        edges = np.sort(self.tets[rows][:, _EDGES], axis=-1)
        count = len(self.nodes)
        keys = np.unique(np.sort(split, axis=1) @ np.array([count, 1]))
        found = np.isin(edges @ np.array([count, 1]), keys)
        return rows[found.any(axis=1)]

    def drop_far(self) -> None:
        """Forget tetrahedra that meet neither surface."""
        reach = _REACH * _diameters(self.points, self.tets)
        far = [np.abs(f)[self.tets].max(axis=1) > reach for f in (self.lumen, self.wall)]
        keep = ~(far[0] & far[1])
        self.tets, self.type = self.tets[keep], self.type[keep]

    def coarse(self) -> Bool[np.ndarray, " tets"]:
        """Whether a tetrahedron is too large for the surface in or near it."""
        points, settings = self.points, self.settings
        diameter = _diameters(points, self.tets)
        wanted = np.clip(
            settings.per_radius * self.radius[self.tets].min(axis=1),
            settings.smallest,
            settings.largest,
        )
        coarse = diameter > wanted
        for f in (self.lumen, self.wall):
            near = np.abs(f)[self.tets].max(axis=1) <= _REACH * diameter
            steep = _slopes(points, self.tets, f) >= _RESOLVED_GRADIENT
            coarse |= near & ~steep & (diameter > settings.smallest)
        return coarse


def _kuhn_cubes(
    cubes: Int[np.ndarray, " 3"], scale: int
) -> tuple[Int[np.ndarray, "nodes 3"], Int[np.ndarray, "tets 4"]]:
    """Nodes of a block of cubes, times ``scale``, and six tetrahedra a cube."""
    shape = cubes + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cubes), indexing="ij"), axis=-1)
    paths = np.array(
        [
            np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
            for order in itertools.permutations(range(3))
        ]
    )
    corners = corner.reshape(-1, 1, 1, 3) + paths
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    return scale * nodes.reshape(-1, 3), (corners @ stride).reshape(-1, 4)


def _diameters(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> Float[np.ndarray, " tets"]:
    corners = points[tets]
    sides = corners[:, _EDGES[:, 0]] - corners[:, _EDGES[:, 1]]
    return np.sqrt(np.einsum("tek,tek->te", sides, sides).max(axis=1))


def _slopes(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    values: Float[np.ndarray, " nodes"],
) -> Float[np.ndarray, " tets"]:
    """|∇f| of the linear interpolant of each tetrahedron."""
    sides = points[tets[:, 1:]] - points[tets[:, :1]]
    rise = values[tets[:, 1:]] - values[tets[:, :1]]
    return np.linalg.norm(np.linalg.solve(sides, rise[..., None])[..., 0], axis=1)
