"""Sparse matrices of linear tetrahedra on the host, for factors that are made once."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

MASS = (np.ones((4, 4)) + np.eye(4)) / 20.0
"""∫ N_a N_b over an element of unit volume."""


class HostGeometry(NamedTuple):
    """Shape of the elements, elements first.

    Attributes:
        grad: gradients of the four shape functions [1/cm].
        volume: volumes [cm³].
    """

    grad: Float[np.ndarray, "tets 4 3"]
    volume: Float[np.ndarray, " tets"]


def host_geometry(
    points: Float[np.ndarray, "nodes 3"], tets: Int[np.ndarray, "tets 4"]
) -> HostGeometry:
    """Gradients and volumes of linear tetrahedra."""
    corner = points[tets]
    edges = np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2)
    others = np.linalg.inv(edges)
    grad = np.concatenate([-np.sum(others, axis=1, keepdims=True), others], axis=1)
    return HostGeometry(grad, np.linalg.det(edges) / 6.0)


def assembled(
    elements: Int[np.ndarray, "tets 4"], values: Float[np.ndarray, "tets 4 4"], n_nodes: int
) -> sp.csr_matrix:
    """Sum element matrices of a scalar field into a sparse matrix."""
    rows, columns = np.repeat(elements, 4, axis=1).ravel(), np.tile(elements, (1, 4)).ravel()
    return sp.csr_matrix((values.ravel(), (rows, columns)), shape=(n_nodes, n_nodes))


def assembled_vector(
    elements: Int[np.ndarray, "tets 4"], values: Float[np.ndarray, "tets 4 3 4 3"], n_nodes: int
) -> sp.csr_matrix:
    """Sum element matrices of a vector field into a matrix with three unknowns a node."""
    unknowns = (3 * elements[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.repeat(unknowns, 12, axis=1).ravel(), np.tile(unknowns, (1, 12)).ravel()
    return sp.csr_matrix((values.ravel(), (rows, columns)), shape=(3 * n_nodes,) * 2)


def stiffness(shape: HostGeometry, coefficient: Float[np.ndarray, " tets"]) -> np.ndarray:
    """∫ k ∇N_a·∇N_b of each element, shape (tets, 4, 4)."""
    return np.einsum(
        "eai,ebi,e->eab", shape.grad, shape.grad, coefficient * shape.volume, optimize=True
    )


def isotropic_stiffness(
    shape: HostGeometry, lam: Float[np.ndarray, " tets"], G: Float[np.ndarray, " tets"]
) -> np.ndarray:
    """∫ ∇v : (λ ∇·u I + G (∇u + ∇uᵀ)) of each element, shape (tets, 4, 3, 4, 3)."""
    grad, V = shape.grad, shape.volume
    plain = np.einsum("eai,ebj->eaibj", grad, grad)
    swapped = np.swapaxes(plain, 2, 4)
    laplace = np.einsum("eak,ebk->eab", grad, grad)
    result = (lam * V)[:, None, None, None, None] * plain
    result += (G * V)[:, None, None, None, None] * swapped
    for i in range(3):
        result[:, :, i, :, i] += (G * V)[:, None, None] * laplace
    return result
