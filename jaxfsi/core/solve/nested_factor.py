"""Direct solution with a sparse symmetric matrix by nested dissection: batched dense products.

The nodes of the matrix's graph are cut in two by a small separator, each half again, and so on;
what is left at the end are the leaves of a binary tree. A front k holds the unknowns s_k of its
separator or leaf and couples them to the unknowns b_k of the separators above it. Eliminated from
the leaves to the root (multifrontal method)::

    F_k = A on (s_k, b_k) + Σ_children Schur complement,   D_k = F_ss⁻¹,   W_k = F_bs D_k
    down the matrix:  y_b −= W_k y_s        up again:  x_s = D_k y_s − W_kᵀ x_b

The fronts of one height, that is as many fronts above their deepest leaf, do not depend on each
other, so that a solution is some twenty batched products of dense matrices: it runs on any device,
can be batched, and in single precision serves as a preconditioner. Fronts of one height go into a
few batches of similar size and are padded: leaves are alike in size wherever they hang, so that
a sixth less is padded than with the fronts of one depth.

Measured on the wall of the real patient's coarse mesh (16 299 unknowns) with leaves of 60 in 254
batches: 5.8 million numbers; SuperLU with minimum degree has 4.6 million nonzeros. A block
tridiagonal factor over the levels of a breadth-first search has 58 million on a wall of 13 341
unknowns. Larger leaves hold more numbers in fewer products: as fast, and compiled in a third of
the time.

Source: George 1973, SIAM J. Numer. Anal. 10:345; Duff & Reid 1983, ACM Trans. Math. Softw. 9:302.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import IN_BOUNDS, gathered
from jaxfsi.core.solve.dissection import Front, dissection
from lumped.device import on_cpu


class _Sizes(NamedTuple):
    """What the programs of a device are fast with.

    Attributes:
        leaf: unknowns that are not dissected further.
        batch_cost: numbers that may be padded to save a batch: its dozen small operations take as
            long as to read them.
    """

    leaf: int
    batch_cost: int


CPU_SIZES = _Sizes(300, 200_000)
"""On two cores."""

ACCELERATOR_SIZES = _Sizes(800, 4_000_000)
"""Where starting a kernel takes as long as reading a million numbers."""


class Batch(eqx.Module):
    """Fronts of one height, padded to a common size.

    Attributes:
        own: unknowns s of each front; one beyond the last where there is none.
        above: unknowns b of each front, likewise.
        inverse: D of each front.
        coupling: W of each front.
    """

    own: Int[Array, "fronts own"]
    above: Int[Array, "fronts above"]
    inverse: Float[Array, "fronts own own"]
    coupling: Float[Array, "fronts above own"]


class NestedFactor(eqx.Module):
    """Factor of a matrix.

    Attributes:
        levels: batches of each height, the leaves first.
        n_unknowns: size of the matrix (static).
    """

    levels: tuple[tuple[Batch, ...], ...]
    n_unknowns: int = eqx.field(static=True)

    @property
    def batches(self) -> list[Batch]:
        """Batches of all levels."""
        return [batch for level in self.levels for batch in level]

    @property
    def n_numbers(self) -> int:
        """Numbers that are read in one solution, padding included."""
        return sum(b.inverse.size + 2 * b.coupling.size for b in self.batches)


class _Dense(NamedTuple):
    """Eliminated front: unknowns s and b, D and W."""

    own: Int[np.ndarray, " own"]
    above: Int[np.ndarray, " above"]
    inverse: Float[np.ndarray, "own own"]
    coupling: Float[np.ndarray, "above own"]


def nested_factor(
    matrix: sp.csr_matrix,
    *,
    block: int = 1,
    points: Float[np.ndarray, "nodes 3"] | None = None,
    dtype: type = np.float64,
) -> NestedFactor:
    """Factor a symmetric matrix.

    Args:
        matrix: symmetric, with ``block`` unknowns in a row for each node.
        block: unknowns a node.
        points: positions of the nodes; with them better cuts are found.
        dtype: precision in which the factor is kept.

    Raises:
        ValueError: a front cannot be inverted.
    """
    matrix = sp.csr_matrix(matrix)
    n_unknowns = matrix.indptr.size - 1
    entries = matrix.tocoo()
    graph = sp.csr_matrix(
        (np.ones(entries.nnz), (entries.row // block, entries.col // block)),
        shape=(n_unknowns // block,) * 2,
    )
    sizes = CPU_SIZES if on_cpu() else ACCELERATOR_SIZES
    tree = dissection(graph, points, sizes.leaf // block)
    # kept in the wanted precision from the start: in double precision they are most of the memory
    fronts = [
        f._replace(inverse=f.inverse.astype(dtype), coupling=f.coupling.astype(dtype))
        for f in _eliminated(matrix, graph, tree, block)
    ]
    fronts.reverse()  # they came from the last to the first
    of_height: dict[int, list[_Dense]] = {}
    for front, height in zip(fronts, _heights(tree), strict=True):
        if len(front.own):
            of_height.setdefault(height, []).append(front)
    levels = tuple(
        tuple(
            _batch(group, n_unknowns, dtype)
            for group in _grouped(of_height[height], sizes.batch_cost)
        )
        for height in sorted(of_height)
    )
    return NestedFactor(levels, n_unknowns)


def _heights(tree: list[Front]) -> list[int]:
    """Number of fronts from each one down to its deepest leaf."""
    heights = [0] * len(tree)
    for k in range(len(tree) - 1, 0, -1):
        above = tree[k].parent
        if above >= 0:
            heights[above] = max(heights[above], heights[k] + 1)
    return heights


def _eliminated(
    matrix: sp.csr_matrix, graph: sp.csr_matrix, tree: list[Front], block: int
) -> Iterator[_Dense]:
    """Eliminate the fronts from the last to the first."""
    n_unknowns = matrix.indptr.size - 1
    owner, place = np.empty(n_unknowns // block, int), np.full(n_unknowns, -1)
    children: list[list[int]] = [[] for _ in tree]
    for k, front in enumerate(tree):
        owner[front.nodes] = k
        if front.parent >= 0:
            children[front.parent].append(k)
    schur: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def unknowns(nodes: Int[np.ndarray, " _"]) -> Int[np.ndarray, " _"]:
        return (block * nodes[:, None] + np.arange(block)).ravel()

    for k in range(len(tree) - 1, -1, -1):
        below = [schur.pop(child) for child in children[k]]
        reached = np.concatenate([graph[tree[k].nodes].indices, *(nodes for nodes, _ in below)])
        near = np.unique(reached)
        above = near[owner[near] < k]
        own_unknowns, above_unknowns = unknowns(tree[k].nodes), unknowns(above)
        n_own = len(own_unknowns)
        both = np.concatenate([own_unknowns, above_unknowns])
        place[both] = np.arange(len(both))
        F = np.zeros((len(both), len(both)))
        rows = matrix[own_unknowns].tocoo()
        column = place[rows.col]
        known = column >= 0
        F[rows.row[known], column[known]] = rows.data[known]
        F[column[known], rows.row[known]] = rows.data[known]
        for nodes, complement in below:
            there = place[unknowns(nodes)]
            F[there[:, None], there] += complement
        place[both] = -1
        try:
            inverse = np.linalg.inv(F[:n_own, :n_own])
        except np.linalg.LinAlgError as error:
            raise ValueError(
                f"unknown {own_unknowns[0]} of the matrix and those around it cannot be"
                " eliminated; fix enough nodes of the model"
            ) from error
        W = F[n_own:, :n_own] @ inverse
        schur[k] = above, F[n_own:, n_own:] - W @ F[:n_own, n_own:]
        yield _Dense(own_unknowns, above_unknowns, inverse, W)


def _grouped(level: list[_Dense], batch_cost: int) -> list[list[_Dense]]:
    """Fronts of one height in batches with little padding: cut in two while that pays.

    The cut is along an order by own unknowns, by those above, or by numbers.
    """
    own = np.array([len(f.own) for f in level], int)
    above = np.array([len(f.above) for f in level], int)
    numbers = own * (own + 2 * above)
    batches, waiting = [], [np.arange(len(level))]
    while waiting:
        group = waiting.pop()
        least = len(group) * _padded(own[group].max(), above[group].max()) - batch_cost
        parts = None
        for key in (own, above, numbers):
            order = group[np.argsort(key[group], kind="stable")]
            before = _padded_up_to(own[order], above[order])[:-1]
            after = _padded_up_to(own[order[::-1]], above[order[::-1]])[-2::-1]
            if len(order) > 1 and np.min(before + after) < least:
                k = int(np.argmin(before + after)) + 1
                least, parts = before[k - 1] + after[k - 1], (order[:k], order[k:])
        if parts is None:
            batches.append([level[k] for k in group])
        else:
            waiting += parts
    return batches


def _padded(own: Int[np.ndarray, "..."], above: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
    """Numbers of a front."""
    return own * (own + 2 * above)


def _padded_up_to(
    own: Int[np.ndarray, " fronts"], above: Int[np.ndarray, " fronts"]
) -> Int[np.ndarray, " fronts"]:
    """Numbers of the batch of the first one, two, three ... fronts."""
    largest = np.maximum.accumulate(own), np.maximum.accumulate(above)
    return np.arange(1, len(own) + 1) * _padded(*largest)


def _batch(fronts: list[_Dense], n_unknowns: int, dtype: type) -> Batch:
    n_own, n_above = (max(len(x) for x in xs) for xs in zip(*(f[:2] for f in fronts), strict=True))
    n = len(fronts)
    own, above = (np.full((n, width), n_unknowns, np.int32) for width in (n_own, n_above))
    inverse, coupling = np.zeros((n, n_own, n_own), dtype), np.zeros((n, n_above, n_own), dtype)
    for k, f in enumerate(fronts):
        own[k, : len(f.own)], above[k, : len(f.above)] = f.own, f.above
        inverse[k, : len(f.own), : len(f.own)] = f.inverse
        coupling[k, : len(f.above), : len(f.own)] = f.coupling
    # `jnp.asarray` would compile a program for each of the many shapes
    return Batch(*map(jax.device_put, (own, above, inverse, coupling)))


def nested_solve(factor: NestedFactor, b: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
    """Solve with a factor, in its precision."""
    if not factor.levels:
        return b
    y = jnp.append(b.astype(factor.levels[0][0].inverse.dtype), 0.0)
    # The batches of a level do not wait for each other.
    for level in factor.levels:
        pushed = [jnp.einsum("kbs,ks->kb", f.coupling, gathered(y, f.own)) for f in level]
        y = y.at[_joined(f.above for f in level)].add(
            -_joined(pushed), mode=IN_BOUNDS, wrap_negative_indices=False
        )
    for level in reversed(factor.levels):
        solved = [
            jnp.einsum("kst,kt->ks", f.inverse, gathered(y, f.own))
            - jnp.einsum("kbs,kb->ks", f.coupling, gathered(y, f.above))
            for f in level
        ]
        y = y.at[_joined(f.own for f in level)].set(
            _joined(solved), mode=IN_BOUNDS, wrap_negative_indices=False
        )
    return y[:-1].astype(b.dtype)


def _joined(parts: Iterable[Array]) -> Array:
    return jnp.concatenate([part.reshape(-1) for part in parts])


def nested_solve_once(
    factor: NestedFactor, b: Float[np.ndarray, " unknowns"]
) -> Float[np.ndarray, " unknowns"]:
    """The same on the host, for a solution that is not worth a compilation."""
    y = np.append(b, 0.0)
    batches = jax.tree.map(np.asarray, factor.batches)
    for batch in batches:
        np.subtract.at(y, batch.above, (batch.coupling @ y[batch.own][..., None])[..., 0])
    for batch in reversed(batches):
        down = batch.inverse @ y[batch.own][..., None]
        up = np.swapaxes(batch.coupling, 1, 2) @ y[batch.above][..., None]
        y[batch.own] = (down - up)[..., 0]
        y[-1] = 0.0
    return y[:-1]
