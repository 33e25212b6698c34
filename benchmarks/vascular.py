"""Calibration of the vessels of a network: time and accuracy here and in svZeroDSolver.

Both calibrators get the same 18 vessels (0104_0001 of the Vascular Model Repository, with the
optimum stored by svZeroDSolver) in the same process, one after the other in every round. Where
that case is not at hand, 18 synthetic vessels with known parameters take its place.
"""

import contextlib
import json
import os
import pathlib
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibration import (
    VesselParameters,
    VesselRecord,
    calibrate_vessels,
    synthetic_record,
)
from lumped.svzerod_calibration import read_calibration

try:
    import svzerod  # pyright: ignore[reportMissingImports]
except ImportError:
    svzerod = None

_VMR = pathlib.Path(__file__).parents[2] / "shared" / "data" / "svzerod" / "vmr"
_KEYS = ("R_poiseuille", "C", "L", "stenosis_coefficient")
_COPIES = 100


def run(rounds: int = 9) -> dict[str, Any]:
    """Time both calibrators in turn.

    Args:
        rounds: number of timed calls of each; the median and the extremes are reported.

    Returns:
        {"name", "rows", "notes"}, ready for JSON. Times in seconds, residual norms in CGS.
    """
    config, expected, source = _case()
    record = _record(config)
    ours, first_call = _timed(lambda: _ours(record))
    many = jax.tree.map(lambda x: jnp.tile(x, (_COPIES, 1)), record)
    _ours(many)
    times: dict[str, list[float]] = {"ours": [], "many": [], "gradient": [], "svzerod": []}
    gradient = jax.jit(jax.grad(lambda r: jnp.sum(jnp.log(calibrate_vessels(r).parameters.L))))
    jax.block_until_ready(gradient(record))
    theirs = None
    for _ in range(rounds):
        times["ours"].append(_timed(lambda: _ours(record))[1])
        times["many"].append(_timed(lambda: _ours(many))[1])
        times["gradient"].append(_timed(lambda: jax.block_until_ready(gradient(record)))[1])
        if svzerod is not None:
            theirs, duration = _timed(lambda: _svzerod(config))
            times["svzerod"].append(duration)
    vessels = len(expected)
    rows = [
        _row("jaxfsi", vessels, times["ours"])
        | {"first_call_s": first_call}
        | _accuracy(ours, expected),
        _row("jaxfsi", vessels * _COPIES, times["many"]),
        _row("jaxfsi, gradient with respect to the whole record", vessels, times["gradient"]),
    ]
    if theirs is not None:
        row = _row("svZeroDSolver", vessels, times["svzerod"]) | _accuracy(theirs, expected)
        row["times_jaxfsi"] = row["median_s"] / rows[0]["median_s"]
        rows.append(row)
    notes = [
        f"Case: {source}; {record.P_in.shape[1]} samples a vessel.",
        "Ours is timed from arrays in memory to arrays in memory, checks included, the first "
        "call with compilation apart; svZeroDSolver from a Python dictionary to a dictionary, its "
        "output silenced.",
        "Quadratic loss K counts down to 1e-6 of the pressure drop: its relative deviation is "
        "round-off times that ratio, in both codes.",
    ]
    if svzerod is None:
        notes.append("The package svzerod is not installed: no comparison was made.")
    return {"name": "vascular calibration", "rows": rows, "notes": notes}


def _row(method: str, vessels: int, times: list[float]) -> dict[str, Any]:
    return {
        "method": method,
        "vessels": vessels,
        "median_s": statistics.median(times),
        "min_s": min(times),
        "max_s": max(times),
    }


def _accuracy(found: np.ndarray, expected: np.ndarray) -> dict[str, float]:
    deviation = np.max(np.abs(found / expected - 1.0), axis=0)
    names = ("R_viscous", "C", "L", "K_stenosis")
    return {
        f"max_relative_deviation_{name}": float(value)
        for name, value in zip(names, deviation, strict=True)
    }


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = call()
    return result, time.perf_counter() - start


