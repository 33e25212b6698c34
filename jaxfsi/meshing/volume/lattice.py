"""A lattice of tetrahedra, fine where the vessel's surfaces need it, that samples L and W.

Cubes are split into six tetrahedra each (Kuhn 1960) and bisected along the edge v₀v_d of a
tetrahedron of type d (Maubach 1995, SIAM J. Sci. Comput. 16, algorithm 2.1)::

    (v₀ … v_d …) -> (v₀ … v_{d−1}, z, v_{d+1} …) and (v₁ … v_d, z, v_{d+1} …),  z = (v₀ + v_d)/2,

the type then counts down from 3 to 1 and starts again: three bisections halve the lattice.
Bisection goes on until no node hangs on an edge, so the lattice conforms and the zero set of a
piecewise-linear function on it is a manifold without any table of cases. W < L at every node
makes the two zero sets nest.

L and W are distances near their zero sets, which decides where to refine:

- a tetrahedron with a node that lies farther from the zero set than its own diameter, or with all
  nodes farther than its circumradius, cannot meet it and is dropped;
- one whose linear interpolant has |∇f| well below 1 straddles a ridge of the distance (a thin
  septum, the edge of a slit, a crease) or a fillet, and is bisected further while the values at
  its nodes were far from those interpolated before, so that thin parts are resolved without
  knowing where they are;
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
# Circumradius over diameter, at most, of the three shapes that bisection makes.
_CIRCUMRADIUS = 0.56
# |∇f| of the interpolant: 1 − O(diameter/radius) where f is resolved, 0..0.7 across a ridge.
_RESOLVED_GRADIENT = 0.7
# Error of the linear interpolant at the middle of an edge over its length: length/(8 radius) on a
# smooth surface, up to 1/2 across a ridge.
_RIDGE_ERROR = 0.1
# Above this diameter [cm] a small gradient alone calls for refinement.
_BLIND_DIAMETER = 0.05
# On edges below this length [cm] the local radius is interpolated.
_RADIUS_LENGTH = 0.15
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


class LatticeSettings(NamedTuple):
    """How finely the lattice samples the anatomy.

    Attributes:
        per_radius: largest diameter of a tetrahedron over the local radius.
        smallest: diameter at which refinement stops even across a ridge [cm].
        largest: diameter that is never exceeded near a surface [cm].
    """

    per_radius: float = 0.6
    smallest: float = 0.022
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
        self.keys = self._key(self.nodes)
        self.index = np.argsort(self.keys)
        self.keys = self.keys[self.index]
        self.lumen, self.wall = self._sample(self.nodes)
        self.radius = np.asarray(anatomy.local_radius(self.points), dtype=float)
        # Unknown at the nodes that the lattice starts with.
        self.error = np.full(len(self.nodes), 0.5)

    @property
    def points(self) -> Float[np.ndarray, "nodes 3"]:
        return self.origin + self.unit * self.nodes

    def _sample(self, nodes: Int[np.ndarray, "nodes 3"]) -> list[Float[np.ndarray, " nodes"]]:
        x = self.origin + self.unit * nodes
        return [np.asarray(f(x), dtype=float) for f in (self.anatomy.lumen, self.anatomy.wall)]

    def _key(self, nodes: Int[np.ndarray, "*any 3"]) -> Int[np.ndarray, "*any"]:
        return (nodes[..., 0] * self.side + nodes[..., 1]) * self.side + nodes[..., 2]

    def refine(self, chosen: Int[np.ndarray, " chosen"]) -> None:
        """Bisect some tetrahedra, then others until no node hangs."""
        split = np.zeros((0, 2), dtype=np.int64)
        while len(chosen):
            before = len(self.tets)
            newest = self._bisect(chosen)
            split = np.concatenate([split, newest])
            # Parts of what was just bisected may own any split edge, the others only a new one.
            parts = np.concatenate([chosen, np.arange(before, len(self.tets))])
            chosen = np.union1d(
                self._owners(newest, np.arange(len(self.tets))), self._owners(split, parts)
            )

    def _bisect(self, chosen: Int[np.ndarray, " chosen"]) -> Int[np.ndarray, "chosen 2"]:
        """Bisect each chosen tetrahedron once; the edges that were split."""
        tets, kind = self.tets[chosen], self.type[chosen]
        ends = np.stack([tets[:, 0], tets[np.arange(len(tets)), kind]], axis=1)
        z = self._middle(ends)
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

    def _middle(self, ends: Int[np.ndarray, "edges 2"]) -> Int[np.ndarray, " edges"]:
        """Nodes at the middle of edges, sampled and stored where they are new."""
        nodes = self.nodes[ends].sum(axis=1) // 2
        keys, first, back = np.unique(self._key(nodes), return_index=True, return_inverse=True)
        position = np.searchsorted(self.keys, keys)
        index = self.index[np.minimum(position, len(self.keys) - 1)]
        new = self._key(self.nodes[index]) != keys
        index[new] = len(self.nodes) + np.arange(new.sum())
        self.keys = np.insert(self.keys, position[new], keys[new])
        self.index = np.insert(self.index, position[new], index[new])
        self._store(nodes[first[new]], ends[first[new]])
        return index[back]

    def _store(self, nodes: Int[np.ndarray, "new 3"], ends: Int[np.ndarray, "new 2"]) -> None:
        """Sample new nodes, each at the middle of an edge."""
        lumen, wall = self._sample(nodes)
        length = self.unit * np.linalg.norm(self.nodes[ends[:, 1]] - self.nodes[ends[:, 0]], axis=1)
        radius = self.radius[ends].mean(axis=1)
        coarse = length > _RADIUS_LENGTH
        radius[coarse] = self.anatomy.local_radius(self.origin + self.unit * nodes[coarse])
        # A ridge of either function counts where the other one is far as well: it is rare.
        error = np.maximum(
            np.abs(lumen - self.lumen[ends].mean(axis=1)),
            np.abs(wall - self.wall[ends].mean(axis=1)),
        )
        self.error = np.concatenate([self.error, error / length])
        self.nodes = np.concatenate([self.nodes, nodes])
        self.lumen = np.concatenate([self.lumen, lumen])
        self.wall = np.concatenate([self.wall, wall])
        self.radius = np.concatenate([self.radius, radius])

    def _owners(
        self, split: Int[np.ndarray, "split 2"], among: Int[np.ndarray, " some"]
    ) -> Int[np.ndarray, " owners"]:
        """Tetrahedra among some that own one of the split edges."""
        touched = np.zeros(len(self.nodes), dtype=bool)
        touched[split.ravel()] = True
        rows = among[touched[self.tets[among]].sum(axis=1) >= 2]
        a, b = (self.tets[rows][:, _EDGES[:, i]] for i in (0, 1))
        both = touched[a] & touched[b]
        a, b, count = a[both], b[both], len(self.nodes)
        keys = np.unique(split.min(axis=1) * count + split.max(axis=1))
        edges = np.minimum(a, b) * count + np.maximum(a, b)
        found = np.zeros(both.shape, dtype=bool)
        found[both] = keys[np.minimum(np.searchsorted(keys, edges), len(keys) - 1)] == edges
        return rows[found.any(axis=1)]

    def _diameters(self) -> Float[np.ndarray, " tets"]:
        """Longest edge of each tetrahedron, which is the one bisected next."""
        first, last = self.tets[:, 0], self.tets[np.arange(len(self.tets)), self.type]
        return self.unit * np.linalg.norm(self.nodes[last] - self.nodes[first], axis=1)

    def drop_far(self) -> None:
        """Forget tetrahedra that meet neither surface."""
        reach = _REACH * self._diameters()
        keep = np.zeros(len(self.tets), dtype=bool)
        for f in (self.lumen, self.wall):
            away = np.abs(f)[self.tets]
            keep |= (away.max(axis=1) <= reach) & (away.min(axis=1) <= _CIRCUMRADIUS * reach)
        self.tets, self.type = self.tets[keep], self.type[keep]

    def coarse(self) -> Bool[np.ndarray, " tets"]:
        """Whether a tetrahedron is too large for the surface in or near it."""
        points, settings = self.points, self.settings
        diameter = self._diameters()
        wanted = np.clip(
            settings.per_radius * self.radius[self.tets].min(axis=1),
            settings.smallest,
            settings.largest,
        )
        coarse = diameter > wanted
        uneven = self.error[self.tets].max(axis=1) > _RIDGE_ERROR
        doubtful = (diameter > settings.smallest) & (uneven | (diameter > _BLIND_DIAMETER))
        for f in (self.lumen, self.wall):
            near = np.abs(f)[self.tets].max(axis=1) <= _REACH * diameter
            rows = np.flatnonzero(near & doubtful & ~coarse)
            flat = _slopes(points, self.tets[rows], f) < _RESOLVED_GRADIENT
            coarse[rows[flat]] = True
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


def _slopes(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    values: Float[np.ndarray, " nodes"],
) -> Float[np.ndarray, " tets"]:
    """|∇f| of the linear interpolant of each tetrahedron."""
    sides = points[tets[:, 1:]] - points[tets[:, :1]]
    rise = values[tets[:, 1:]] - values[tets[:, :1]]
    return np.linalg.norm(np.linalg.solve(sides, rise[..., None])[..., 0], axis=1)
