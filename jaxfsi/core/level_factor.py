"""Direct solution with a sparse symmetric matrix whose graph is long and thin, as vessels are.

Nodes are grouped into the levels of a breadth-first search from one end of each component. A level
is coupled to its two neighbours only, so that the matrix is block tridiagonal, with dense blocks
that are a cross-section of the vessel wide::

    D₁ = A₁₁,  G_k = A_{k,k−1} D_{k−1}⁻¹,  D_k = A_kk − G_k A_{k−1,k}
    y_k = b_k − G_k y_{k−1},   x_k = D_k⁻¹ y_k − G_{k+1}ᵀ x_{k+1}

The factor is made once with NumPy and applied in JAX as two loops of dense products, which runs on
any device and can be batched; in single precision it serves as a preconditioner. It holds
2 Σ n_k² numbers for levels of n_k unknowns: about as many as a sparse factor of a thin wall
(9 million nonzeros in SuperLU against 12 million here, for 18 000 unknowns), and many more than
one of a compact body, for which this is the wrong tool.

Source: Golub & Van Loan 2013, Matrix Computations, section 4.5.1.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int
from scipy.sparse.csgraph import connected_components, dijkstra


class LevelFactor(eqx.Module):
    """Factor of a block tridiagonal matrix, padded to the widest level.

    Attributes:
        inverse: D_k⁻¹.
        coupling: G_k.
        gather: unknown at each place of each level; one beyond the last where there is none.
        place: place of each unknown in the padded levels.
    """

    inverse: Float[Array, "levels width width"]
    coupling: Float[Array, "levels width width"]
    gather: Int[Array, "levels width"]
    place: Int[Array, " unknowns"]


def breadth_first_levels(
    graph: sp.csr_matrix, starts: Sequence[Int[np.ndarray, " _"]] = ()
) -> Int[np.ndarray, " nodes"]:
    """Level of each node of a breadth-first search, chosen for narrow levels.

    Args:
        graph: symmetric; its entries say which nodes are coupled.
        starts: sets of nodes to try as the first level, such as the ends of vessels; a far node
            is tried in any case.

    Returns:
        The levels whose sizes have the smallest sum of squares.
    """
    if not (graph.indptr.size - 1):
        return np.zeros(0, int)
    n_components, component = connected_components(graph, directed=False)
    first = [np.unique(component, return_index=True)[1]]
    for _ in range(3):  # towards a far end: each search starts where the last one ended
        distance = _distance(graph, first[-1])
        order = np.lexsort((-distance, component))
        first.append(order[np.unique(component[order], return_index=True)[1]])
    candidates = [first[-1]]
    for start in starts:
        missing = np.setdiff1d(np.arange(n_components), component[start])
        candidates.append(np.concatenate([start, first[-1][missing]]))
    levels = [_distance(graph, nodes) for nodes in candidates if len(nodes)]
    return min(levels, key=lambda level: np.sum(np.bincount(level) ** 2))


def _distance(graph: sp.csr_matrix, start: Int[np.ndarray, " _"]) -> Int[np.ndarray, " nodes"]:
    """Number of edges from each node to the nearest of a set."""
    distance = dijkstra(graph, directed=False, indices=start, unweighted=True, min_only=True)
    return distance.astype(int)


def level_factor(
    matrix: sp.csr_matrix,
    *,
    block: int = 1,
    dtype: type = np.float64,
    starts: Sequence[Int[np.ndarray, " _"]] = (),
) -> LevelFactor:
    """Factor a symmetric matrix.

    Args:
        matrix: symmetric, with ``block`` unknowns in a row for each node.
        block: unknowns a node.
        dtype: precision in which the factor is kept.
        starts: sets of nodes to try as the first level, see `breadth_first_levels`.

    Raises:
        ValueError: a level's block cannot be inverted.
    """
    matrix = sp.csr_matrix(matrix)
    n_unknowns = matrix.indptr.size - 1
    entries = matrix.tocoo()
    graph = sp.csr_matrix(
        (np.ones(entries.nnz), (entries.row // block, entries.col // block)),
        shape=(n_unknowns // block,) * 2,
    )
    level = np.repeat(breadth_first_levels(graph, starts), block)
    members = [np.flatnonzero(level == k) for k in range(level.max(initial=-1) + 1)]
    width = max((len(m) for m in members), default=0)
    shape = (len(members), width, width)
    inverse, coupling = np.zeros(shape, dtype), np.zeros(shape, dtype)
    gather = np.full(shape[:2], n_unknowns)
    last = np.zeros((0, 0))
    for k, here in enumerate(members):
        block_matrix = matrix[here][:, here].toarray()
        if k:
            below = members[k - 1]
            lower = matrix[here][:, below].toarray()
            G = lower @ last
            block_matrix = block_matrix - G @ lower.T
            coupling[k, : len(here), : len(below)] = G
        try:
            last = np.linalg.inv(block_matrix)
        except np.linalg.LinAlgError as error:
            raise ValueError(
                f"level {k} of the matrix cannot be inverted; fix enough nodes of the model"
            ) from error
        inverse[k, : len(here), : len(here)] = last
        gather[k, : len(here)] = here
    place = np.empty(n_unknowns, dtype=int)
    held = gather < n_unknowns
    place[gather[held]] = np.flatnonzero(held)
    return LevelFactor(
        jnp.asarray(inverse), jnp.asarray(coupling), jnp.asarray(gather), jnp.asarray(place)
    )


def level_solve(factor: LevelFactor, b: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
    """Solve with a factor, in its precision."""
    if not factor.inverse.shape[0]:
        return b
    padded = jnp.append(b.astype(factor.inverse.dtype), 0.0)[factor.gather]
    n_levels = padded.shape[0]

    def down(k, y):
        return y.at[k].add(-(factor.coupling[k] @ y[k - 1]))

    def up(i, x):
        k = n_levels - 1 - i
        return x.at[k].add(-(x[k + 1] @ factor.coupling[k + 1]))

    y = jax.lax.fori_loop(1, n_levels, down, padded)
    x = jnp.einsum("kij,kj->ki", factor.inverse, y)
    x = jax.lax.fori_loop(1, n_levels, up, x)
    return x.reshape(-1)[factor.place].astype(b.dtype)
