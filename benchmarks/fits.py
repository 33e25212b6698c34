"""Waveform fits: five parameters to 512 samples, from one start and from a thousand.

Distal pressure and coronary flow of the surrogate at 256 instants each, without noise, so that the
parameters' error is known. `scipy.optimize.least_squares` gets the same compiled residual function
and takes its derivatives by finite differences, as is usual around a simulation code.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from benchmarks.timing import in_turn
from calibration import Experiment, fit, fit_batch, stacked, waveform_target
from calibration.free_parameter import as_free, read, write
from lumped import MMHG, Fourier, Surrogate, condition_from_clinic

try:
    from scipy.optimize import least_squares
except ImportError:
    least_squares = None

NAMES = ("R0", "alpha", "coronary.C_a", "coronary.C_im", "C0")
TRUTH = Surrogate(R0=5e3, alpha=0.3)
STARTS = 1000
SCIPY_STARTS = 20
"""SciPy's starts, out of the thousand: it is timed for these and reported for one."""

FACTOR = 2.0
"""Every start is off by up to this factor, either way, in every parameter."""

FOUND = 1e-6
"""Largest relative error of a parameter for a start to count as recovered."""


def problem() -> Experiment:
    """The waveforms of the true parameters, sd 0.5 mmHg and 3 mL/min."""
    condition = condition_from_clinic(110.0, 65.0, 0.8)
    t = np.arange(256) * (0.8 / 256)
    empty = Experiment(condition, (), solver=Fourier(256))
    solution = eqx.filter_jit(empty.solution)(TRUTH)
    targets = (
        waveform_target("distal", t, np.asarray(solution.pressure("distal")), 0.5 * MMHG),
        waveform_target("ostium", t, np.asarray(solution.flow("ostium")), 0.05),
    )
    return Experiment(condition, targets, solver=Fourier(256))


def run(rounds: int = 5) -> dict[str, Any]:
    """Time the fits.

    Returns:
        {"name", "rows", "notes"}, ready for JSON.
    """
    free, experiment = as_free(NAMES), problem()
    truth = read(TRUTH, free)
    rng = np.random.default_rng(12)
    factors = jnp.asarray(FACTOR ** rng.uniform(-1.0, 1.0, (STARTS, len(free))))
    begin = [write(TRUTH, free, truth * factor) for factor in factors]
    models, data = stacked(begin), stacked([experiment] * STARTS)
    peer = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9)

    def one(solver: Any = None) -> Any:
        return fit(begin[0], free, experiment, solver=solver, throw=False)

    def many(solver: Any = None) -> Any:
        return fit_batch(models, free, data, solver=solver, throw=False)

    functions: dict[tuple[str, int], Callable[[], Any]] = {
        ("fit", 1): lambda: one().outcome,
        ("fit_batch", STARTS): lambda: many().outcome,
        ("fit, optimistix LevenbergMarquardt", 1): lambda: one(peer).outcome,
        ("fit_batch, optimistix LevenbergMarquardt", STARTS): lambda: many(peer).outcome,
    }
    if least_squares is not None:
        residual = jax.jit(lambda u: experiment(write(TRUTH, free, jnp.exp(u))))
        chosen = np.log(np.asarray(truth * factors))[:SCIPY_STARTS]
        functions["SciPy, finite differences", 1] = lambda: _scipy(residual, chosen[:1])
        functions["SciPy, finite differences", SCIPY_STARTS] = lambda: _scipy(residual, chosen)
    results, times = in_turn({str(key): call for key, call in functions.items()}, rounds)
    rows = []
    for method, starts in functions:
        result, taken = results[str((method, starts))], times[str((method, starts))]
        rows.append(
            {"method": method, "starts": starts}
            | taken
            | {"per_start_s": taken["median_s"] / starts}
            | _accuracy(result, np.asarray(truth))
        )
    return {"name": "waveform fits", "rows": rows, "notes": _notes(rows)}


def _accuracy(result: Any, truth: np.ndarray) -> dict[str, Any]:
    """Share of starts recovered, the largest error among those, median steps, median chi2."""
    values = np.atleast_2d(np.asarray(result.values))
    error = np.max(np.abs(values / truth - 1.0), axis=1)
    found = error < FOUND
    return {
        "recovered": float(np.mean(found)),
        "largest_error": float(np.max(error[found])) if np.any(found) else float("nan"),
        "median_steps": float(np.median(np.asarray(result.iterations))),
    }


class _SciPyOutcome(eqx.Module):
    values: np.ndarray
    iterations: np.ndarray


def _scipy(residual: Callable[[Any], Any], starts: np.ndarray) -> _SciPyOutcome:
    assert least_squares is not None
    ends = [
        least_squares(lambda u: np.asarray(residual(u)), start, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        for start in starts
    ]
    return _SciPyOutcome(
        np.exp([end.x for end in ends]), np.array([float(end.nfev) for end in ends])
    )


def _notes(rows: list[dict[str, Any]]) -> list[str]:
    by = {(row["method"], row["starts"]): row for row in rows}
    one, many = by["fit", 1], by["fit_batch", STARTS]
    notes = [
        f"starts are off by up to a factor {FACTOR:g} in each of {', '.join(NAMES)}",
        f"recovered: every parameter within {FOUND:g}; largest_error is over the recovered",
        f"fit includes the covariance and what the data determine; {STARTS} starts of fit_batch "
        f"take {many['median_s'] / one['median_s']:.0f} times as long as one fit",
    ]
    peer = by.get(("SciPy, finite differences", SCIPY_STARTS))
    if peer is None:
        return [*notes, "SciPy is not installed: no comparison was made"]
    ratio = peer["per_start_s"] / many["per_start_s"]
    return [
        *notes,
        f"a start costs SciPy {ratio:.0f} times as much as one of {STARTS} in fit_batch; its "
        "median_steps count residuals without those of its differences",
    ]
