"""Growth of time and memory of a step with the number of elements.

The elastic tube of the benchmark `steps` on six meshes, each in a process of its own. The exponent
is the slope of a straight line through all of them, both axes logarithmic.
"""

import concurrent.futures
import multiprocessing
from typing import Any

import numpy as np

from benchmarks.steps import DT, timed_steps
from jaxfsi.verification.tube_wave import wave_mesh

MESHES = {
    "10k": (16, 32, 2),
    "30k": (22, 44, 3),
    "60k": (30, 60, 3),
    "150k": (40, 80, 4),
    "300k": (50, 100, 5),
    "500k": (60, 120, 6),
}
MOST = 1.15
"""Exponent of the time of a step at most."""


def run(rounds: int) -> dict[str, Any]:
    """Time a step on each mesh."""
    spawn = multiprocessing.get_context("spawn")
    rows = []
    for name in MESHES:
        with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as process:
            rows.append(process.submit(_row, name, rounds).result())
    size = np.log([row["tets"] for row in rows])
    exponents = {
        key: float(np.polyfit(size, np.log([row[key] for row in rows]), 1)[0])
        for key in ("median_s", "peak_GiB", "prepare_s")
    }
    return {
        "name": "growth",
        "rows": rows,
        "exponents": exponents,
        "notes": [
            f"exponent of the time of a step: {exponents['median_s']:.2f} (at most {MOST:g})",
            f"exponent of the preparation: {exponents['prepare_s']:.2f}; of the peak of memory, in"
            f" which the program itself counts: {exponents['peak_GiB']:.2f}",
            f"dt {DT:g} s, tolerance 1e-3; peak_GiB: of a process that does this alone.",
        ],
        "passed": exponents["median_s"] <= MOST,
    }


def _row(name: str, rounds: int) -> dict[str, Any]:
    return timed_steps(name, wave_mesh(*MESHES[name]), rounds, tolerance=1e-3).row
