"""Whether something holds a wall: clamped nodes, or the tissue outside.

A part of the wall that moves as a rigid body, v + ω × x, without moving a held node feels no force.
Where three held nodes x are not in line, there is no such motion but that of v = ω = 0.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from jaxfsi.core.step.model import Model

_LEAST = 1e-6
"""Least spread of held nodes across their line over the size of the part [-]."""


def check_held(model: Model) -> None:
    """Refuse a concrete model with a wall that nothing holds.

    Raises:
        ValueError: some part of its wall may move as a rigid body.
    """
    assert model.wall is not None
    tets, n = np.asarray(model.solid_tets), model.n_vertices
    holding = np.asarray(model.prescribed)[:n].copy()
    if np.any(np.asarray(model.wall.support_stiffness) > 0.0):
        holding[np.asarray(model.outer_faces)] = True
    x = np.asarray(model.x)[:, :n].T
    loose = [part for part in _parts(tets, n) if not _is_fixed(x[part], holding[part])]
    if loose:
        where = ", ".join(f"{v:.3g}" for v in x[loose[0]].mean(axis=0))
        raise ValueError(
            f"nothing holds {len(loose)} part(s) of the wall, the first about ({where}) cm: it can"
            " move as a rigid body, so that no equilibrium is one. Clamp a ring of it, or give the"
            " tissue outside a support_stiffness above 0."
        )


def _parts(tets: Int[np.ndarray, "4 tets"], n_nodes: int) -> list[Int[np.ndarray, " _"]]:
    """Nodes of each connected part of the wall."""
    ends = np.concatenate([tets[[0, k]] for k in (1, 2, 3)], axis=1)
    graph = sp.coo_array((np.ones(ends.shape[1]), tuple(ends)), shape=(n_nodes, n_nodes))
    part = connected_components(graph, directed=False)[1]
    used = np.unique(tets)
    order = used[np.argsort(part[used], kind="stable")]
    return np.split(order, np.flatnonzero(np.diff(part[order])) + 1)


def _is_fixed(x: Float[np.ndarray, "nodes 3"], holding: Bool[np.ndarray, " nodes"]) -> bool:
    held = x[holding]
    if len(held) < 3:
        return False
    # three nodes that are not in line span a plane: two singular values
    spread = np.linalg.svd(held - held.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _LEAST * np.ptp(x, axis=0).max())
