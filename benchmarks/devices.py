"""A million patients in one call, on one device and on several.

A sweep over α of one patient, metrics without waveforms, in processes that see one and two parts of
the processor as devices of JAX. Fewer samples a beat are enough for means, which a linear network
has to the last digit. The processes run in turn, and their memory is the largest that each held.
"""

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np

COUNTS = (1, 2)
SAMPLES = (64, 256)
PATIENTS = 1_000_000
_PROGRAM = f"""
import json, resource, sys
import jax
import jax.numpy as jnp
from benchmarks.surrogate import PATIENT, REST
from benchmarks.timing import in_turn
from calibration import sweep_alpha
from lumped import ffr_divider

alphas = jnp.linspace(0.05, 2.0, {PATIENTS})
sweeps, times = in_turn(
    {{
        str(n): lambda n=n: sweep_alpha(PATIENT, REST, alphas, n_samples=n, waveforms=False)
        for n in {SAMPLES}
    }},
    int(sys.argv[1]),
)
exact = ffr_divider(PATIENT.R0, alphas * PATIENT.coronary.R_total)
rows = []
for name, sweep in sweeps.items():
    off = float(jnp.max(jnp.abs(sweep.metrics.ratio / exact - 1.0)))
    ifr = [float(v) for v in sweep.metrics.ifr[:: {PATIENTS} // 1000]]
    rows.append({{"samples": int(name), **times[name], "ratio_error": off, "ifr": ifr}})
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0**2
print(json.dumps({{"devices": jax.device_count(), "memory_gb": memory, "rows": rows}}))
"""


def run(rounds: int = 3) -> dict[str, Any]:
    """Time the sweep on one and on two devices.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    found = [_process(count, rounds) for count in COUNTS]
    ifr = [np.array([row["ifr"] for row in one["rows"]]) for one in found]
    apart = float(max(np.max(np.abs(values / ifr[0] - 1.0)) for values in ifr))
    rows = [
        {"devices": one["devices"], "memory_gb": one["memory_gb"]}
        | {key: value for key, value in row.items() if key != "ifr"}
        for one in found
        for row in one["rows"]
    ]
    speed = [rows[k]["median_s"] / rows[k + len(SAMPLES)]["median_s"] for k in range(len(SAMPLES))]
    gains = ", ".join(
        f"{gain:.2f} with {n} samples" for gain, n in zip(speed, SAMPLES, strict=True)
    )
    return {
        "name": f"{PATIENTS} patients on one and two devices",
        "rows": rows,
        "notes": [
            f"one device takes so many times what two take: {gains}",
            f"iFR on two devices is that on one to {apart:.1e}",
        ],
        "passed": apart < 1e-11 and all(row["ratio_error"] < 1e-12 for row in rows),
    }


def _process(count: int, rounds: int) -> dict[str, Any]:
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={count}"
    ran = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(rounds)],
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(ran.stdout)
