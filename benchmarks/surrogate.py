"""Periodic states of the surrogate: sweeps of α here, in diffrax and in svZeroDSolver.

Accuracy stands beside time: the pressure ratio against the closed form, the distal waveform
against the exact propagator with 2048 steps. svZeroDSolver and diffrax run as their users run
them: four cycles, of which the last is used.
"""

import functools
from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.timing import in_turn
from calibration import sweep_alpha
from lumped import (
    MMHG,
    Propagator,
    Surrogate,
    SvZeroDCase,
    algebraic,
    condition_from_clinic,
    ffr_divider,
    field,
    solve_periodic,
    svzerod_config,
)

try:
    import svzerod  # pyright: ignore[reportMissingImports]
except ImportError:
    svzerod = None

PATIENT = Surrogate(R0=5e3)
REST = condition_from_clinic(110.0, 65.0, 0.8)
POINTS = 201
CYCLES = 4


def run(rounds: int = 5) -> dict[str, Any]:
    """Time sweeps of 1, 100 and 10 000 scale factors.

    Returns:
        {"name", "rows", "notes"}, ready for JSON.
    """
    rows = []
    for n in (1, 100, 10_000):
        alphas = jnp.linspace(0.05, 2.0, n)
        functions: dict[str, Any] = {
            "jaxfsi, waveforms": lambda alphas=alphas: sweep_alpha(PATIENT, REST, alphas),
            "jaxfsi, metrics only": lambda alphas=alphas: sweep_alpha(
                PATIENT, REST, alphas, waveforms=False
            ),
        }
        if n <= 100:
            functions["diffrax Kvaerno5 1e-6, 4 cycles"] = functools.partial(_diffrax, alphas)
        if svzerod is not None and n <= 100:
            functions["svZeroDSolver, 4 x 201 points"] = functools.partial(_svzerod, alphas)
        results, times = in_turn(functions, rounds)
        for name, result in results.items():
            rows.append(
                {"method": name, "cases": n, **times[name], **_accuracy(name, result, alphas)}
            )
    passed = all(row["ratio_error"] < 1e-12 for row in rows if row["method"].startswith("jaxfsi"))
    return {"name": "sweep of alpha", "rows": rows, "notes": _notes(rows), "passed": passed}


def _notes(rows: list[dict[str, Any]]) -> list[str]:
    per_case = {row["method"]: row["median_s"] / row["cases"] for row in rows}
    ours = per_case["jaxfsi, waveforms"]
    return [
        f"per case at the largest batch: jaxfsi 1 : {name} {seconds / ours:.0f}"
        for name, seconds in per_case.items()
        if not name.startswith("jaxfsi")
    ]


def _accuracy(name: str, result: Any, alphas: Float[Array, " n"]) -> dict[str, float]:
    """Largest error of the ratio, and of the distal waveform of the last case."""
    exact = np.asarray(ffr_divider(5e3, alphas * PATIENT.coronary.R_total))
    if name.startswith("jaxfsi"):
        ratio = np.asarray(result.metrics.ratio)
        t, P = result.t, result.P_distal
    else:
        ratio, t, P = result
    errors = {"ratio_error": float(np.max(np.abs(ratio - exact)))}
    if P is not None:
        reference_t, reference = _reference(float(alphas[-1]))
        at = np.interp(np.asarray(t)[-1], reference_t, reference, period=0.8)
        errors["waveform_error_per_systolic"] = float(
            np.max(np.abs(np.asarray(P)[-1] - at)) / (110.0 * MMHG)
        )
    return errors


@functools.cache
def _reference(alpha: float) -> tuple[np.ndarray, np.ndarray]:
    network = eqx.tree_at(lambda s: s.alpha, PATIENT, jnp.asarray(alpha)).network(REST)
    fine = solve_periodic(network, REST.period, Propagator(2048))
    return np.asarray(fine.t), np.asarray(fine.pressure("distal"))


@eqx.filter_jit
def _diffrax(alphas: Float[Array, " n"]) -> tuple[Array, Array, Array]:
    """Ratio, times and distal pressure of the last of four adaptive cycles."""
    ts = jnp.linspace(0.0, 0.8, POINTS)

    def one(alpha: Array) -> tuple[Array, Array, Array]:
        network = eqx.tree_at(lambda s: s.alpha, PATIENT, alpha).network(REST)
        solution = dfx.diffeqsolve(
            dfx.ODETerm(field(network)),
            dfx.Kvaerno5(),
            t0=0.0,
            t1=CYCLES * 0.8,
            dt0=None,
            y0=jnp.full(3, 65.0 * MMHG).at[2].set(0.0),
            args=network,
            saveat=dfx.SaveAt(ts=(CYCLES - 1) * 0.8 + ts),
            stepsize_controller=dfx.PIDController(rtol=1e-6, atol=1e-2),
            max_steps=100_000,
        )
        assert solution.ys is not None
        w = jax.vmap(lambda t, x: algebraic(t, network, x))(ts, solution.ys)
        P_aorta, P_distal = w[:, 0], w[:, 1]
        return jnp.trapezoid(P_distal) / jnp.trapezoid(P_aorta), ts, P_distal

    return jax.vmap(one)(alphas)


def _svzerod(alphas: Float[Array, " n"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same networks one by one in svZeroDSolver; building the cases is not counted twice."""
    assert svzerod is not None
    ratios, times, pressures = [], [], []
    for alpha in np.asarray(alphas):
        table = svzerod.simulate(svzerod_case(float(alpha)))
        last = table[table["name"] == "ostium"].iloc[-POINTS:]
        P_in, P_out = np.asarray(last["pressure_in"]), np.asarray(last["pressure_out"])
        ratios.append(np.trapezoid(P_out) / np.trapezoid(P_in))
        times.append(np.asarray(last["time"]) - last["time"].iloc[0])
        pressures.append(P_out)
    return np.array(ratios), np.array(times), np.array(pressures)


@functools.cache
def svzerod_case(alpha: float) -> dict[str, Any]:
    """The surrogate as a case of svZeroDSolver; cached, so that warm calls only simulate."""
    network = eqx.tree_at(lambda s: s.alpha, PATIENT, jnp.asarray(alpha)).network(REST)
    case = SvZeroDCase(
        network, float(REST.period), cycles=CYCLES, points_per_cycle=POINTS, steady_initial=True
    )
    return svzerod_config(case, samples=POINTS - 1)
