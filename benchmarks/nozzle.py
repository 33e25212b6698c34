"""Mesh error of the FDA nozzle's loss coefficient, estimated and true, where inertia matters.

The true one is the difference to another method (`benchmarks.axisymmetric`). Estimates: what the
mesh adds by its viscous loss (`jaxfsi.fields.viscous_loss`), from one run; and the change to the
mesh before, with order 4 (`calibration.mesh_band`), from two. Effectivity is estimate over error.
"""

import time
from typing import Any

from benchmarks.axisymmetric import axisymmetric_loss
from benchmarks.verification import reordered
from calibration import mesh_band
from jaxfsi.verification.nozzle import nozzle_flow, nozzle_mesh

_REFINEMENTS = (2, 3)
"""4 takes ten minutes more and 5 an hour; docs/benchmarks/algorithm-1.md has them."""

_FINENESS = 4
_DT, _STEPS = 5e-3, 240
_LEAST, _MOST = 0.7, 1.4


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    exact, rows, before = axisymmetric_loss(_FINENESS), [], None
    for n in _REFINEMENTS:
        start = time.perf_counter()
        mesh = reordered(nozzle_mesh(n))
        found = nozzle_flow(mesh, dt=_DT, n_steps=_STEPS)
        error = found.K - exact
        row = {
            "refinement": n,
            "tets": len(mesh.tets),
            "K": found.K,
            "error_%": 100.0 * error / exact,
            "added_by_mesh_%": 100.0 * found.added / exact,
            "effectivity": found.added / error,
            "corrected_error_%": 100.0 * (error - found.added) / exact,
            "two_meshes_effectivity": None,
            "seconds": time.perf_counter() - start,
        }
        if before is not None:
            n_before, K_before = before
            band = mesh_band(found.K, K_before, n / n_before, (2.0, 4.0, 12.0))
            row["two_meshes_effectivity"] = (found.K - float(band.expected)) / error
        before = n, found.K
        rows.append(row)
    return {
        "name": "nozzle",
        "rows": rows,
        "notes": [
            f"Loss coefficient by the axisymmetric Taylor-Hood method: {exact:.5f}.",
            f"effectivity of two meshes is asked to lie in {_LEAST} to {_MOST}. Where it is small,"
            " errors of both signs cancel, and numbers seem to converge that have not.",
        ],
        "passed": all(_LEAST < row["two_meshes_effectivity"] < _MOST for row in rows[1:]),
    }
