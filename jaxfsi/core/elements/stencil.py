"""Scalar operators on the nodes of a mesh: one sparsity pattern, values as columns.

A stencil holds for each node i its neighbours j in a fixed number of columns (ELL format), so that
its product with a field is one loop of gathers without a scatter::

    (S f)_i = Σ_k S[k, i] f[neighbour[k, i]]

On a CPU this is about ten times cheaper than the same product element by element, and several
fields can share the values.
"""

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import gathered

Values = Float[Array, "columns nodes"]


def neighbours(tets: Int[np.ndarray, "tets 4"], n_nodes: int) -> Int[np.ndarray, "columns nodes"]:
    """Node of each column for linear elements; the node itself where a column is not used."""
    row, column = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    return columns_of_pairs(row, column, n_nodes)[0]


def columns_of_pairs(
    row: Int[np.ndarray, " pairs"], column: Int[np.ndarray, " pairs"], n_nodes: int
) -> tuple[Int[np.ndarray, "columns nodes"], Int[np.ndarray, " pairs"]]:
    """Node of each column as in `neighbours`, and the column in which each pair of nodes lies."""
    # the square of the number of nodes has to fit
    pairs, which = np.unique(row.astype(np.int64) * n_nodes + column, return_inverse=True)
    rows, columns = np.divmod(pairs, n_nodes)
    rank = np.arange(len(rows)) - np.searchsorted(rows, np.arange(n_nodes))[rows]
    n_columns = int(rank.max(initial=-1)) + 1
    neighbour = np.tile(np.arange(n_nodes), (n_columns, 1))
    neighbour[rank, rows] = columns
    return neighbour, rank[which]


def columns_of(
    matrix: sp.csr_matrix, neighbour: Int[np.ndarray, "columns nodes"]
) -> Float[np.ndarray, "columns nodes"]:
    """Values of a sparse matrix whose entries all have a column, see `neighbours`."""
    n_columns, n_nodes = neighbour.shape
    if not n_columns:
        return np.zeros(neighbour.shape)
    nodes = np.broadcast_to(np.arange(n_nodes), neighbour.shape)
    values = np.asarray(matrix[nodes.ravel(), neighbour.ravel()]).reshape(n_columns, n_nodes)
    # A node stands for itself once; other columns with it are not used.
    own = neighbour == np.arange(n_nodes)
    return np.where(own & (np.cumsum(own, axis=0) > 1), 0.0, values)


def apply(
    values: Values, neighbour: Int[Array, "columns nodes"], field: Float[Array, " nodes"]
) -> Float[Array, " nodes"]:
    """Product of a stencil and a field."""
    # Written out, one column at a time: XLA makes a single loop of it.
    total = jnp.zeros_like(field)
    for k in range(values.shape[0]):
        total = total + values[k] * gathered(field, neighbour[k])
    return total
