"""Separators separate, and are as small as can be; batches of fronts are padded little."""

import itertools

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from jaxfsi.core.solve.dissection import _least_cuts, _narrowed, _swept, dissection
from jaxfsi.core.solve.nested_factor import _Dense, _grouped

LEAF = 30


def graph_of(n: int, edges: np.ndarray) -> sp.csr_matrix:
    """Symmetric, with its diagonal."""
    rows, columns = np.concatenate([edges, edges[:, ::-1], np.tile(np.arange(n), (2, 1)).T]).T
    graph = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    graph.data[:] = 1.0
    return graph


@pytest.fixture(scope="module")
def cloud() -> tuple[sp.csr_matrix, np.ndarray]:
    """Tetrahedra between scattered points in a slab."""
    points = np.random.default_rng(3).random((1500, 3)) * [3.0, 2.0, 0.3]
    tets = Delaunay(points).simplices
    edges = np.concatenate([tets[:, pair] for pair in itertools.combinations(range(4), 2)])
    return graph_of(len(points), edges), points


@pytest.mark.parametrize("with_points", [True, False])
def test_every_node_has_one_front_and_neighbours_lie_in_one_line_of_descent(cloud, with_points):
    graph, points = cloud
    tree = dissection(graph, points if with_points else None, LEAF)
    owner = np.full(len(points), -1)
    for k, front in enumerate(tree):
        assert front.parent < k
        assert np.all(owner[front.nodes] == -1)
        owner[front.nodes] = k
    assert np.all(owner >= 0)
    above = [{k} for k in range(len(tree))]
    for k, front in enumerate(tree):
        if front.parent >= 0:
            above[k] |= above[front.parent]
    entries = graph.tocoo()
    for i, j in set(zip(owner[entries.row], owner[entries.col], strict=True)):
        assert i in above[j] or j in above[i]


def test_narrowed_cut_separates_with_fewer_nodes_than_the_sweep(cloud):
    graph, points = cloud
    swept = _swept(graph, points)
    cut = _narrowed(graph, swept)
    assert len(cut.separator) < 0.9 * len(swept.separator)
    assert np.array_equal(np.sort(np.concatenate(cut)), np.arange(len(points)))
    assert graph[cut.first][:, cut.second].nnz == 0


def separates(graph: sp.csr_matrix, cut: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether no path leads from start to end without the nodes of the cut."""
    rest = np.flatnonzero(~cut)
    label = connected_components(graph[rest][:, rest], directed=False)[1]
    return not set(label[start[rest]]) & set(label[end[rest]])


@pytest.mark.parametrize("seed", range(6))
def test_cut_has_the_fewest_nodes_of_all_that_separate(seed):
    rng, n = np.random.default_rng(seed), 11
    graph = graph_of(n, rng.integers(n, size=(18, 2)))
    start, end = np.arange(n) < 3, np.arange(n) >= n - 3
    least = min(
        sum(chosen)
        for chosen in itertools.product([False, True], repeat=n)
        if separates(graph, np.array(chosen), start, end)
    )
    for entries, exits in _least_cuts(graph, start, end):
        cut = entries & ~exits
        assert cut.sum() == least
        assert separates(graph, cut, start, end)


def dense(own: int, above: int) -> _Dense:
    return _Dense(np.zeros(own, int), np.zeros(above, int), np.zeros((0, 0)), np.zeros((0, 0)))


def padded(group: list[_Dense]) -> int:
    own, above = (max(len(f[k]) for f in group) for k in (0, 1))
    return len(group) * own * (own + 2 * above)


@pytest.mark.parametrize("batch_cost", [0, 2_000, 10**9])
def test_fronts_are_batched_where_it_pays(batch_cost):
    rng = np.random.default_rng(5)
    level = [dense(*rng.integers(20, 90, size=2)) for _ in range(40)] + [dense(200, 0)]
    groups = _grouped(level, batch_cost)
    assert sorted(id(f) for group in groups for f in group) == sorted(map(id, level))
    cost = sum(padded(group) + batch_cost for group in groups)
    assert cost <= padded(level) + batch_cost
    if batch_cost == 0:
        assert sum(map(padded, groups)) == sum(padded([front]) for front in level)
    elif batch_cost == 10**9:
        assert len(groups) == 1
    else:
        assert 1 < len(groups) < len(level)
