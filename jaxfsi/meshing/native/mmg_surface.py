"""Adapter of mmgs: remeshes a triangulated surface to a size given at its vertices."""

import mmgpy
import numpy as np


def run(arrays, options):
    """``points, triangles, size`` and mmg options -> ``points, triangles``.

    Edges ``kept``, if any, stay as they are.
    """
    mesh = mmgpy.MmgMeshS()
    points, triangles = arrays["points"], arrays["triangles"]
    kept = arrays.get("kept", np.zeros((0, 2), dtype=np.int64))
    mesh.set_mesh_size(vertices=len(points), triangles=len(triangles), edges=len(kept))
    mesh.set_vertices(np.ascontiguousarray(points, dtype=np.float64))
    mesh.set_triangles(np.ascontiguousarray(triangles, dtype=np.int32))
    if len(kept):
        mesh.set_edges(np.ascontiguousarray(kept, dtype=np.int32))
        mesh.set_required_edges(np.arange(len(kept), dtype=np.int32))
    mesh.set_field("metric", np.ascontiguousarray(arrays["size"], dtype=np.float64)[:, None])
    mesh.remesh(verbose=-1, **options)
    return {"points": mesh.get_vertices(), "triangles": mesh.get_triangles().astype(np.int64)}
