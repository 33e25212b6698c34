"""Adapter of Netgen: fills a closed surface with tetrahedra and keeps its triangles."""

import netgen.meshing as ng
import numpy as np


def run(arrays, options):
    """``points, triangles`` (closed, normals outwards) -> ``points, tets``; input nodes first."""
    points = np.ascontiguousarray(arrays["points"], dtype=np.float64)
    triangles = arrays["triangles"]
    mesh = ng.Mesh(dim=3)  # pyright: ignore[reportAttributeAccessIssue]
    mesh.AddPoints(points)
    face = mesh.Add(
        ng.FaceDescriptor(  # pyright: ignore[reportAttributeAccessIssue]
            surfnr=1, domin=1, domout=0, bc=1
        )
    )
    mesh.AddElements(
        dim=2,
        index=face,
        data=np.ascontiguousarray(triangles, dtype=np.int32),
        base=0,
    )
    # "c" collapses, "d" splits, "m" moves, "s" swaps; nothing of it touches the surface.
    mesh.GenerateVolumeMesh(
        maxh=float(options.get("size_max", 1e6)),
        grading=float(options.get("grading", 0.4)),
        optimize3d=str(options.get("optimise", "cmdmustm")),
        optsteps3d=int(options.get("steps", 1)),
    )
    tets = mesh.Elements3D().NumPy()["nodes"][:, :4].astype(np.int64) - 1
    return {"points": np.array([p.p for p in mesh.Points()]), "tets": tets}
