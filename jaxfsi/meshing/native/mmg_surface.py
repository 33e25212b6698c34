"""Adapter of mmgs: remeshes a triangulated surface to a size given at its vertices."""

import mmgpy
import numpy as np


def run(arrays, options):
    """``points, triangles, size`` and mmg options -> ``points, triangles``."""
    mesh = mmgpy.MmgMeshS()
    points, triangles = arrays["points"], arrays["triangles"]
    mesh.set_mesh_size(vertices=len(points), triangles=len(triangles))
    mesh.set_vertices(np.ascontiguousarray(points, dtype=np.float64))
    mesh.set_triangles(np.ascontiguousarray(triangles, dtype=np.int32))
    mesh.set_field("metric", np.ascontiguousarray(arrays["size"], dtype=np.float64)[:, None])
    mesh.remesh(verbose=-1, **options)
    return {"points": mesh.get_vertices(), "triangles": mesh.get_triangles().astype(np.int64)}
