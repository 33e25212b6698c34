"""Adapter of mmg3d: improves tetrahedra of one or several regions towards a given size."""

import mmgpy
import numpy as np


def run(arrays, options):
    """``points, tets, region, triangles, label, size`` and options -> ``points, tets, region``."""
    mesh = mmgpy.MmgMesh3D()
    points, tets, triangles = arrays["points"], arrays["tets"], arrays["triangles"]
    mesh.set_mesh_size(vertices=len(points), tetrahedra=len(tets), triangles=len(triangles))
    mesh.set_vertices(np.ascontiguousarray(points, dtype=np.float64))
    mesh.set_tetrahedra(
        np.ascontiguousarray(tets, dtype=np.int32), arrays["region"].astype(np.int64) + 1
    )
    mesh.set_triangles(
        np.ascontiguousarray(triangles, dtype=np.int32), arrays["label"].astype(np.int64) + 1
    )
    if "size" in arrays:
        mesh.set_field("metric", np.ascontiguousarray(arrays["size"], dtype=np.float64)[:, None])
    mesh.remesh(verbose=-1, **options)
    tets, region = mesh.get_tetrahedra_with_refs()
    return {
        "points": mesh.get_vertices(),
        "tets": tets.astype(np.int64),
        "region": region.astype(np.int64) - 1,
    }
