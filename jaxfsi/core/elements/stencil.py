"""Scalar operators on the nodes of a mesh: one sparsity pattern, values as columns.

A stencil holds for each node i its neighbours j in a fixed number of columns (ELL format), so that
its product with a field is one loop of gathers without a scatter::

    (S f)_i = Σ_k S[k, i] f[neighbour[k, i]]

On a CPU this is about ten times cheaper than the same product element by element, and several
fields can share the values.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import gathered

Values = Float[Array, "columns nodes"]


class Pattern(eqx.Module):
    """Which nodes are coupled, and where each pair of corners of each element goes.

    Attributes:
        neighbour: node of each column; the node itself where a column is not used.
        slot: place of corners (a, b) of each element in the flattened values.
    """

    neighbour: Int[Array, "columns nodes"]
    slot: Int[Array, "4 4 tets"]


def pattern(tets: Int[np.ndarray, "tets 4"], n_nodes: int) -> Pattern:
    """Pattern of linear elements."""
    neighbour, slot = _places(tets, n_nodes)
    return Pattern(
        jnp.asarray(neighbour, jnp.int32), jnp.asarray(np.moveaxis(slot, 0, 2), jnp.int32)
    )


def neighbours(tets: Int[np.ndarray, "tets 4"], n_nodes: int) -> Int[np.ndarray, "columns nodes"]:
    """Node of each column of a pattern."""
    return _places(tets, n_nodes)[0]


def columns_of(
    matrix: sp.csr_matrix, neighbour: Int[np.ndarray, "columns nodes"]
) -> Float[np.ndarray, "columns nodes"]:
    """Values of a sparse matrix in the columns of a pattern that has all its places."""
    n_columns, n_nodes = neighbour.shape
    if not n_columns:
        return np.zeros(neighbour.shape)
    nodes = np.broadcast_to(np.arange(n_nodes), neighbour.shape)
    values = np.asarray(matrix[nodes.ravel(), neighbour.ravel()]).reshape(n_columns, n_nodes)
    # A node stands for itself once; other columns with it are not used.
    own = neighbour == np.arange(n_nodes)
    return np.where(own & (np.cumsum(own, axis=0) > 1), 0.0, values)


def _places(
    tets: Int[np.ndarray, "tets 4"], n_nodes: int
) -> tuple[Int[np.ndarray, "columns nodes"], Int[np.ndarray, "tets 4 4"]]:
    tets = tets.astype(np.int64)  # the square of the number of nodes has to fit
    row, column = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    pairs, index = np.unique(row * n_nodes + column, return_inverse=True)
    rows, columns = np.divmod(pairs, n_nodes)
    first = np.searchsorted(rows, np.arange(n_nodes))
    rank = np.arange(len(rows)) - first[rows]
    n_columns = int(rank.max(initial=-1)) + 1
    neighbour = np.tile(np.arange(n_nodes), (n_columns, 1))
    neighbour[rank, rows] = columns
    slot = (rank * n_nodes + rows)[index].reshape(len(tets), 4, 4)
    return neighbour, slot


def assemble(
    entries: Sequence[Sequence[Float[Array, " tets"]]], pattern: Pattern
) -> tuple[Values, ...]:
    """Sum element matrices into stencils.

    Args:
        entries: of each stencil the sixteen entries of the element matrices, row by row.
        pattern: of the same elements.
    """
    n_columns, n_nodes = pattern.neighbour.shape
    # All stencils in one sum, side by side: what costs is to find the place.
    flat = jnp.zeros((n_columns * n_nodes, len(entries)), entries[0][0].dtype)
    for index in range(16):
        block = jnp.stack([matrix[index] for matrix in entries], axis=1)
        flat = flat.at[pattern.slot[index // 4, index % 4]].add(block)
    return tuple(jnp.moveaxis(flat.reshape(n_columns, n_nodes, len(entries)), 2, 0))


def apply(
    values: Values, neighbour: Int[Array, "columns nodes"], field: Float[Array, " nodes"]
) -> Float[Array, " nodes"]:
    """Product of a stencil and a field."""
    # Written out, one column at a time: XLA makes a single loop of it.
    total = jnp.zeros_like(field)
    for k in range(values.shape[0]):
        total = total + values[k] * gathered(field, neighbour[k])
    return total
