"""Flat tetrahedra mended one by one, where as few as can be fill a region.

An inner edge between two nodes of the surface spans the region. Splitting it at its middle frees
the tetrahedra about it: mmg3d then moves the new node and swaps edges. Only the edges of flat
tetrahedra are split.
"""

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.faces import find_rows, tet_edges, triangle_edges, unique_rows
from jaxfsi.meshing.check.tet_quality import tet_quality
from jaxfsi.meshing.isolate import native_call, run_isolated
from jaxfsi.meshing.volume.layers import split_edges

_LEAST_DIHEDRAL_DEG = 8.0
_ROUNDS = 6


def relieved(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    triangles: Int[np.ndarray, "triangles 3"],
    label: Int[np.ndarray, " triangles"],
    *,
    barred: Int[np.ndarray, "barred 4"],
) -> tuple[Float[np.ndarray, "new 3"], Int[np.ndarray, "newtets 4"]]:
    """Tetrahedra none of which is flat or barred, as far as few more nodes go.

    Args:
        points: nodes, those of the surface first [cm].
        tets: positively oriented.
        triangles: of the surface, normals outwards; they stay.
        label: of each triangle.
        barred: nodes of tetrahedra that may not be.

    Returns:
        Nodes and tetrahedra whose smallest dihedral angle is the largest that was found; that of
        barred ones counts as zero.

    Raises:
        MeshingError: mmg3d fails.
    """
    kept, _ = unique_rows(np.sort(triangle_edges(triangles).reshape(-1, 2), axis=1))
    best, least = (points, tets), -1.0
    for _ in range(_ROUNDS):
        angle = tet_quality(points, tets).min_dihedral_deg
        angle = np.where(find_rows(tets, barred) < 0, angle, 0.0)
        if angle.min() > least:
            best, least = (points, tets), float(angle.min())
        edges = tet_edges(tets[angle < _LEAST_DIHEDRAL_DEG])
        edges = edges[find_rows(edges, kept) < 0]
        if len(edges) == 0:
            break
        points, tets = _smoothed(*split_edges(points, tets, edges), triangles, label)
    return best


def _smoothed(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    triangles: Int[np.ndarray, "triangles 3"],
    label: Int[np.ndarray, " triangles"],
) -> tuple[Float[np.ndarray, "nodes 3"], Int[np.ndarray, "newtets 4"]]:
    """Inner nodes moved and edges swapped; no node is added or taken away."""
    arrays = {
        "points": points,
        "tets": tets,
        "region": np.zeros(len(tets), dtype=np.int64),
        "triangles": triangles,
        "label": label,
    }
    options: dict[str, object] = {"nosurf": 1, "angle": 0, "nofem": 1, "noinsert": 1}
    out = run_isolated(native_call("mmg_volume", arrays, options))
    return out["points"], out["tets"]