def _ours(record: VesselRecord) -> np.ndarray:
    parameters = calibrate_vessels(record).parameters
    columns = (parameters.R_viscous, parameters.C, parameters.L, parameters.K_stenosis)
    return np.stack([np.asarray(column) for column in columns], axis=1)


def _svzerod(config: Mapping[str, Any]) -> np.ndarray:
    with _silenced():
        result = svzerod.calibrate(config)  # pyright: ignore[reportOptionalMemberAccess]
    return _stored(result)


def _stored(config: Mapping[str, Any]) -> np.ndarray:
    return np.array([[v["zero_d_element_values"][k] for k in _KEYS] for v in config["vessels"]])


@contextlib.contextmanager
def _silenced() -> Iterator[None]:
    """Send standard output of compiled code nowhere."""
    kept = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def _case() -> tuple[dict[str, Any], np.ndarray, str]:
    """A calibration case that svZeroDSolver 3.2 accepts, its optimum, and where it is from."""
    path = _VMR / "0104_0001_calibrate_from_0d.json"
    if path.is_file():
        config = json.loads(path.read_text())
        expected = _stored(json.loads((_VMR / "0104_0001_optimal_from_0d.json").read_text()))
        source = "0104_0001, optimum stored by svZeroDSolver"
    else:
        config, expected = _synthetic_case(18)
        source = "synthetic, exact parameters known"
    for vessel in config["vessels"]:
        vessel["calibrate"] = list(_KEYS)
    return config, expected, source


def _record(config: Mapping[str, Any]) -> VesselRecord:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "case.json"
        path.write_text(json.dumps(config))
        return VesselRecord(**read_calibration(path).vessels.record)


def _synthetic_case(vessels: int) -> tuple[dict[str, Any], np.ndarray]:
    """Unconnected vessels of random parameters, each between two boundary conditions."""
    rng = np.random.default_rng(5)
    parameters = VesselParameters(
        R_viscous=10 ** rng.uniform(0, 2, vessels),
        C=10 ** rng.uniform(-7, -6, vessels),
        L=10 ** rng.uniform(0, 1.5, vessels),
        K_stenosis=10 ** rng.uniform(-2, 0, vessels),
    )
    record = synthetic_record(
        parameters,
        jnp.linspace(0.0, 0.99, 100),
        lambda t: 1.2e5 + 2.5e4 * jnp.sin(6.3 * t) + 8.0e3 * jnp.cos(18.9 * t),
        lambda t: 8.0 + 6.0 * jnp.sin(6.3 * t + 0.3) + 2.0 * jnp.cos(18.9 * t),
    )
    columns = {
        ("y", "pressure", "IN{0}:v{0}"): record.P_in,
        ("y", "flow", "IN{0}:v{0}"): record.Q_in,
        ("y", "pressure", "v{0}:OUT{0}"): record.P_out,
        ("y", "flow", "v{0}:OUT{0}"): record.Q_out,
        ("dy", "pressure", "IN{0}:v{0}"): record.dP_in,
        ("dy", "flow", "IN{0}:v{0}"): record.dQ_in,
        # svZeroDSolver wants a rate for every variable; this one enters no equation
        ("dy", "pressure", "v{0}:OUT{0}"): jnp.zeros_like(record.P_out),
        ("dy", "flow", "v{0}:OUT{0}"): record.dQ_out,
    }
    config: dict[str, Any] = {"junctions": [], "y": {}, "dy": {}, "calibration_parameters": {}}
    config["vessels"] = [
        {
            "vessel_id": i,
            "vessel_name": f"v{i}",
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": dict.fromkeys(_KEYS, 0.0),
            "boundary_conditions": {"inlet": f"IN{i}", "outlet": f"OUT{i}"},
        }
        for i in range(vessels)
    ]
    for (table, variable, node), values in columns.items():
        for i, row in enumerate(np.asarray(values)):
            config[table][f"{variable}:{node.format(i)}"] = row.tolist()
    return config, np.asarray(parameters.as_table())


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
