"""Adapter of TetGen (AGPL, installed by choice): fills a closed surface with tetrahedra."""

import numpy as np
import tetgen  # pyright: ignore[reportMissingImports]


def run(arrays, options):
    """``points, triangles`` (closed) -> ``points, tets``; the input nodes come first."""
    mesher = tetgen.TetGen(
        np.ascontiguousarray(arrays["points"], dtype=np.float64),
        np.ascontiguousarray(arrays["triangles"], dtype=np.int32),
    )
    # Y keeps the surface as it is; q bounds radius-edge ratio and dihedral angle.
    filled = mesher.tetrahedralize(switches=str(options.get("switches", "pq1.4/12YQ")))
    return {"points": np.asarray(filled[0]), "tets": np.asarray(filled[1]).astype(np.int64)}
